"""Numbers the stages take, with reasons: data only."""
