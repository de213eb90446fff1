"""Simulators: invented events whose truth is known."""
