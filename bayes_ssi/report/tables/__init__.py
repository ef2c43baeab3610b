"""Results as tables for a terminal, and the notes below them."""
