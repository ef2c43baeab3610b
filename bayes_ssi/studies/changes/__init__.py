"""What changed between two tests of a structure: hypotheses, findings, and what was visible."""
