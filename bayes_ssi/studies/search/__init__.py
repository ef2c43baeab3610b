"""The search through a family of hypotheses: with how much effort, in which order, how far."""
