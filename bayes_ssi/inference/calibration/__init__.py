"""Deterministic calibration: every distinct minimum of the paper's objective."""
