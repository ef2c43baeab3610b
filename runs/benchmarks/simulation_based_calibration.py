"""Is the whole chain calibrated? Data drawn from priors and likelihoods of studies, inverted.

    python runs/benchmarks/simulation_based_calibration.py FILE [--sets 0:300] [--only STUDY]
    python runs/benchmarks/simulation_based_calibration.py FILE --summary

Each set: parameters are drawn from the prior, and modes from the likelihood itself: each model mode
in the band is identified with the detection probability, with frequency and shape errors, close
ones turned, and spurious modes are added. The class is sampled on that data, with the pairing that
was drawn or any. If everything is right, the ranks of the true parameters, and of their
log-likelihood, among quoted posterior draws are uniform, and 50 % and 90 % intervals hold that
share of the true values. Draws of a chain depend on one another, so ranks are those among 99 draws,
spread evenly over all chains: a few per cent of the effective sample size, which is stated.

Studies: the shear building, of whose two structures (infill as mass, infill with its own degree of
freedom) one is chosen, and both are sampled, so that the true one has, on average, the probability
that is stated for it; the same with any pairing, whose posteriors have separate regions; the
four-storey frame with a factor a storey and inferred errors; and the steel frame in three
configurations. Results are appended to FILE as lines of JSON, so that calls share the sets.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time

import beside_tests  # noqa: F401
import numpy as np
import quoted_draws
from quoted_draws import Run
from scipy.stats import chisquare, kstest
from simulated import print_bands, simulate_tests

import bayes_ssi as bs

STUDIES = Path(__file__).parents[2] / "model_classes"
N_RANKED, N_BINS = 99, 20


def classes(study: str, *names: str) -> list[bs.ModelClass]:
    return list(bs.load_study(STUDIES / f"{study}.py").only(list(names)).model_classes)


CASES: dict[str, Callable[[], list[bs.ModelClass]]] = {
    "shear building": lambda: classes("shear_building", "1-a", "3"),
    "any pairing": lambda: [classes("shear_building", "3")[0].with_any_pairing("3, any pairing")],
    "errors inferred": lambda: classes("four_storey_frame", "each storey, free errors"),
    "three tests": lambda: classes("steel_frame", "3 M1+"),
}


def invert(case: str, index: int) -> Run:
    """Draw one data set and sample its classes on it."""
    rng = np.random.default_rng([7, index])
    candidates = CASES[case]()
    truth = candidates[rng.integers(len(candidates))] if len(candidates) > 1 else candidates[0]
    values, tests = simulate_tests(truth, rng)
    begun, posteriors = process_time(), []
    for candidate in candidates:
        largest = max((max(pairing.values(), default=0) for _, pairing in tests), default=0)
        if largest > candidate.configurations[0].structure.n_modes:
            continue  # it does not have the modes that were identified
        configurations = tuple(
            replace(c, data=data, pairing=c.pairing if c.pairing == "any" else pairing)
            for c, (data, pairing) in zip(candidate.configurations, tests, strict=True)
        )
        on_data = replace(candidate, configurations=configurations)
        with quoted_draws.watching_emcee() as steps_of_emcee:
            posteriors.append(bs.sample(on_data, index))
            if candidate is truth:
                shape, steps, true_class = len(values), steps_of_emcee(), on_data
    seconds = process_time() - begun
    (posterior,) = (each for each in posteriors if each.name == truth.name)
    ways = [true_class.values(s.reshape(-1, shape)).reshape(s.shape) for s in steps]
    comparison = bs.compare(posteriors)
    (probability,) = (r.probability for r in comparison.classes if r.name == truth.name)
    quantities = {
        **dict(zip(posterior.parameter_names, posterior.values.T, strict=True)),
        "log-likelihood": posterior.log_likelihoods.ravel(),
    }
    true_values = [*values, float(true_class.log_likelihood(values[None])[0])]
    return {
        "case": case,
        "set": index,
        "truth": truth.name,
        "ranks": {
            name: rank(draws, true, rng)
            for (name, draws), true in zip(quantities.items(), true_values, strict=True)
        },
        "below": {
            name: float((draws < true).mean())
            for (name, draws), true in zip(quantities.items(), true_values, strict=True)
        },
        "probability": probability,
        "regions": len(posterior.regions),
        "seconds": seconds,
        "emcee": quoted_draws.share_of_emcee(posterior.draws, ways),
        **quoted_draws.diagnostics(posterior.draws),
        "failed_checks": sorted({c for each in posteriors for c in each.failed_checks}),
    }


def rank(draws: np.ndarray, true: float, rng: np.random.Generator) -> int:
    """Of the true value among draws that are spread evenly over all; ties by chance."""
    spacing = len(draws) / N_RANKED
    chosen = draws[((np.arange(N_RANKED) + rng.random()) * spacing).astype(int)]
    equal = int((chosen == true).sum())
    return int((chosen < true).sum()) + int(rng.integers(equal + 1))


def summary(by_case: dict[str, list[Run]]) -> None:
    p_values = []
    for case, own in by_case.items():
        print(
            f"{case}: {len(own)} sets, {sum(run['seconds'] for run in own):.0f} s, several regions "
            f"in {sum(run['regions'] > 1 for run in own)}; {quoted_draws.quality(own)}"
        )
        for truth in sorted({run["truth"] for run in own}):
            of_truth = [run for run in own if run["truth"] == truth]
            for name in of_truth[0]["ranks"]:
                p_values.append(uniformity(truth, name, of_truth))
        probabilities = np.array([run["probability"] for run in own])
        if (probabilities < 1.0).any():
            # Of all statements "structure S has probability p", true and false ones, in bands of p.
            stated = np.concatenate([probabilities, 1.0 - probabilities])
            right = np.arange(len(stated)) < len(own)
            print_bands(stated, right, (0.0, 0.05, 0.3, 0.7, 0.95, 1.0))
        flagged = [run for run in own if run["failed_checks"]]
        print(f"{len(flagged)} of {len(own)} sets with a failed check")
        for check in sorted({check for run in flagged for check in run["failed_checks"]}):
            print(f"    {check}")
    smallest = min(p_values)
    print(
        f"{len(p_values)} tests of ranks: smallest p = {smallest:.4f}, of so many the smallest is "
        f"below that with a probability of {1.0 - (1.0 - smallest) ** len(p_values):.2f}"
    )


def uniformity(truth: str, name: str, runs: list[Run]) -> float:
    ranks = np.array([run["ranks"][name] for run in runs])
    counts = np.bincount(ranks * N_BINS // (N_RANKED + 1), minlength=N_BINS)
    p = float(chisquare(counts).pvalue)
    jittered = (ranks + np.random.default_rng(0).random(len(ranks))) / (N_RANKED + 1)
    below = np.array([run["below"][name] for run in runs])
    held = [np.mean(np.abs(below - 0.5) < 0.5 * share) for share in (0.5, 0.9)]
    print(
        f"  {truth:28s} {name:16s} ranks uniform with p = {p:.3f} (chi squared), "
        f"{kstest(jittered, 'uniform').pvalue:.3f} (Kolmogorov-Smirnov); intervals of 50 and 90 % "
        f"hold {held[0]:.2f} and {held[1]:.2f} of {len(runs)}"
    )
    return p


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--sets", default="0:300", help="first:last + 1")
    parser.add_argument("--only", choices=tuple(CASES))
    parser.add_argument("--summary", action="store_true")
    options = parser.parse_args()
    if options.summary:
        summary(quoted_draws.read(options.file, "case"))
        return
    for case in [options.only] if options.only else CASES:
        for index in range(*map(int, options.sets.split(":"))):
            quoted_draws.append(options.file, [invert(case, index)])


if __name__ == "__main__":
    main()
