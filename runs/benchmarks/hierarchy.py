"""Are evidences and parameters of populations of many tests right, and how long do they take?

    python runs/benchmarks/hierarchy.py [--sets 200] [--only evidence|calibration|time]

evidence: tests with linear models and normal errors, whose evidence is known but for a quadrature:
5, 20 and 100 tests, of every population, ranked against every other.

calibration: in each set one of four populations is chosen with equal probability, its mean, slope
and spread are drawn from their priors, and six tests of three frequencies from it, each with an
unknown error of its own. All four populations are sampled. If everything is right, ranks of the
true values among posterior draws are uniform, and populations with a stated probability p are true
in a share p of the cases.

time: 100 such tests, all four populations.
"""

from __future__ import annotations

import argparse
import math
from itertools import product
from time import perf_counter, process_time

import beside_tests  # noqa: F401
import numpy as np
from linear_tests import exact_log_evidence, linear_tests, log_normal
from scipy.special import logsumexp
from scipy.stats import chisquare, kstest
from simulated import print_bands

import bayes_ssi as bs
from bayes_ssi.parameters.parameters import values_at
from bayes_ssi.results.hierarchy.likelihood_fit import LikelihoodFit, fit_likelihood
from bayes_ssi.results.hierarchy.populations import Population, RankedPopulation, sample_population
from bayes_ssi.results.hierarchy.ranked_populations import MOST_DRAWS

PRIORS = bs.PopulationPriors(spread=bs.HalfNormal(0.5), slope=bs.Normal(0.0, 0.5))
KINDS = tuple(product((False, True), repeat=2))
# d ln f / dz of a frequency that goes with the root of a stiffness whose prior has 30 %.
SENSITIVITY = 0.5 * bs.LogNormal(1.0, 0.3).log_sd
ERROR = bs.LogNormal(median=0.01, cov=1.0)
MODES, TESTS = 3, 6
COARSE = bs.SamplingSettings(log_evidence_error=0.05, particles=200, searches=2, max_steps=1000)
N_BINS = 10
# What sampling leaves of the error of a test's log evidence.
EVIDENCE_ERROR = 0.005
MOST_DRAWS = MOST_DRAWS


def population(varies: bool, follows: bool) -> Population:
    name = ("same", "follows", "varies", "varies and follows")[2 * varies + follows]
    return Population(name, ("k",), varies, follows, PRIORS)


def standardised(x: np.ndarray) -> np.ndarray:
    return (x - x.mean()) / x.std()


def true_values(kind: Population, rng: np.random.Generator) -> np.ndarray:
    return values_at(kind.parameters, rng.standard_normal((1, len(kind.parameters))))


def parameters_of_tests(
    kind: Population, values: np.ndarray, x: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    mean, slope, spread = (each[0, 0] for each in kind.split(values))
    return mean + slope * x + spread * rng.standard_normal(len(x))


def sampled_kinds(
    fits: list[LikelihoodFit], x: np.ndarray, seed: int, settings: bs.SamplingSettings | None = None
) -> list[RankedPopulation]:
    """All populations of the structure's parameter, the first of each test."""
    fits, settings = [fit.within([0]) for fit in fits], settings or bs.SamplingSettings()
    kinds = (population(*kind) for kind in KINDS)
    return [sample_population(kind, fits, x, seed, settings, lambda *_: None) for kind in kinds]


def evidence() -> None:
    print("Log evidence less its closed form, nats (stated standard error):")
    print(f"{'tests':>5} {'true population':20}", *(f"{population(*k).name:>20}" for k in KINDS))
    worst = 0.0
    for n_tests, truth in product((5, 20, 100), KINDS):
        rng = np.random.default_rng([n_tests, *truth])
        x, kind = standardised(rng.standard_normal(n_tests)), population(*truth)
        z = parameters_of_tests(kind, true_values(kind, rng), x, rng)
        variances = 0.05**2 * np.exp(rng.standard_normal(n_tests))
        y = z + 0.3 * rng.standard_normal(n_tests)
        y += np.sqrt(variances) * rng.standard_normal(n_tests)
        tests = linear_tests(y, variances, n_draws=MOST_DRAWS, seed=n_tests)
        cells = []
        for other, sampled in zip(KINDS, sampled_kinds(tests, x, 0), strict=True):
            off = sampled.log_evidence - exact_log_evidence(
                y, variances + 0.3**2, x, varies=other[0], follows=other[1],
                spread_prior=PRIORS.spread, slope_sd=0.5,
            )  # fmt: skip
            worst = max(worst, abs(off))
            cells.append(f"{off:+.4f} ({sampled.error:.4f})")
        print(f"{n_tests:5} {kind.name:20}", *(f"{cell:>20}" for cell in cells), flush=True)
    print(f"Largest difference: {worst:.4f} nats")


def modal_test(
    i: int, z: float, rng: np.random.Generator, n_draws: int = MOST_DRAWS
) -> LikelihoodFit:
    """Logarithms of three frequencies with an error drawn from its prior; exact draws.

    Given the error, z is normal in prior and posterior; the error's coordinate is on a fine grid.
    """
    y = SENSITIVITY * z + ERROR.from_normal(rng.standard_normal()) * rng.standard_normal(MODES)
    w = np.linspace(-7.0, 7.0, 4001)
    variances = ERROR.from_normal(w) ** 2
    precisions = 1.0 + MODES * SENSITIVITY**2 / variances
    means = SENSITIVITY * y.sum() / variances / precisions
    log_masses = log_normal(y[:, None], variances).sum(axis=0)
    log_masses += 0.5 * precisions * means**2 - 0.5 * np.log(precisions) + log_normal(w, 1.0)
    total = float(logsumexp(log_masses))
    chosen = rng.choice(len(w), n_draws, p=np.exp(log_masses - total))
    own = means[chosen] + rng.standard_normal(n_draws) / np.sqrt(precisions[chosen])
    residuals = y[:, None] - SENSITIVITY * own
    log_likelihoods = log_normal(residuals, variances[chosen]).sum(axis=0)
    log_evidence = total + math.log(w[1] - w[0]) + EVIDENCE_ERROR * rng.standard_normal()
    draws = np.column_stack([own, w[chosen]])
    return fit_likelihood(draws, log_likelihoods, log_evidence, np.random.default_rng([0, i]))


def one_set(index: int) -> tuple[Population, np.ndarray, list[RankedPopulation], list[str]]:
    """The true population, its parameters, all populations sampled, and failed checks."""
    rng = np.random.default_rng([3, index])
    kind = population(*KINDS[rng.integers(4)])
    x, values = standardised(rng.standard_normal(TESTS)), true_values(kind, rng)
    z = parameters_of_tests(kind, values, x, rng)
    tests = [modal_test(i, z[i], rng, MOST_DRAWS // 2) for i in range(TESTS)]
    sampled = sampled_kinds(tests, x, index, COARSE)
    return kind, values[0], sampled, [check for each in sampled for check in each.failed_checks]


def calibration(n_sets: int) -> None:
    ranks: dict[str, list[float]] = {"mean": [], "slope": [], "spread": []}
    stated, right, follows, followed, failed = [], [], [], [], []
    rng = np.random.default_rng(5)
    for index in range(n_sets):
        kind, values, sampled, checks = one_set(index)
        failed += [f"set {index}: {check}" for check in checks]
        log_evidences = np.array([each.log_evidence for each in sampled])
        probabilities = np.exp(log_evidences - logsumexp(log_evidences))
        names = [each.population.name for each in sampled]
        stated += probabilities.tolist()
        right += [name == kind.name for name in names]
        follows.append(sum(p for p, s in zip(probabilities, sampled, strict=True)
                           if s.population.follows))  # fmt: skip
        followed.append(kind.follows)
        true = sampled[names.index(kind.name)]
        for i, parameter in enumerate(true.population.parameters):
            below = int((true.draws[:, i] < values[i]).sum())
            equal = (below + rng.random()) / (len(true.draws) + 1)
            ranks[parameter.name.split()[0]].append(equal)
    print(f"Ranks of true values in {n_sets} sets, p-values (uniform if above 0.01):")
    for name, own in ranks.items():
        counts = np.histogram(own, N_BINS, (0.0, 1.0))[0]
        print(f"  {name:7} {len(own):4} ranks: chi squared of {N_BINS} bins "
              f"{chisquare(counts).pvalue:.2f}, Kolmogorov-Smirnov "
              f"{kstest(own, 'uniform').pvalue:.2f}; {counts.tolist()}")  # fmt: skip
    print("All populations, stated probability and share that is true:")
    bands = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0)
    print_bands(np.array(stated), np.array(right), bands)
    print("That the parameter follows the covariate:")
    print_bands(np.array(follows), np.array(followed), (0.0, 0.1, 0.3, 0.7, 0.9, 1.0))
    print(f"{len(failed)} failed checks")
    for check in failed:
        print(f"  {check}")


def time() -> None:
    rng = np.random.default_rng(1)
    x, kind = standardised(rng.standard_normal(100)), population(True, True)
    z = parameters_of_tests(kind, np.array([[0.3, 0.2, 0.1]]), x, rng)
    wall, processor = perf_counter(), process_time()
    tests = [modal_test(i, z[i], rng) for i in range(100)]
    for sampled in sampled_kinds(tests, x, 0):
        print(f"{sampled.population.name}: {sampled.log_evidence:.3f} ± {sampled.error:.3f}")
    print(f"100 tests, four populations: {perf_counter() - wall:.0f} s, of which "
          f"{process_time() - processor:.0f} s of processor time")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--only", choices=("evidence", "calibration", "time"))
    options = parser.parse_args()
    parts = {"evidence": evidence, "time": time, "calibration": lambda: calibration(options.sets)}
    for name, part in parts.items():
        if options.only in (None, name):
            part()


if __name__ == "__main__":
    main()
