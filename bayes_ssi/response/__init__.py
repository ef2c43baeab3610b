"""What a structure does under a force or a ground motion."""
