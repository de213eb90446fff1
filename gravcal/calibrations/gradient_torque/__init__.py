"""Gravity-gradient torque, and drag from one or two sensors (S-GRS paper, corrected; equations.md section 5)."""
