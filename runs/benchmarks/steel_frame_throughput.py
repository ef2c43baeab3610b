"""Cost of a likelihood of model_classes/steel_frame.py over the eigen-solutions that it needs.

    python runs/benchmarks/steel_frame_throughput.py

For every class and a batch of 512, the CPU time of ``ModelClass.log_likelihood``, all three
configurations together, divided by that of ``numpy.linalg.eigh`` on three batches of matrices of
the same size, timed in turn on one BLAS thread, the fastest of each.
"""

from pathlib import Path
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from bayes_ssi.studies.ranking.study import load_study

STUDY = Path(__file__).parents[2] / "model_classes" / "steel_frame.py"
BATCH = 512
REPEATS = 60


def symmetric(stiffness, mass):
    """M^(-1/2) K M^(-1/2), whose eigen-solution every likelihood needs."""
    if mass.ndim == 2:
        root = 1.0 / np.sqrt(mass)
        return stiffness * root[:, :, None] * root[:, None, :]
    half = np.linalg.solve(np.linalg.cholesky(mass), stiffness)
    return np.linalg.solve(np.linalg.cholesky(mass), half.transpose(0, 2, 1))


def measure(candidate):
    """Least milliseconds of the likelihood and of the eigen-solutions, and their ratio."""
    n = len(candidate.parameters)
    values = candidate.values(np.random.default_rng(0).standard_normal((BATCH, n)))
    matrices = []
    for configuration, _, own in candidate.parts(values):
        structure = configuration.structure
        of_structure = own[:, : len(structure.parameters)]
        matrices.append(symmetric(*structure.matrices(of_structure)))
    times = np.empty((REPEATS, 2))
    for i in range(-3, REPEATS):  # the first few warm up
        begun = process_time()
        candidate.log_likelihood(values)
        middle = process_time()
        for each in matrices:
            np.linalg.eigh(each)
        if i >= 0:
            times[i] = middle - begun, process_time() - middle
    likelihood, eigen = 1e3 * times.min(axis=0)
    return likelihood, eigen, likelihood / eigen


def main():
    ratios = []
    for candidate in load_study(STUDY).model_classes:
        with threadpool_limits(limits=1, user_api="blas"):
            likelihood, eigen, ratio = measure(candidate)
        ratios.append(ratio)
        print(f"{candidate.name:8s} log-likelihood {likelihood:6.2f} ms, eigen-solutions "
              f"{eigen:6.2f} ms, ratio {ratio:.2f}")  # fmt: skip
    print(f"largest ratio {max(ratios):.2f}, batch of {BATCH}")


if __name__ == "__main__":
    main()
