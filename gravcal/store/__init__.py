"""The store: products, their keys and records, configurations, and records of runs."""
