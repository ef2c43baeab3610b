"""Accuracy of the quoted log evidences and their error bars, over many seeds.

    python runs/benchmarks/evidence_seeds.py [SEEDS]

The numerical study's four classes, and approach 3 on frequencies alone with small errors and a
wide prior, whose posterior has several maxima. For each: the mean, the largest error against the
reference, the scatter, the claimed error bar and their ratio, and failed checks.
"""

import sys

import numpy as np
from problems import STUDY, several_maxima_class

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

REFERENCE = {"1-a": 0.248, "1-b": -10.057, "2": -9.304, "3": 16.067}
SEVERAL_MAXIMA = 2.694
REGIONS = {"k1 > 1.8": 0.029, "k1 < 1.8 and k3 > 1.06": 0.534, "around the true values": 0.437}


def region_shares(posterior: bs.Posterior) -> np.ndarray:
    k1, k3 = posterior.values[:, 0], posterior.values[:, 2]
    far = k1 > 1.8
    return np.array([far.mean(), (~far & (k3 > 1.06)).mean(), (~far & (k3 <= 1.06)).mean()])


def main() -> None:
    n_seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    candidates = list(load_study(STUDY).model_classes)
    candidates.append(several_maxima_class())
    for candidate in candidates:
        posteriors = [bs.sample(candidate, seed) for seed in range(n_seeds)]
        values = np.array([posterior.evidence.log_evidence for posterior in posteriors])
        claimed = np.array([posterior.evidence.error for posterior in posteriors])
        reference = REFERENCE.get(candidate.name, SEVERAL_MAXIMA)
        scatter = values.std(ddof=1)
        failed = sum(bool(posterior.failed_checks) for posterior in posteriors)
        print(
            f"{candidate.name:15s} mean {values.mean():8.4f} (reference {reference:.3f}), largest "
            f"error {np.abs(values - reference).max():.4f}, scatter {scatter:.4f}, claimed "
            f"{claimed.mean():.4f}, ratio {claimed.mean() / scatter:.2f}; "
            f"{np.mean([p.seconds for p in posteriors]):.2f} s; {failed} with a failed check",
            flush=True,
        )
        for check in {check for posterior in posteriors for check in posterior.failed_checks}:
            print(f"    {check}")
    shares = np.array([region_shares(posterior) for posterior in posteriors])
    for name, expected, each in zip(REGIONS, REGIONS.values(), shares.T, strict=True):
        print(
            f"    {name}: mean {each.mean():.3f} (reference {expected:.3f}), largest error "
            f"{np.abs(each - expected).max():.3f}"
        )


if __name__ == "__main__":
    main()
