"""Scale and bias of a tilt meter on a turntable, as a calibration of gravcal that lives outside of it."""
