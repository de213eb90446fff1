"""A routine day forward: what an accelerometer reads of firings and currents; the flow composes the rest."""
