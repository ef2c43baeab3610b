"""The sampling engine: from a log-likelihood to draws of its posterior and its evidence."""
