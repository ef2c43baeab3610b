"""Updating one model class: calibration, posterior, checks, and modes before and after."""
