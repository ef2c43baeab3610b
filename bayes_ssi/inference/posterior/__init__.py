"""One model class sampled: its posterior, evidence and checks, and modes before and after."""
