"""The edge of the library: the only code that opens files."""
