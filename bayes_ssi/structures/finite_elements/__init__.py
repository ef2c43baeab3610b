"""Finite-element models: matrices, functions, and reduced bases."""
