"""Manoeuvre sessions as designed: data only."""
