"""Delays of sensors, from the phases of the modes: -2π f τ of a sensor late by τ, at every mode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.explained_band import Explained

# One mode's phases could be its own; delays are common to several.
FEWEST_MODES = 2
# Delays that are sought, over half a period of the root mean square frequency.
SOUGHT = np.linspace(-0.5, 0.5, 2001)


def delays(bands: Sequence[Explained], n_sensors: int) -> FloatArray | None:
    """Delays (n,) in s that the phases of modes have in common; None where few have phases.

    Least squares of the phases, weighted by squared components, of modes and sensors in turn; the
    median sensor is on time.
    """
    doubled, omega = [], []
    for band in bands:
        if band.fit.has_phases and band.is_wanted:
            doubled += list(band.modes.shapes.T**2)
            omega += (2.0 * np.pi * band.fit.modes.frequencies_hz).tolist()
    if len(omega) < FEWEST_MODES:
        return None
    squares, angular = np.array(doubled), np.array(omega)[:, None]
    candidates = SOUGHT * np.pi / np.sqrt((angular**2).mean())
    seconds = np.zeros(n_sensors)
    for _ in range(20):
        modes = (squares * np.exp(2j * angular * seconds)).sum(1, keepdims=True)
        turned = squares * np.conj(modes / np.abs(modes))
        seconds = candidates[(turned.T @ np.exp(2j * angular * candidates)).real.argmax(1)]
        seconds = seconds - np.median(seconds)
    return seconds
