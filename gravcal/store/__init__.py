"""Products, their keys and records, and what was run: the store."""
