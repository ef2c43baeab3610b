"""Which places of a light damper do the data tell apart, and what do they determine?

    python runs/benchmarks/light_dampers.py [--sets 9] [--processes 2] [--prior uniform]

A simply supported beam, its mass lumped at nine points, with a damper at every point in turn: 0.2
to 5 % of the modal mass, evenly in the logarithm, within 3 % of one of the first two frequencies
in which its point moves. ``--sets`` data sets for each point, of modes drawn from the likelihood at
five sensors, are searched with at most one appendage. Prints how often the true point is among
those that the data leave with 95 %, how often it would be by the probabilities under the search's
prior of the mass, and how often the 90 % interval of the effective mass holds the true one. With
``--prior heavy`` that prior is lognormal with median 5 % and c.o.v. 1, under which most of these
dampers are too light.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import beside_tests  # noqa: F401
import numpy as np
from simulated import IdentificationErrors, simulate

import bayes_ssi as bs
from bayes_ssi.studies.appendages.appendage_search import credible
from bayes_ssi.studies.appendages.candidates import places_of

POINTS, LENGTH, MASS, RIGIDITY = 9, 10.0, 100.0, 2.0e6
LABELS = tuple(f"point {i}" for i in range(1, POINTS + 1))
SENSORS = LABELS[::2]
BAND_HZ = (0.0, 14.0)
SETTINGS = bs.SamplingSettings(log_evidence_error=0.2)
PRIORS = {"uniform": bs.SearchSettings().mass_ratio, "heavy": bs.LogNormal(0.05, 1.0)}


class Task(NamedTuple):
    point: int
    index: int
    prior: str


class Outcome(NamedTuple):
    left_by_data: bool
    n_left: int
    left_by_prior: bool
    in_interval: bool


@cache
def beam() -> bs.ModelClass:
    """The beam by its flexibility, u(x) = b x (L² - b² - x²)/(6 EI L) for x <= a, b = L - a."""
    x = LENGTH * np.arange(1, POINTS + 1) / (POINTS + 1)
    b = LENGTH - np.maximum.outer(x, x)
    near = np.minimum.outer(x, x)
    flexibility = b * near * (LENGTH**2 - b**2 - near**2) / (6.0 * RIGIDITY * LENGTH)
    factor = bs.Parameter("stiffness factor", bs.LogNormal(1.0, 0.1))
    structure = bs.MatrixStructure(
        [(factor, np.linalg.inv(flexibility))], MASS * np.eye(POINTS), labels=LABELS, n_modes=4
    )
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0, (1.0,) * len(SENSORS)),), BAND_HZ, SENSORS)
    error = bs.ErrorModel(frequency_cov=0.002, shape_sd=0.01)
    return bs.ModelClass("beam", structure, data, error, pairing="any")


def one(task: Task) -> Outcome:
    rng = np.random.default_rng([41, task.point, task.index])
    baseline = beam()
    candidates = [bs.Candidate(label, label) for label in LABELS]
    place = places_of(candidates)[task.point]
    modes = baseline.structure.modes(np.ones((1, 1)))
    shapes = modes.shapes[0][:, :2]  # at unit modal mass
    moving = [j for j in range(2) if abs(shapes[task.point, j]) > 0.1 * np.abs(shapes[:, j]).max()]
    mode = int(rng.choice(moving))
    largest = np.abs(baseline.structure.sensor_matrix(SENSORS).apply(modes.shapes)[0]).max(axis=0)
    modal_mass = largest[mode] ** -2
    mass = float(modal_mass * np.exp(rng.uniform(np.log(0.002), np.log(0.05))))
    hz = float(modes.frequencies_hz[0, mode] * rng.uniform(0.97, 1.03))
    damper = bs.Pendulum(on=LABELS[task.point], mass=mass, frequency=hz, label="damper")
    test = baseline.configuration()
    with_damper = replace(test, structure=baseline.structure.with_element(damper))
    carrying = replace(baseline, configurations=[with_damper])
    _, data, _ = simulate(carrying, rng, IdentificationErrors(0.002, 0.01))
    searched = replace(baseline, configurations=[replace(test, data=data)])
    options = bs.SearchSettings(
        mass_ratio=PRIORS[task.prior], number_weights=(1.0, 1.0), most_sampled=1
    )
    record = bs.search(searched, options, task.index, SETTINGS, candidates=candidates).record
    (matched,) = record.matched
    left = [each.place for each in matched.places_by_data]
    by_prior = credible(matched.places, [each.probability for each in matched.places])
    # The motion of a place does not depend on the one factor of all stiffnesses.
    true = mass * shapes[task.point, matched.mode - 1] ** 2 if matched.mode <= 2 else 0.0
    low, _, high = matched.effective_ratio
    return Outcome(
        place in left, len(left), place in [each.place for each in by_prior], low <= true <= high
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=9, help="for each of nine points")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--prior", choices=PRIORS, default="uniform")
    options = parser.parse_args()
    tasks = [Task(p, i, options.prior) for p in range(POINTS) for i in range(options.sets)]
    with ProcessPoolExecutor(options.processes) as pool:
        outcomes = list(pool.map(one, tasks))
    for point in range(POINTS):
        own = [each for task, each in zip(tasks, outcomes, strict=True) if task.point == point]
        print(
            f"{LABELS[point]}: left by the data in {sum(each.left_by_data for each in own)} of "
            f"{len(own)}, among {np.mean([each.n_left for each in own]):.1f} on average; by the "
            f"prior in {sum(each.left_by_prior for each in own)}; effective mass within its 90 % "
            f"interval in {sum(each.in_interval for each in own)}"
        )
    n = len(outcomes)
    print(
        f"all: left by the data {sum(each.left_by_data for each in outcomes)} of {n}, by the prior "
        f"{sum(each.left_by_prior for each in outcomes)}, effective mass "
        f"{sum(each.in_interval for each in outcomes)}"
    )


if __name__ == "__main__":
    main()
