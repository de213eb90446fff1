"""Numbers of satellites, events and choices: data only."""
