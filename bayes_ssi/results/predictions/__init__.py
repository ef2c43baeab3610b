"""Predictions from posterior draws, with credible bands; nothing is sampled."""
