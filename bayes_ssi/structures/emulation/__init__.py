"""Emulators of structures that take long."""
