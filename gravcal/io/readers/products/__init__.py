"""One table per Level-1 product: columns in the order of the data, kinds, units, frames, meaning, flag bits."""
