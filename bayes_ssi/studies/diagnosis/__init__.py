"""Which mistakes in the data would explain them better."""
