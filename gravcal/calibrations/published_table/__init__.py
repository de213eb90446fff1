"""The published table of offsets, manoeuvre by manoeuvre, as measured data: what one offset does not explain."""
