"""Calibrations: observation equations and their solution; datasets in, datasets out."""
