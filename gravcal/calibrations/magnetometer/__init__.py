"""Magnetometer against the reference field, as discovery sees it: what minutes of data support and no more."""
