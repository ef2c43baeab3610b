"""Several model classes: sampled, compared, averaged over, searched for."""
