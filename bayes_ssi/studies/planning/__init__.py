"""Planning of tests: which sensors, in which configuration, would answer the question."""
