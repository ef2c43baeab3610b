"""The search for hidden appendages: places, hypotheses and findings."""
