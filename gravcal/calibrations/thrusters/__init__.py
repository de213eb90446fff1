"""Attitude thrusters: impulse gain about each axis and delay of the firings, from star camera and THR1B of a day."""
