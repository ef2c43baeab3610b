"""Evaluation of models: in batches, in workers, and only once even if a run is interrupted."""
