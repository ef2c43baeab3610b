"""Posterior and evidence of the numerical study's four classes, compared with dynesty's defaults.

    pip install -e ".[benchmarks]"
    python runs/benchmarks/evidence.py [SEEDS]

Both see the same likelihoods, in turn, class by class; dynesty's nested sampler evaluates one
point at a time. Errors are against reference values from adaptive importance sampling
(numerical error below 0.002).
"""

import sys
from pathlib import Path
from time import perf_counter

import dynesty
import numpy as np

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

STUDY = Path(__file__).parents[2] / "model_classes" / "shear_building.py"
REFERENCE = {"1-a": 0.248, "1-b": -10.057, "2": -9.304, "3": 16.067}


def ours(candidate: bs.ModelClass, seed: int) -> tuple[float, float]:
    evidence = bs.sample(candidate, seed).evidence
    return evidence.log_evidence, evidence.error


def peer(candidate: bs.ModelClass, seed: int) -> tuple[float, float]:
    from scipy.special import ndtri

    def to_values(u: np.ndarray) -> np.ndarray:
        return candidate.values(ndtri(u)[None])[0]

    def log_likelihood(values: np.ndarray) -> float:
        return float(candidate.log_likelihood(values[None])[0])

    sampler = dynesty.NestedSampler(
        log_likelihood, to_values, len(candidate.parameters), rstate=np.random.default_rng(seed)
    )
    sampler.run_nested(print_progress=False)
    return float(sampler.results.logz[-1]), float(sampler.results.logzerr[-1])


def main() -> None:
    n_seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    candidates = load_study(STUDY).model_classes
    bs.sample(candidates[0], seed=1000)  # imports are not part of the comparison
    seconds, errors = {}, {}
    for seed in range(n_seeds):
        for candidate in candidates:
            for name, run in (("bayes_ssi", ours), ("dynesty", peer)):
                begun = perf_counter()
                log_evidence, claimed = run(candidate, seed)
                seconds.setdefault(name, []).append(perf_counter() - begun)
                error = log_evidence - REFERENCE[candidate.name]
                errors.setdefault(name, []).append(error)
                print(
                    f"seed {seed}  {candidate.name:4s} {name:10s} log evidence "
                    f"{log_evidence:8.3f} ± {claimed:.3f}  true error {error:+.4f}  "
                    f"{seconds[name][-1]:6.2f} s",
                    flush=True,
                )
    rms = {name: float(np.sqrt(np.mean(np.square(each)))) for name, each in errors.items()}
    total = {name: sum(each) / n_seeds for name, each in seconds.items()}
    for name in seconds:
        print(f"{name:10s} four classes {total[name]:6.2f} s, rms true error {rms[name]:.4f}")
    print(
        f"faster by {total['dynesty'] / total['bayes_ssi']:.1f}, "
        f"true error smaller by {rms['dynesty'] / rms['bayes_ssi']:.1f}"
    )


if __name__ == "__main__":
    main()
