"""How good and how fast: recovery of invented truth, and speed as ratios measured in one run."""
