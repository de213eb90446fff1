"""In-orbit calibration of gravity missions."""
