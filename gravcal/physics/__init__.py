"""Laws of physics: arrays in, arrays out."""
