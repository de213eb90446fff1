"""Gravity fields that ship with the package."""
