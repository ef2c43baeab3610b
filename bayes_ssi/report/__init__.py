"""A stored result as one self-contained HTML page."""
