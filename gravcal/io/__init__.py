"""Level-1 files, archives, downloads and gravity fields: reading and writing what others made."""
