"""Reading and writing files: Level-1 data, archives, downloads, gravity fields, sequence of events."""
