"""Routine ranging against orbits as discovery sees it: the antenna correction left out, and what else may be there."""
