"""How well a posterior explains the data, and where it lies at an edge."""
