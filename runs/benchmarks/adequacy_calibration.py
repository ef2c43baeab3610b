"""How often is a right model class called inadequate? Data from the class itself, inverted.

    python runs/benchmarks/adequacy_calibration.py [--sets 300] [--processes 2] [--only KIND]

Each set: parameters are drawn from the prior, modes from the likelihood (detected, missed and
spurious ones), and the class is ranked alone on them. One class in a hundred should have a p-value
below 0.01, and at most one in a hundred a hint at a mistake in the data. The kinds of classes: the
shear building with its resonant infill, error sizes given or inferred, the pairing given or
inferred; the same with two modes in the band; the steel frame in three configurations, error sizes
inferred.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import beside_tests  # noqa: F401
import numpy as np
from simulated import simulate_tests

import bayes_ssi as bs
from bayes_ssi.inference.criticism.adequacy import Adequacy
from bayes_ssi.inference.criticism.misfit import INADEQUATE

STUDIES = Path(__file__).parents[2] / "model_classes"
SETTINGS = bs.SamplingSettings(log_evidence_error=0.1, economical=True)


def shear_building(error: bs.ErrorModel | None = None) -> bs.ModelClass:
    (candidate,) = bs.load_study(STUDIES / "shear_building.py").only(["3"]).model_classes
    return replace(candidate, error=error or candidate.error)


def few_modes() -> bs.ModelClass:
    candidate = shear_building(bs.ErrorModel())
    low_modes = tuple(mode for mode in candidate.data.modes if mode.frequency_hz < 2.75)
    data = replace(candidate.data, modes=low_modes, band_hz=(0.0, 2.75))
    return bs.ModelClass("few modes", candidate.structure, data, candidate.error, pairing="any")


def steel_frame() -> bs.ModelClass:
    return bs.load_study(STUDIES / "steel_frame.py").only(["3 M1+"]).model_classes[0]


KINDS: dict[str, Callable[[], bs.ModelClass]] = {
    "shear building, errors given": shear_building,
    "shear building, errors inferred": lambda: shear_building(bs.ErrorModel()),
    "shear building, any pairing": lambda: shear_building(bs.ErrorModel()).with_any_pairing("any"),
    "shear building, few modes": few_modes,
    "steel frame": steel_frame,
}


def adequacy_of_a_right_class(kind: str, seed: int) -> Adequacy | None:
    rng = np.random.default_rng([15, seed])
    truth = KINDS[kind]()
    _, tests = simulate_tests(truth, rng)
    configurations = [
        replace(c, data=data, pairing=c.pairing if c.pairing == "any" else pairing)
        for c, (data, pairing) in zip(truth.configurations, tests, strict=True)
    ]
    candidate = replace(truth, configurations=configurations)
    return bs.rank(bs.Study(kind, [candidate]), seed, SETTINGS).posteriors[0].adequacy


def report(kind: str, results: list[Adequacy]) -> None:
    failed = sum(not result.is_adequate for result in results)
    hinted = sum(bool(result.hints) for result in results)
    p = np.array([result.overall.p_value for result in results])
    shares = ", ".join(f"{(p < limit).mean():.3f} below {limit:g}" for limit in (0.5, 0.1, 0.05))
    print(
        f"{kind}: {failed} of {len(p)} right classes fail, {(p < INADEQUATE).sum()} with p "
        f"below {INADEQUATE:g}, {hinted} with a hint at a mistake; p-values: {shares}",
        flush=True,
    )
    for hint in (hint for result in results for hint in result.hints):
        print(f"    {hint.mistake}, gain {hint.gain:.1f}, p = {hint.misfit.p_value:.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", choices=list(KINDS), help="one kind of class")
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.processes) as pool:
        for kind in [arguments.only] if arguments.only else KINDS:
            seeds = range(arguments.sets)
            report(kind, list(pool.map(partial(adequacy_of_a_right_class, kind), seeds)))


if __name__ == "__main__":
    main()
