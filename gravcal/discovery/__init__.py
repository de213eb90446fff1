"""Discovery: what a simulation gets wrong, the cause, the extended model, the gain; works on any calibration's view."""
