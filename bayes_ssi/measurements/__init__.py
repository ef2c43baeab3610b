"""What was measured: modes, and the records that they are identified from."""
