"""How long do many parameters take, of which few are determined?

    python runs/benchmarks/many_parameters.py [--seeds 10] [--storeys 12,15]

Three frequencies, known to 0.1 %, of a shear building with a stiffness to infer for each of 12 or
15 storeys: the data determine three directions, along a sheet that curves by many times its
thickness. Prints mean and scatter of the log evidence over the seeds beside its claimed error,
failed checks, evaluations, and seconds of one processor.
"""

import argparse
import math
from time import process_time

import beside_tests  # noqa: F401
import numpy as np
from problems_modal import frequencies_alone
from threadpoolctl import threadpool_limits

from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.sampling.engine import sample_target

ERROR, N_FREQUENCIES = 1e-3, 3
# Of the identified frequencies, over those of equal storeys.
RATIOS = np.array([1.02, 0.99, 1.01])


def observed(n: int) -> np.ndarray:
    """The identified frequencies of n storeys, of which equal ones would have 1 Hz as the first."""
    angles = (2.0 * np.arange(N_FREQUENCIES) + 1.0) * math.pi / (4 * n + 2)
    return RATIOS * np.sin(angles) / np.sin(angles[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--storeys", default="12,15")
    options = parser.parse_args()
    for n in map(int, options.storeys.split(",")):
        model_class = frequencies_alone(f"{n} storeys", n, observed(n), ERROR)
        values, errors, evaluations, seconds, n_failed = [], [], [], [], 0
        for seed in range(options.seeds):
            begun = process_time()
            with threadpool_limits(limits=1, user_api="blas"):
                sampled = sample_target(class_target(model_class), np.random.SeedSequence(seed))
            seconds.append(process_time() - begun)
            values.append(sampled.evidence.log_evidence)
            errors.append(sampled.evidence.error)
            evaluations.append(sampled.n_evaluations)
            n_failed += bool(sampled.failed_checks)
        print(
            f"{n} storeys: log evidence {np.mean(values):.3f}, scatter {np.std(values, ddof=1):.4f}"
            f" over {len(values)} seeds, claimed {np.mean(errors):.4f}; failed checks {n_failed};"
            f" {np.mean(evaluations):.0f} evaluations, {np.mean(seconds):.1f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
