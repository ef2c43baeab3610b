"""From a record to ranked model classes: how often the right class, how right its stiffnesses.

    python runs/benchmarks/end_to_end.py [--records 50] [--first 0]

The numerical study (model_classes/shear_building.py) as records: 20 minutes at 50 Hz from three
sensors on the building of Case (c) under independent loads on its floors, damping 2 %, 1 % noise;
record i has the seed i. Of each record the modes are identified by themselves, the four approaches
ranked with inferred prediction errors, and approach 3 sampled without model error, from the modes'
joint covariance.

The widths that a record allows are Cramér-Rao bounds: standard deviations of stiffness factors
inferred from the lines of the spectral matrices themselves, with any forces on the modes, as modes
are identified, or with loads that act on the three floors only, which modes cannot know of.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import beside_tests  # noqa: F401
import numpy as np
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

STUDY = load_study(Path(__file__).parents[2] / "model_classes" / "shear_building.py")
SENSORS = ("floor 1", "floor 2", "floor 3")
LABELS = ("1", "2a", "2b", "3")
FACTORS = ("k1", "k2", "k3", "ks")
BAND, DAMPING, DURATION_S = (0.6, 4.6), 0.02, 1200.0
RIGHT = "3"
CLASSES = {each.name: each for each in STUDY.model_classes}
NO_MODEL_ERROR = bs.ErrorModel(frequency_cov=1e-5, shape_sd=1e-5)
COVERED = 0.9


class Row(NamedTuple):
    """What one record gave; of stiffness factors, with inferred and without prediction errors."""

    method: str
    failed_checks: int
    probability: float
    is_first: bool
    cpu_s: float
    inferred: np.ndarray  # (4,), whether the 90 % intervals hold the true factors
    covered: np.ndarray  # (4,)
    errors: np.ndarray  # (4,), posterior mean less truth
    sds: np.ndarray  # (4,)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    rows: list[Row] = []
    others: list[str] = []
    for seed in range(options.first, options.first + options.records):
        row = from_record(seed)
        if isinstance(row, str):
            others.append(row)
            text = row
        else:
            rows.append(row)
            text = f"{row.method}, P({RIGHT}) = {row.probability:.6f}, {row.cpu_s:.1f} s"
        print(f"record {seed}: {text}", file=sys.stderr, flush=True)
    report(rows, others)


def from_record(seed: int) -> Row | str:
    """The answer to one record, or what was identified in place of four modes."""
    record = simulated_record(
        with_infill(), SENSORS, np.random.default_rng(seed), damping=DAMPING, duration_s=DURATION_S
    )
    start = time.process_time()
    identified = bs.identify(record, BAND)
    if len(identified.modes) != len(LABELS):
        return f"{len(identified.modes)} modes"
    data = identified.modal_data()
    data = replace(
        data, modes=tuple(replace(m, label=x) for m, x in zip(data.modes, LABELS, strict=True))
    )
    classes = [replaced(each, data, bs.ErrorModel()) for each in STUDY.model_classes]
    ranking = bs.rank(bs.Study(STUDY.name, classes))
    cpu_s = time.process_time() - start
    best = ranking.comparison.classes[0]
    exact = bs.sample(replaced(CLASSES[RIGHT], data, NO_MODEL_ERROR))
    inferred = next(each for each in ranking.posteriors if each.name == RIGHT)
    rows = {row.name: row for row in exact.summary}
    return Row(
        identified.method,
        len(identified.failed_checks),
        next(row.probability for row in ranking.comparison.classes if row.name == RIGHT),
        best.name == RIGHT,
        cpu_s,
        covers(inferred),
        covers(exact),
        np.array([rows[name].mean - 1.0 for name in FACTORS]),
        np.array([rows[name].sd for name in FACTORS]),
    )


def replaced(candidate: bs.ModelClass, data: bs.ModalData, error: bs.ErrorModel) -> bs.ModelClass:
    """A class of the study with other data and errors."""
    return bs.ModelClass(
        candidate.name, candidate.structure, data, error, pairing=candidate.pairing
    )


def covers(posterior: bs.Posterior) -> np.ndarray:
    """Whether the interval between the 5 and 95 % quantiles holds 1, for each factor."""
    draws = posterior.values[:, [posterior.parameter_names.index(name) for name in FACTORS]]
    low, high = np.quantile(draws, [0.5 - 0.5 * COVERED, 0.5 + 0.5 * COVERED], axis=0)
    return (low < 1.0) & (high > 1.0)


def report(rows: list[Row], others: list[str]) -> None:
    """Print what all records together say."""
    n = len(rows) + len(others)
    print(f"{len(rows)} of {n} records with four modes; others: {others or 'none'}")
    methods = [row.method for row in rows]
    print("quoted: " + ", ".join(f"{m} {methods.count(m)}" for m in dict.fromkeys(methods)))
    print(f"failed checks in {sum(row.failed_checks > 0 for row in rows)}")
    first = sum(row.is_first for row in rows)
    claimed = np.mean([row.probability for row in rows])
    print(f"approach {RIGHT} first in {first} of {len(rows)}, claimed probability {claimed:.4f}")
    print(f"CPU from record to ranking: median {np.median([r.cpu_s for r in rows]):.1f} s, "
          f"largest {max(r.cpu_s for r in rows):.1f} s")  # fmt: skip
    print(f"\n{'factor':32}" + "".join(f"{name:>8}" for name in FACTORS))
    print_row("90 % intervals cover %", 100.0 * np.mean([r.covered for r in rows], axis=0))
    print_row("the same, inferred errors", 100.0 * np.mean([r.inferred for r in rows], axis=0))
    joint = [row for row in rows if row.method == "Bayesian FFT"]
    claimed_sds = 100.0 * root_mean_square([row.sds for row in joint])
    print_row("joint errors: claimed sd %", claimed_sds)
    print_row("joint errors: actual error %", 100.0 * root_mean_square([r.errors for r in joint]))
    for forces in ("on the modes", "on the floors"):
        allowed = 100.0 * width_allowed(forces)
        print_row(f"allowed, forces {forces} %", allowed)
        print_row("claimed over that", claimed_sds / allowed)


def print_row(name: str, numbers: np.ndarray) -> None:
    print(f"{name:32}" + "".join(f"{number:8.3g}" for number in numbers))


def root_mean_square(errors: list[np.ndarray]) -> np.ndarray:
    return np.sqrt(np.mean(np.square(errors), axis=0))


def width_allowed(forces: str) -> np.ndarray:
    """Least standard deviations (4,) of the stiffness factors, from Fisher's information.

    The unknowns are the factors, all dampings, the sensors' noise, and the real and imaginary parts
    of a triangular factor of the forces' spectral matrix. Eight lines are taken together.
    """
    structure = CLASSES[RIGHT].structure
    lines = np.arange(BAND[0], BAND[1], 8.0 / DURATION_S)

    def spectra(x: np.ndarray) -> np.ndarray:
        modes = structure.modes(x[None, :4])
        frequencies, shapes = modes.frequencies_hz[0], modes.shapes[0, :3]
        shapes = shapes * np.sign(shapes[0])
        noise, parts = np.exp(x[8:11]), x[11:]
        k = 4 if forces == "on the modes" else 3
        factor = np.zeros((k, k), dtype=complex)
        factor[np.tril_indices(k)] = parts[: k * (k + 1) // 2]
        factor[np.tril_indices(k, -1)] += 1j * parts[k * (k + 1) // 2 :]
        of_forces = factor @ factor.conj().T
        if forces == "on the modes":
            shapes = shapes / np.linalg.norm(shapes, axis=0)
        else:
            of_forces = shapes.T @ of_forces @ shapes
        ratios = frequencies / lines[:, None]
        columns = shapes / (1.0 - ratios**2 - 2j * np.exp(x[4:8]) * ratios)[:, None, :]
        return columns @ of_forces @ columns.conj().transpose(0, 2, 1) + np.diag(noise)

    # Loads of unit spectral density on each floor; noise of 1 % of each sensor's motion.
    shapes = structure.modes(np.ones((1, 4))).shapes[0, :3]
    shapes = shapes * np.sign(shapes[0])
    start = np.concatenate([np.ones(4), np.full(4, np.log(DAMPING)), np.full(3, -50.0)])
    load = np.eye(3)
    if forces == "on the modes":
        shapes = shapes * np.linalg.norm(shapes, axis=0)
        load = np.linalg.cholesky(shapes.T @ shapes + 1e-6 * np.eye(4))
    k = len(load)
    x = np.concatenate([start, load[np.tril_indices(k)], np.zeros(k * (k - 1) // 2)])
    power = np.einsum("kii->i", spectra(x)).real * 8.0 / DURATION_S
    x[8:11] = np.log(1e-4 * power * 2.0 / 50.0)
    inverse, step = np.linalg.inv(spectra(x)), 1e-5
    slopes = [
        inverse @ (spectra(x + step * e) - spectra(x - step * e)) / (2.0 * step)
        for e in np.eye(len(x))
    ]
    information = np.array(
        [[8.0 * np.einsum("kij,kji->", a, b).real for b in slopes] for a in slopes]
    )
    # The loads on four modes come from three floors: one direction of their factor says nothing.
    return np.sqrt(np.linalg.pinv(information, rcond=1e-13).diagonal()[:4])


if __name__ == "__main__":
    main()
