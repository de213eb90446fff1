"""Constants of the satellites: data only."""
