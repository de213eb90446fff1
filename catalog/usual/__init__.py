"""How long things usually take: data only."""
