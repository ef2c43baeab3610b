"""Is the search for appendages calibrated, and how often does it raise a false alarm?

    python runs/benchmarks/search_calibration.py [--sets 100] [--processes 2] [--all]

Simulates ``--sets`` data sets of a three-storey building with one appendage, whose place, mass and
frequency are drawn from the search's own priors, and as many without: storey stiffnesses from their
priors, modes from the likelihood itself (errors of frequencies and shapes, missed and spurious
modes). Each is searched over all seven hypotheses of at most one appendage. If everything is
right, hypotheses with a stated probability p are true in a share p of the cases.

With ``--all``, every hypothesis is sampled, and the errors of all approximate evidences are
printed; else of those that the search chooses to sample.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import beta
from simulated import print_bands, simulate

import bayes_ssi as bs
from bayes_ssi.appendages.appendage_search import search
from bayes_ssi.appendages.candidates import default_candidates
from bayes_ssi.appendages.hypotheses import SearchSettings, hypothesis
from bayes_ssi.appendages.places import AppendagePlace, places_of
from bayes_ssi.ranking.study_file import load_study

STUDY = Path(__file__).parents[2] / "model_classes" / "bare_building.py"
# Stated in full: the default prior of the frequency follows from the data.
SETTINGS = SearchSettings(frequency=bs.LogUniform(0.5, 6.0), number_weights=(1.0, 1.0))
ALARM = 0.9
NEAR = 0.1


class Searched(NamedTuple):
    """One data set: the true place, each hypothesis's probability, and the distance to resonance.

    ``detuning`` is the relative distance of the appendage's frequency from the nearest mode of the
    building without it; NaN without appendage. ``errors`` are those of Laplace's approximation and
    of screening, in nats, for every hypothesis that was sampled.
    """

    truth: str
    probabilities: dict[str, float]
    detuning: float
    failed_checks: tuple[str, ...]
    errors: tuple[tuple[float, float], ...]


def one(task: tuple[int, bool, bool]) -> Searched:
    """Draw one data set and search it."""
    index, with_appendage, all_sampled = task
    rng = np.random.default_rng([11, index, with_appendage])
    (baseline,) = load_study(STUDY).model_classes
    candidates = places_of(default_candidates(baseline.structure, baseline.data.sensors))
    places: tuple[AppendagePlace, ...] = ()
    if with_appendage:
        places = (candidates[rng.integers(len(candidates))],)
    truth = hypothesis(baseline, places, SETTINGS)
    values, data, _ = simulate(truth, rng)
    detuning = float("nan")
    if places:
        bare = baseline.structure.modes(values[None, : len(baseline.structure.parameters)])
        column = truth.parameter_names.index(f"frequency, {places[0].name}")
        detuning = float(np.abs(values[column] / bare.frequencies_hz[0] - 1.0).min())
    result = search(
        replace(baseline, data=data),
        replace(SETTINGS, most_unsampled=0.0) if all_sampled else SETTINGS,
        index,
        bs.SamplingSettings(log_evidence_error=0.03),
    )
    rows = result.record.hypotheses
    errors = tuple(
        (row.laplace - row.log_evidence, row.screened - row.log_evidence)
        for row in rows
        if row.is_sampled
    )
    probabilities = {row.name: row.probability for row in rows}
    failed_checks = result.ranking.comparison.failed_checks
    return Searched(truth.name, probabilities, detuning, failed_checks, errors)


def report(results: list[Searched]) -> None:
    with_one = [result for result in results if not np.isnan(result.detuning)]
    without = [result for result in results if np.isnan(result.detuning)]
    stated = np.array([p for result in results for p in result.probabilities.values()])
    right = np.array([n == result.truth for result in results for n in result.probabilities])
    print(f"All hypotheses of {len(results)} data sets:")
    print_bands(stated, right, (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0))
    best = np.array([max(result.probabilities.values()) for result in results])
    hit = np.array([max(r.probabilities, key=r.probabilities.get) == r.truth for r in results])
    print("The most probable hypothesis of each:")
    print_bands(best, hit, (0.0, 0.2, 0.4, 0.6, 0.8, 1.0))
    alarms = sum(1.0 - result.probabilities["no appendage"] > ALARM for result in without)
    clear = len(without) - alarms
    low, high = beta.ppf([0.025, 0.975], [alarms, alarms + 1], [clear + 1, clear])
    print(
        f"False alarms, an appendage stated with more than {ALARM} where there is none: {alarms} "
        f"of {len(without)} (95 % interval {np.nan_to_num(low):.3f} to {high:.3f})"
    )
    for where, own in (
        (f"within {NEAR:.0%} of a mode's frequency", [r for r in with_one if r.detuning < NEAR]),
        ("elsewhere", [r for r in with_one if r.detuning >= NEAR]),
    ):
        first = sum(max(r.probabilities, key=r.probabilities.get) == r.truth for r in own)
        seen = sum(1.0 - r.probabilities["no appendage"] > ALARM for r in own)
        places = [{k: p for k, p in r.probabilities.items() if k != "no appendage"} for r in own]
        place = sum(max(p, key=p.get) == r.truth for p, r in zip(places, own, strict=True))
        print(
            f"Appendages {where}: {len(own)}; true hypothesis first {first}, true place first "
            f"among places {place}, an appendage stated with more than {ALARM} {seen}"
        )
    errors = np.array([error for result in results for error in result.errors])
    for name, own in zip(("Laplace", "Screened"), errors.T, strict=True):
        low, middle, high = np.quantile(own, [0.05, 0.5, 0.95])
        print(
            f"{name} less sampled log evidence, {len(own)} hypotheses: median {middle:.2f}, 90 % "
            f"from {low:.2f} to {high:.2f}, all from {own.min():.2f} to {own.max():.2f} nats"
        )
    flagged = [result for result in results if result.failed_checks]
    print(f"{len(flagged)} of {len(results)} sets with a failed check")
    for check in sorted({check for result in flagged for check in result.failed_checks}):
        print(f"    {check}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=100, help="with an appendage, and without")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--all", action="store_true", help="sample every hypothesis")
    options = parser.parse_args()
    tasks = [(i, truth, options.all) for i in range(options.sets) for truth in (False, True)]
    with ProcessPoolExecutor(options.processes) as pool:
        report(list(pool.map(one, tasks)))


if __name__ == "__main__":
    main()
