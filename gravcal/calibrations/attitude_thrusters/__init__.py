"""Routine attitude of one satellite as discovery sees it: star camera against a smooth torque, firings as candidate."""
