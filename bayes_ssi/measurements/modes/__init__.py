"""Identified modes, and the files that hold them."""
