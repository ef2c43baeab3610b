"""Vibration records simulated from a structure: independent loads on its floors, or ground motion.

White noise, linear between the samples of a rate four times that of the record, drives every mode
from rest; what comes first is left out, until the beginning is forgotten. The record is decimated
as measuring systems do, and every sensor has white noise of its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import decimate

import bayes_ssi as bs
from bayes_ssi.structures.response import modal_histories

FINER = 4
N_STOREYS = 3
STIFFNESS = (math.pi / math.sin(math.pi / (2 * (2 * N_STOREYS + 1)))) ** 2
SECOND_FREQUENCY = math.sin(3 * math.pi / 14) / math.sin(math.pi / 14)
FRAME = bs.ShearBuilding(masses=(1.0,) * N_STOREYS, stiffnesses=(STIFFNESS,) * N_STOREYS)


def with_infill(frequency_hz: float = SECOND_FREQUENCY, mass: float = 0.15) -> bs.Structure:
    """The building of Case (c), whose infill of the first storey resonates with its second mode."""
    return FRAME.with_element(
        bs.OutOfPlaneInfill(between=(1, 2), mass=mass, frequency=frequency_hz)
    )


class Truth(NamedTuple):
    """What a simulated record should be identified as.

    Attributes:
        frequencies_hz: (m,).
        dampings: (m,).
        shapes: (n, m), at unit length.
    """

    frequencies_hz: np.ndarray
    dampings: np.ndarray
    shapes: np.ndarray

    def within(self, band_hz: tuple[float, float]) -> Truth:
        """The modes of a band."""
        low, high = band_hz
        kept = (self.frequencies_hz > low) & (self.frequencies_hz < high)
        return Truth(self.frequencies_hz[kept], self.dampings[kept], self.shapes[:, kept])


def truth_of(structure: bs.Structure, sensors: tuple[str, ...], damping: float) -> Truth:
    """The modes of a structure without parameters, at sensors."""
    modes = structure.modes(np.empty((1, 0)))
    shapes = structure.sensor_matrix(sensors).apply(modes.shapes)[0]
    frequencies = modes.frequencies_hz[0]
    return Truth(
        frequencies, np.full(len(frequencies), damping), shapes / np.linalg.norm(shapes, axis=0)
    )


def simulated_record(
    structure: bs.Structure,
    sensors: tuple[str, ...],
    rng: np.random.Generator,
    *,
    ground: bool = False,
    damping: float = 0.02,
    duration_s: float = 1200.0,
    rate_hz: float = 50.0,
    noise: float = 0.01,
) -> bs.Record:
    """Accelerations: absolute ones under ground motion, or under loads at every sensor.

    Args:
        structure: without parameters.
        sensors: their labels.
        rng: of loads and noise.
        ground: whether the ground moves, rather than loads act at the sensors.
        damping: of every mode.
        duration_s: of the record.
        rate_hz: of the record.
        noise: root mean square of each sensor's own noise over that of what it measures.
    """
    model = structure.modal_model(np.empty((1, 0)))
    matrix = structure.sensor_matrix(sensors)
    at_sensors = matrix.apply(model.shapes)[0]
    omega = 2.0 * np.pi * model.frequencies_hz
    damped = omega * math.sqrt(1.0 - damping**2)
    poles = -damping * omega + 1j * damped
    n_left_out = math.ceil(10.0 / (damping * omega.min()) * rate_hz)
    n_fine = FINER * (n_left_out + round(duration_s * rate_hz))
    samples = np.zeros((len(sensors), n_fine))
    # Modal forces: those of the ground's acceleration, or of each load.
    if ground:
        driven = [-model.participation[0]]
        direct = [matrix.apply(model.influence[None, :, None])[0, :, 0] + at_sensors @ driven[0]]
    else:
        driven = list(at_sensors)
        direct = [at_sensors @ forces for forces in driven]
    for forces, immediately in zip(driven, direct, strict=True):
        load = rng.standard_normal(n_fine)
        # q̈ = Im(λ² s)/ω_d + f for a mode driven by f, s' = λ s + f.
        factors = forces * poles**2 / damped
        for histories in modal_histories(poles, factors, load, 1.0 / (FINER * rate_hz)):
            samples += at_sensors @ histories[:-1] + immediately[:, None] * load
    slow = decimate(samples, FINER, ftype="fir", axis=1)[:, n_left_out:]
    slow += noise * slow.std(axis=1, keepdims=True) * rng.standard_normal(slow.shape)
    return bs.Record(slow, rate_hz, sensors, "acceleration", "m/s2")
