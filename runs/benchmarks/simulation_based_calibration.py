"""Is the whole chain calibrated? Data drawn from the prior of the study's structures, inverted.

    python runs/benchmarks/simulation_based_calibration.py [--sets 300] [--processes 2]

Each set: one of the two structures of the shear building study (infill as mass, infill with its
own degree of freedom) is chosen with equal probability, parameters are drawn from the prior, and
modes are drawn from the likelihood itself: each model mode in the band is identified with the
detection probability, with frequency and shape errors, and spurious modes are added. Both
structures are then sampled on that data with the pairing that was drawn. If everything is right,
the ranks of the true parameters among posterior draws are uniform, 50 % and 90 % intervals hold
that share of the true values, and the true structure gets, on average, the probability that is
stated for it.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chisquare
from simulated import print_bands, simulate

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

STUDY = Path(__file__).parents[2] / "model_classes" / "shear_building.py"
NAMES = {"infill as mass": "1-a", "resonant infill": "3"}
N_BINS = 10


class Inverted(NamedTuple):
    """One data set: which structure is true, the ranks of its parameters, and its probability."""

    truth: str
    ranks: dict[str, float]
    probability_of_truth: float
    failed_checks: tuple[str, ...]


def invert(seed: int) -> Inverted:
    """Draw one data set and sample both structures on it."""
    rng = np.random.default_rng([7, seed])
    study = load_study(STUDY).only(list(NAMES.values()))
    by_name = dict(zip(NAMES, study.model_classes, strict=True))
    truth = list(NAMES)[rng.integers(2)]
    values, data, pairing = simulate(by_name[truth], rng)
    posteriors = [
        bs.sample(bs.ModelClass(name, c.structure, data, c.error, pairing=pairing), seed=seed)
        for name, c in by_name.items()
        if max(pairing.values(), default=0) <= c.structure.n_modes
    ]
    comparison = bs.compare(posteriors)
    ranked = {row.name: row for row in comparison.classes}
    (posterior,) = (p for p in posteriors if p.name == truth)
    ranks = (posterior.values < values).mean(axis=0)
    return Inverted(
        truth,
        dict(zip(posterior.parameter_names, ranks.tolist(), strict=True)),
        ranked[truth].probability,
        comparison.failed_checks,
    )


def report(results: list[Inverted]) -> None:
    for truth in NAMES:
        own = [result for result in results if result.truth == truth]
        for name in own[0].ranks:
            ranks = np.array([result.ranks[name] for result in own])
            counts = np.histogram(ranks, bins=N_BINS, range=(0, 1))[0]
            within = [np.abs(ranks - 0.5) < 0.5 * share for share in (0.5, 0.9)]
            print(
                f"{truth:16s} {name}: ranks uniform with p = {chisquare(counts).pvalue:.3f}; the "
                f"50 % interval holds {within[0].mean():.2f}, the 90 % interval "
                f"{within[1].mean():.2f} of {len(own)}"
            )
    probabilities = np.array([result.probability_of_truth for result in results])
    # Of all statements "structure S has probability p", true and false ones, in bands of p.
    stated = np.concatenate([probabilities, 1.0 - probabilities])
    right = np.concatenate([np.ones(len(results), bool), np.zeros(len(results), bool)])
    print_bands(stated, right, (0.0, 0.05, 0.3, 0.7, 0.95, 1.0))
    flagged = [result for result in results if result.failed_checks]
    print(f"{len(flagged)} of {len(results)} sets with a failed check")
    for check in {check for result in flagged for check in result.failed_checks}:
        print(f"    {check}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.processes) as pool:
        report(list(pool.map(invert, range(options.sets))))


if __name__ == "__main__":
    main()
