"""Calibration events, one file each: data only."""
