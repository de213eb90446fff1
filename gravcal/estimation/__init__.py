"""Mathematics without physics: arrays in, arrays out."""
