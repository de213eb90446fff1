"""Prefect flows: one per calibration, the campaign and the command line."""
