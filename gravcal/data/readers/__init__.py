"""Level-1 file formats."""
