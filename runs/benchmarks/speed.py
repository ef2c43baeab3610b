"""Computing time over what cannot be avoided: of likelihoods and of starting up.

    python runs/benchmarks/speed.py [--runs 9]

Likelihoods: for shear buildings of 3, 4 and 7 storeys and every class of the steel frame in three
configurations, the CPU time of ``ModelClass.log_likelihood`` of a batch of 512 divided by that of
``numpy.linalg.eigh`` on matrices of the same size, timed in turn, the fastest of each, which others
on the machine disturb least; with BLAS's threads as they come and with one.

Starting up: import times, by ``python -X importtime``, of numpy, scipy.linalg and scipy.special
together, of bayes_ssi, and of ``bayes-ssi --help``, each in a process of its own, in turn; medians
and their ratios. The package promises at most 1.5 and 2.
"""

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

import bayes_ssi as bs

STUDY = Path(__file__).parents[2] / "model_classes" / "steel_frame.py"
BATCH, REPEATS, SIZES = 512, 100, (3, 4, 7)

LIBRARIES = "numpy, scipy.linalg, scipy.special"
STARTS = {
    LIBRARIES: f"import {LIBRARIES}",
    "import bayes_ssi": "import bayes_ssi",
    "bayes-ssi --help": "from bayes_ssi.cli import main; main(['--help'])",
}
LIMITS = {"import bayes_ssi": 1.5, "bayes-ssi --help": 2.0}
# Avoid measuring the compilation of modules.
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def shear_building(n: int) -> bs.ModelClass:
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


def symmetric(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """M^(-1/2) K M^(-1/2), whose eigen-solution every likelihood needs."""
    if mass.ndim == 2:
        root = 1.0 / np.sqrt(mass)
        return stiffness * root[:, :, None] * root[:, None, :]
    half = np.linalg.solve(np.linalg.cholesky(mass), stiffness)
    return np.linalg.solve(np.linalg.cholesky(mass), half.transpose(0, 2, 1))


def seconds(candidate: bs.ModelClass) -> np.ndarray:
    """Least seconds of the likelihood and of its eigen-solutions."""
    n = len(candidate.parameters)
    values = candidate.values(np.random.default_rng(0).standard_normal((BATCH, n)))
    matrices = [
        symmetric(*test.structure.matrices(own[:, : len(test.structure.parameters)]))
        for test, _, own in candidate.parts(values)
    ]
    times = np.empty((REPEATS, 2))
    for i in range(-3, REPEATS):  # the first few warm up
        begun = process_time()
        candidate.log_likelihood(values)
        middle = process_time()
        for each in matrices:
            np.linalg.eigh(each)
        if i >= 0:
            times[i] = middle - begun, process_time() - middle
    return times.min(axis=0)


def likelihoods() -> None:
    candidates = [*map(shear_building, SIZES), *bs.load_study(STUDY).model_classes]
    for threads in (None, 1):
        print(f"batch of {BATCH}, BLAS threads: {threads or 'as they come'}")
        for candidate in candidates:
            with threadpool_limits(limits=threads, user_api="blas"):
                likelihood, eigen = seconds(candidate)
            print(
                f"  {candidate.name:8s} log-likelihood {1e3 * likelihood:6.2f} ms, eigen-solutions "
                f"{1e3 * eigen:6.2f} ms, ratio {likelihood / eigen:.2f} "
                f"({1e6 * likelihood / BATCH:.2f} microseconds a point)",
                flush=True,
            )


def import_seconds(code: str) -> float:
    """Time in imports of a process that runs ``code``: the sum of every module's own time."""
    command = [sys.executable, "-X", "importtime", "-c", code]
    report = subprocess.run(command, capture_output=True, text=True, check=True, env=ENVIRONMENT)
    rows = (line.removeprefix("import time:").split("|") for line in report.stderr.splitlines())
    return sum(int(row[0]) for row in rows if len(row) == 3 and row[0].strip().isdigit()) / 1e6


def starting_up(runs: int) -> None:
    # The first are what Python compiles on the first run.
    times = [[import_seconds(code) for code in STARTS.values()] for _ in range(runs + 1)][1:]
    medians = dict(zip(STARTS, map(statistics.median, zip(*times, strict=True)), strict=True))
    for name, median in medians.items():
        ratio = median / medians[LIBRARIES]
        judged = f", at most {LIMITS[name]:g}: {ratio <= LIMITS[name]}" if name in LIMITS else ""
        print(f"{name:36s} {1000 * median:6.0f} ms   {ratio:.2f} times{judged}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=9, help="of every start")
    options = parser.parse_args()
    likelihoods()
    starting_up(options.runs)


if __name__ == "__main__":
    main()
