"""The response of a structure to a force or a ground motion, by modal superposition."""
