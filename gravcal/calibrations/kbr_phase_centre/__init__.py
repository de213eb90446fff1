"""Antenna phase centres of a pair from ranging during pointing wiggles (Remote Sens. 2022, 14, 3395)."""
