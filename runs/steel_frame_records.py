"""Ambient records of the paper's steel frame in its three configurations. SIMULATED."""

import runpy
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bayes_ssi as bs
from bayes_ssi.ranking.study_file import load_study

HERE = Path(__file__).parent
STUDY = HERE.parent / "model_classes" / "steel_frame.py"
BEST = runpy.run_path(str(HERE / "make_steel_frame.py"))["BEST"]
# Corners and a side's middle of each floor, and the braces: 15 channels, as many as in the paper,
# which does not say where.
PLACES = {"NE": (2.0, 1.5), "SW": (-2.0, -1.5), "NW": (-2.0, 1.5)}
SENSORS = tuple(
    bs.floor_sensor(f"floor {floor} {name} {direction}", floor, at, direction)
    for floor in (1, 2)
    for name, at in PLACES.items()
    for direction in ("x", "y")
) + tuple(
    bs.floor_sensor(f"floor {floor} E {direction}", floor, (2.0, 0.0), direction)
    for floor, direction in ((1, "y"), (2, "x"), (2, "y"))
)
RATE_HZ, MINUTES, NOISE, DAMPINGS = 100.0, (15.0, 20.0), 0.02, (0.01, 0.02)
BAND_HZ = (2.0, 24.0)


class Simulated(NamedTuple):
    """A record, its band, and the modes that it holds, at its sensors at unit length."""

    record: bs.Record
    band_hz: tuple[float, float]
    frequencies_hz: np.ndarray
    dampings: np.ndarray
    shapes: np.ndarray


def simulated(name: str, n_sensors: int, rng: np.random.Generator) -> Simulated:
    """A stationary record of one configuration: white loads on all masses, noise of 2 %."""
    augmented = load_study(STUDY).only(["3 M3+"]).model_classes[0]
    structure = augmented.configuration(name).structure
    own = tuple(sensor.label for sensor in structure.sensors)
    structure = structure.with_sensors([each for each in SENSORS if each.label not in own])
    names = (*own, *(each.label for each in SENSORS if each.label not in own))[:n_sensors]
    values = np.array([[BEST[parameter.name] for parameter in structure.parameters]])
    frequencies_hz, shapes = structure.modes(values)
    f = frequencies_hz[0]
    at_sensors = structure.sensor_matrix(names).apply(shapes)[0]
    dampings = rng.uniform(*DAMPINGS, len(f))
    # Shapes have unit modal mass: forces of unit variance on each degree of freedom.
    loads = shapes[0] * rng.uniform(0.5, 1.5, (len(shapes[0]), 1)) * 60.0
    n = int(60.0 * rng.uniform(*MINUTES) * RATE_HZ)
    period = 2 * (3 * n // 4)
    at_hz = np.fft.rfftfreq(period, 1.0 / RATE_HZ)[1:]
    lines = np.zeros((len(names), len(at_hz) + 1), dtype=complex)
    forces = loads.T @ (rng.standard_normal((2, len(loads), len(at_hz))).T @ (1.0, 1j)).T
    for i in range(len(f)):
        ratio = f[i] / at_hz
        response = forces[i] / (1.0 - ratio**2 - 2j * dampings[i] * ratio)
        lines[:, 1:] += at_sensors[:, i, None] * response
    samples = np.fft.irfft(lines, period)[:, :n]
    samples += NOISE * samples.std(1, keepdims=True) * rng.standard_normal(samples.shape)
    record = bs.Record(samples, RATE_HZ, names, "acceleration", "m/s2")
    inside = (f > BAND_HZ[0]) & (f < BAND_HZ[1])
    unit = at_sensors / np.linalg.norm(at_sensors, axis=0)
    return Simulated(record, BAND_HZ, f[inside], dampings[inside], unit[:, inside])
