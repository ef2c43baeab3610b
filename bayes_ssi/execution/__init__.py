"""Evaluating a model: in batches, in workers, and once only, even if a run is stopped."""
