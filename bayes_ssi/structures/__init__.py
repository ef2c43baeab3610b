"""Structural models: each gives modes for a batch of parameter values."""
