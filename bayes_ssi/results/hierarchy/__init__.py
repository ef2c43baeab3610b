"""Many tests of one structure: parameters that are the same, vary, or follow a covariate."""
