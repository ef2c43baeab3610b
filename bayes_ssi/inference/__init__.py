"""From modes and a structure to the posterior of a model class."""
