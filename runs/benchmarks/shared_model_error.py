"""Do intervals hold where the model is wrong in the same way in every test?

    python runs/benchmarks/shared_model_error.py [--sets 200]

The truth is a frame of 12 storeys whose joints rotate, its columns and beams of random stiffness on
every storey. The model class is a lumped shear building, whose joints do not rotate, with three
stiffness factors for four storeys each. Modes 1, 2, 4 and 5 of three tests are identified: bare,
and with a known mass on floor 12 or on floor 6. Intervals of 90 % are then predicted of the true
frequencies of mode 3 and mode 6 in the three tests, and of modes 1 to 5 with masses on floors 3 and
9 instead.

Every set is a new truth. It is sampled with independent prediction errors, with errors correlated
between tests, and with errors correlated between tests and between successive modes, their sizes
and correlations being inferred.
"""

from __future__ import annotations

import argparse
from time import perf_counter

import numpy as np
from scipy.linalg import eigh

import bayes_ssi as bs

N = 12
TESTED: dict[str, tuple[int, ...]] = {"bare": (), "on floor 12": (12,), "on floor 6": (6,)}
UNTESTED = (3, 9)
ADDED_MASS = 0.5  # of a floor's mass, on each of these floors
IDENTIFIED = (1, 2, 4, 5)
BETWEEN, ABOVE = 3, 6  # modes that were not identified
IDENTIFICATION_COV = 0.002
BEAM_OVER_COLUMN = 4.0  # nominal second moments of area
LEVEL = 0.9
SETTINGS = bs.SamplingSettings(log_evidence_error=0.1, economical=True)

size = bs.Parameter("frequency_cov", bs.LogNormal(0.02, 1.0))
tests = bs.Parameter("between tests", bs.Uniform(0.0, 1.0))
modes = bs.Parameter("between modes", bs.Uniform(0.0, 1.0))
ERRORS = {
    "independent": bs.ErrorModel(size),
    "correlated between tests": bs.ErrorModel(size, between_tests=tests),
    "correlated between tests and modes": bs.ErrorModel(
        size, between_tests=tests, between_modes=modes
    ),
}
# Of a uniform shear building with floors of unit mass and a first frequency of 1 Hz.
STOREY = (np.pi / np.sin(np.pi / (4 * N + 2))) ** 2


def lumped(loaded: tuple[int, ...]) -> bs.ShearBuilding:
    """The structure of the model class, with masses on these floors."""
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.5)) for i in range(1, 4)]
    building = bs.ShearBuilding((1.0,) * N, [STOREY * factors[i // 4] for i in range(N)])
    for floor in loaded:
        building = building.with_element(bs.AddedMass(ADDED_MASS, ((floor, 1.0),)))
    return building


def frame_stiffness(columns: np.ndarray, beams: np.ndarray) -> np.ndarray:
    """Stiffness (N, N) along x of a frame of storeys 3 m high and two bays of 6 m.

    ``columns`` and ``beams`` (N,) are elastic moduli times second moments of area.
    """
    frame = bs.SpaceFrame(
        storey_heights=(3.0,) * N,
        x_lines=(-6.0, 0.0, 6.0),
        y_lines=(-3.0, 3.0),
        elastic_modulus=1.0,
        column_inertias_x=columns.tolist(),
        column_inertias_y=columns.tolist(),
        beam_inertias_x=beams.tolist(),
        beam_inertias_y=beams.tolist(),
        masses=(1.0,) * N,
        rotational_inertias=(1.0,) * N,
    )
    stiffness, _ = frame.matrices(np.zeros((1, 0)))
    x = [frame.degrees_of_freedom.index(f"floor {i} x") for i in range(1, N + 1)]
    return stiffness[0][np.ix_(x, x)]


def frequencies_hz(stiffness: np.ndarray, loaded: tuple[int, ...]) -> np.ndarray:
    """Frequencies (N,) of floors of unit mass, with masses on some."""
    masses = np.ones(N)
    masses[[floor - 1 for floor in loaded]] += ADDED_MASS
    return np.sqrt(eigh(stiffness, np.diag(masses), eigvals_only=True)) / (2.0 * np.pi)


# The nominal frame has a first frequency of 1 Hz, too.
COLUMN = frequencies_hz(frame_stiffness(np.ones(N), np.full(N, BEAM_OVER_COLUMN)), ())[0] ** -2


def random_frame(rng: np.random.Generator) -> np.ndarray:
    """Stiffness of a frame; its columns, and its beams, have a common factor and one each."""
    columns, beams = (
        nominal * np.exp(common * rng.standard_normal() + 0.25 * rng.standard_normal(N))
        for nominal, common in ((COLUMN, 0.2), (COLUMN * BEAM_OVER_COLUMN, 0.5))
    )
    return frame_stiffness(columns, beams)


def identified(stiffness: np.ndarray, rng: np.random.Generator) -> list[bs.Configuration]:
    """The three tests of a frame."""
    configurations = []
    for name, loaded in TESTED.items():
        exact = frequencies_hz(stiffness, loaded)
        identified_hz = exact * (1.0 + IDENTIFICATION_COV * rng.standard_normal(N))
        data = bs.ModalData(
            tuple(
                bs.IdentifiedMode(str(i), identified_hz[i - 1], frequency_cov=IDENTIFICATION_COV)
                for i in IDENTIFIED
            ),
            # The band ends halfway to the next mode.
            band_hz=(0.0, float(exact[IDENTIFIED[-1] - 1 : IDENTIFIED[-1] + 1].mean())),
        )
        pairing = {str(i): i for i in IDENTIFIED}
        configurations.append(bs.Configuration(name, lumped(loaded), data, pairing=pairing))
    return configurations


def held_out() -> list[tuple[str, str | bs.Structure, tuple[int, ...], tuple[int, ...]]]:
    """What is predicted: its name, the state, the floors with masses, and numbers of modes."""
    every = tuple(range(1, IDENTIFIED[-1] + 1))
    return [
        *((f"mode {BETWEEN} of a test", name, own, (BETWEEN,)) for name, own in TESTED.items()),
        *((f"mode {ABOVE} of a test", name, own, (ABOVE,)) for name, own in TESTED.items()),
        ("modes 1 to 5 in another state", lumped(UNTESTED), UNTESTED, every),
    ]


def intervals(seed: int, name: str) -> tuple[dict[str, list[bool]], bs.Posterior]:
    """Whether intervals of one set hold the true frequencies, by what is predicted."""
    rng = np.random.default_rng([15, seed])
    stiffness = random_frame(rng)
    candidate = bs.ModelClass(name, configurations=identified(stiffness, rng), error=ERRORS[name])
    posterior = bs.sample(candidate, seed=seed, settings=SETTINGS)
    inside: dict[str, list[bool]] = {}
    for what, state, loaded, numbers in held_out():
        labels = {str(number): number for number in numbers}
        band = bs.predict_frequencies(posterior, candidate, state, labels, seed=seed).band(LEVEL)
        exact = frequencies_hz(stiffness, loaded)[[number - 1 for number in numbers]]
        inside.setdefault(what, []).extend(((band.low < exact) & (exact < band.high)).tolist())
    return inside, posterior


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=200)
    n = parser.parse_args().sets
    for name in ERRORS:
        begun = perf_counter()
        sets = [intervals(seed, name) for seed in range(n)]
        failed = sum(bool(posterior.failed_checks) for _, posterior in sets)
        seconds = (perf_counter() - begun) / n
        print(f"errors {name} ({seconds:.1f} s a set; a check failed in {failed} of {n})")
        for row in sets[0][1].summary:
            medians = [posterior.summary for _, posterior in sets]
            own = [next(r.median for r in each if r.name == row.name) for each in medians]
            print(f"    {row.name}: median {np.median(own):.3f} in the median set")
        for what in sets[0][0]:
            shares = np.array([inside[what] for inside, _ in sets], dtype=float)
            # The sets are independent, the intervals of one set are not.
            error = shares.mean(axis=1).std() / np.sqrt(n)
            print(f"    {what}: {100 * shares.mean():.1f} ± {100 * error:.1f} % inside")


if __name__ == "__main__":
    main()
