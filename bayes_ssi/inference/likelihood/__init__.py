"""How identified modes come from the modes of a model: errors, pairing, likelihood."""
