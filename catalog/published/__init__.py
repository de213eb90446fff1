"""Printed values, with citations: data only."""
