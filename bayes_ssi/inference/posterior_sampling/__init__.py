"""Sampling of one model class."""
