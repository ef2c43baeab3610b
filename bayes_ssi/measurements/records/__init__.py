"""Vibration records of an ambient test, and the modes identified from them with uncertainties."""
