"""Phase centres of a pair from routine pointing: ranging against orbits on a day without wiggles."""
