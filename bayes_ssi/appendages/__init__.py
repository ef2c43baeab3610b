"""The search for hidden appendages: places, hypotheses, and what the search says."""
