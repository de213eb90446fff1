"""Calibrations: observation equations and their solution; datasets in, datasets out, as the schema of a stage says."""
