"""Cost of the batched log-likelihood relative to the eigen-solutions that it cannot avoid.

    python runs/benchmarks/throughput.py

For shear buildings of n = 3, 4 and 7 degrees of freedom and a batch of 512, the CPU time of
``ModelClass.log_likelihood`` divided by that of ``numpy.linalg.eigh`` on the same matrices, timed
in turn, the fastest of each, which others on the machine disturb least; with BLAS's default threads
and with a single thread (each in its own process).
"""

import os
import subprocess
import sys
from time import process_time

import numpy as np

import bayes_ssi as bs

BATCH = 512
REPEATS = 200
SIZES = (3, 4, 7)
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def model_class(n: int) -> bs.ModelClass:
    """An n-storey building with a factor on every storey, and all n modes measured everywhere."""
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(n)]
    building = bs.ShearBuilding(masses=[1.0] * n, stiffnesses=[400.0 * k for k in factors])
    frequencies, shapes = building.modes(np.ones((1, n)))
    modes = tuple(
        bs.IdentifiedMode(str(i + 1), float(frequencies[0, i]), shapes[0, :, i]) for i in range(n)
    )
    data = bs.ModalData(modes, (0.0, 10.0), building.degrees_of_freedom)
    pairing = {str(i + 1): i + 1 for i in range(n)}
    return bs.ModelClass(f"n = {n}", building, data, bs.ErrorModel(0.01, 0.05), pairing=pairing)


def measure(n: int) -> tuple[float, float, float]:
    """Least seconds of the likelihood and of eigh, and their ratio."""
    candidate = model_class(n)
    z = np.random.default_rng(0).standard_normal((BATCH, n))
    stiffness, mass = candidate.structure.matrices(candidate.values(z))
    matrices = stiffness / np.sqrt(mass[:, :, None] * mass[:, None, :])
    times = np.empty((REPEATS, 2))
    for i in range(-5, REPEATS):  # the first few warm up
        begun = process_time()
        candidate.log_likelihood(candidate.values(z))
        middle = process_time()
        np.linalg.eigh(matrices)
        if i >= 0:
            times[i] = middle - begun, process_time() - middle
    likelihood, eigh = times.min(axis=0)
    return likelihood, eigh, likelihood / eigh


def main() -> None:
    for n in SIZES:
        likelihood, eigh, ratio = measure(n)
        print(
            f"n = {n}: log-likelihood {1e3 * likelihood:.2f} ms, eigh {1e3 * eigh:.2f} ms, "
            f"ratio {ratio:.2f} ({1e6 * likelihood / BATCH:.2f} microseconds a point)"
        )


if __name__ == "__main__":
    if "--here" in sys.argv:
        main()
    else:
        for threads in ("", "1"):
            print(f"batch of {BATCH}, BLAS threads: {threads or 'as it comes'}", flush=True)
            limits = dict.fromkeys(THREADS, threads) if threads else {}
            command = [sys.executable, __file__, "--here"]
            subprocess.run(command, env={**os.environ, **limits}, check=True)
