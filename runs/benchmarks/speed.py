"""How fast are likelihoods, starting up, responses and workers? Ratios within one run.

    python runs/benchmarks/speed.py likelihood
    python runs/benchmarks/speed.py start [--runs 9]
    python runs/benchmarks/speed.py responses
    python runs/benchmarks/speed.py workers    # with pip install -e ".[dask]"

``likelihood``: CPU time of ``ModelClass.log_likelihood`` of a batch of 512 over that of
``numpy.linalg.eigh`` on the same matrices, for shear buildings of 3, 4 and 7 degrees of freedom and
all classes of the steel frame, timed in turn, the fastest of each; with BLAS's own threads and one.

``start``: import times, by ``python -X importtime``, of numpy, scipy.linalg and scipy.special
together, of bayes_ssi, and of ``bayes-ssi --help``, processes in turn; medians and ratios.

``responses``: the largest relative difference between transfer functions by modes and those that
solve (K + iωC - ω²M) u = -Mι at every frequency, for the cases of section 2, correct and as masses
only; and the time of ``time_histories`` of the building of Case (c), 500 draws and 18,000 samples,
over one call of ``scipy.signal.lfilter`` a history. A draw takes four such calls, one a mode.

``workers``: batches of a shear building that sleeps for 50 ms a point, with one and two processes
of this machine and of a Dask cluster; values must be identical. The overhead is the time in excess
of the sleep alone.
"""

from __future__ import annotations

import argparse
import logging
import math
import os
import runpy
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

import bayes_ssi as bs

STUDIES = Path(__file__).parents[2] / "model_classes"


def exact_building(n: int, building: type[bs.ShearBuilding] = bs.ShearBuilding) -> bs.ModelClass:
    """An n-storey building with a factor on every storey, and all n modes measured everywhere."""
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(n)]
    structure = building([1.0] * n, [400.0 * k for k in factors])
    frequencies, shapes = bs.ShearBuilding.modes(structure, np.ones((1, n)))
    modes = tuple(
        bs.IdentifiedMode(str(i + 1), float(frequencies[0, i]), shapes[0, :, i]) for i in range(n)
    )
    data = bs.ModalData(modes, (0.0, 10.0), structure.degrees_of_freedom)
    pairing = {str(i + 1): i + 1 for i in range(n)}
    return bs.ModelClass(f"n = {n}", structure, data, bs.ErrorModel(0.01, 0.05), pairing=pairing)


# Likelihoods over the eigen-solutions that they cannot avoid.

BATCH, REPEATS = 512, 60


def symmetric(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """M^(-1/2) K M^(-1/2), whose eigen-solution every likelihood needs."""
    if mass.ndim == 2:
        root = 1.0 / np.sqrt(mass)
        return stiffness * root[:, :, None] * root[:, None, :]
    half = np.linalg.solve(np.linalg.cholesky(mass), stiffness)
    return np.linalg.solve(np.linalg.cholesky(mass), half.transpose(0, 2, 1))


def least_milliseconds(candidate: bs.ModelClass) -> tuple[float, float]:
    """Of the likelihood, and of the eigen-solutions of all its configurations."""
    n = len(candidate.parameters)
    values = candidate.values(np.random.default_rng(0).standard_normal((BATCH, n)))
    matrices = [
        symmetric(*c.structure.matrices(own[:, : len(c.structure.parameters)]))
        for c, _, own in candidate.parts(values)
    ]
    times = np.empty((REPEATS, 2))
    for i in range(-3, REPEATS):  # the first few warm up
        begun = process_time()
        candidate.log_likelihood(values)
        middle = process_time()
        for of_configuration in matrices:
            np.linalg.eigh(of_configuration)
        times[i] = middle - begun, process_time() - middle
    likelihood, eigh = 1e3 * times.min(axis=0)
    return likelihood, eigh


def likelihood(_: argparse.Namespace) -> None:
    from threadpoolctl import threadpool_limits

    from bayes_ssi.studies.ranking.study import load_study

    steel_frame = load_study(STUDIES / "steel_frame.py").model_classes
    for threads in (None, 1):
        print(f"batch of {BATCH}, BLAS threads: {threads or 'as it comes'}", flush=True)
        for candidate in (*map(exact_building, (3, 4, 7)), *steel_frame):
            with threadpool_limits(threads, user_api="blas"):
                own, eigh = least_milliseconds(candidate)
            print(f"{candidate.name:8s} log-likelihood {own:6.2f} ms, eigen-solutions {eigh:6.2f} "
                  f"ms, ratio {own / eigh:.2f}", flush=True)  # fmt: skip


# Starting up.

STARTS = {
    "numpy, scipy.linalg, scipy.special": "import numpy, scipy.linalg, scipy.special",
    "import bayes_ssi": "import bayes_ssi",
    "bayes-ssi --help": "from bayes_ssi.cli import main; main(['--help'])",
}
MOST_TIMES = {"import bayes_ssi": 1.5, "bayes-ssi --help": 2.0}  # promised


def import_seconds(code: str) -> float:
    """Time in imports of a process that runs ``code``: the sum of every module's own time."""
    command = [sys.executable, "-X", "importtime", "-c", code]
    # Avoid measuring the compilation of modules.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    report = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    rows = (line.removeprefix("import time:").split("|") for line in report.stderr.splitlines())
    return sum(int(row[0]) for row in rows if len(row) == 3 and row[0].strip().isdigit()) / 1e6


def start(options: argparse.Namespace) -> None:
    for code in STARTS.values():  # what Python compiles on the first run
        import_seconds(code)
    rounds = [[import_seconds(code) for code in STARTS.values()] for _ in range(options.runs)]
    medians = [statistics.median(seconds) for seconds in zip(*rounds, strict=True)]
    for name, seconds in zip(STARTS, medians, strict=True):
        ratio, most = seconds / medians[0], MOST_TIMES.get(name)
        judged = "" if most is None else f", at most {most:g}: {ratio <= most}"
        print(f"{name:36s} {1000 * seconds:6.0f} ms   {ratio:.2f} times{judged}")


# Responses to ground motion.


def largest_difference() -> float:
    """Largest relative difference, all displacements and absolute accelerations, 0.05 to 7 Hz."""
    from bayes_ssi.structures.response import Output, transfer_functions

    cases = runpy.run_path(str(STUDIES / "non_structural_elements.py"))
    frequencies, no_values = np.linspace(0.05, 7.0, 700), np.empty((1, 0))
    omega = 2.0 * np.pi * frequencies[:, None, None]
    worst = 0.0
    for building in (*cases["correct"].values(), *cases["incorrect"].values()):
        stiffness, diagonal = (part[0] for part in building.matrices(no_values))
        mass = np.diag(diagonal)
        frequencies_hz, shapes = (part[0] for part in building.modes(no_values))
        modal = np.diag(2.0 * cases["DAMPING"] * 2.0 * np.pi * frequencies_hz)
        damping = mass @ shapes @ modal @ shapes.T @ mass
        dynamic = stiffness + 1j * omega * damping - omega**2 * mass
        displacement = np.linalg.solve(dynamic, -diagonal[:, None])[:, :, 0].T
        acceleration = 1.0 - omega[:, 0, 0] ** 2 * displacement
        for quantity, exact in (("displacement", displacement), ("acceleration", acceleration)):
            output = Output(quantity, building.degrees_of_freedom)
            ours = transfer_functions(building, no_values, frequencies, output, cases["DAMPING"])
            worst = max(worst, float(np.abs(ours[0] / exact - 1.0).max()))
    return worst


def responses(_: argparse.Namespace) -> None:
    from scipy.signal import lfilter

    from bayes_ssi.structures.response import GroundMotion, Output, time_histories

    print(f"transfer functions: largest relative difference {largest_difference():.1e}")
    rng = np.random.default_rng(0)
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(4)]
    stiffness = (math.pi / math.sin(math.pi / 14)) ** 2
    frame = bs.ShearBuilding((1.0, 1.0, 1.0), [stiffness * k for k in factors[:3]])
    infill = bs.OutOfPlaneInfill((1, 2), 0.15, 2.8019, stiffness_factor=factors[3], label="infill")
    building = frame.with_element(infill)
    values = np.exp(0.1 * rng.standard_normal((500, 4)))
    motion = GroundMotion(rng.standard_normal(18_000), 0.005)
    for places in (("floor 3",), frame.degrees_of_freedom, building.degrees_of_freedom):
        output = Output("acceleration", places)
        ratios = []
        for _ in range(7):
            begun = perf_counter()
            histories = time_histories(building, values, motion, output, 0.02)
            middle = perf_counter()
            for _ in range(histories.shape[0] * histories.shape[1]):
                lfilter([0.1, 0.2, 0.1], [1.0, -1.9, 0.95], motion.acceleration)
            ratios.append((middle - begun) / (perf_counter() - middle))
        print(f"{len(places)} place(s): {np.median(ratios):.2f} times one lfilter call a history")


# Workers.

SLOW_BATCHES, SLOW_BATCH, SECONDS_A_POINT = 6, 64, 0.05


class SlowBuilding(bs.ShearBuilding):
    """A shear building whose modes take a while."""

    def modes(self, values):
        time.sleep(SECONDS_A_POINT * len(values))
        return super().modes(values)


@contextmanager
def dask_cluster(n: int):
    from distributed import LocalCluster

    from bayes_ssi.inference.workers.executors import DaskWorkers

    settings = {"dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    with (
        LocalCluster(n_workers=n, threads_per_worker=1, **settings) as cluster,
        DaskWorkers(cluster.scheduler_address) as pool,
    ):
        yield pool


def batch_seconds(
    name: str, n: int, make: Callable[[], AbstractContextManager]
) -> tuple[float, np.ndarray]:
    """Seconds of the batches, and their values."""
    from bayes_ssi.inference.workers.workers import evaluate

    candidate = exact_building(2, SlowBuilding)
    batches = np.random.default_rng(0).standard_normal((SLOW_BATCHES, SLOW_BATCH, 2))
    begun = perf_counter()
    with make() as pool:
        call = evaluate if pool is None else pool.evaluate
        call(candidate.log_likelihood_at, batches[0, : 4 * n])
        ready = perf_counter()
        values = [call(candidate.log_likelihood_at, z).values for z in batches]
        seconds = perf_counter() - ready
    over = seconds * n / (SLOW_BATCHES * SLOW_BATCH * SECONDS_A_POINT) - 1.0
    print(f"{name:20s} {seconds:6.2f} s, overhead {100 * over:4.1f} %; started in "
          f"{ready - begun - 4 * SECONDS_A_POINT:.1f} s", flush=True)  # fmt: skip
    return seconds, np.concatenate(values)


def workers(_: argparse.Namespace) -> None:
    from bayes_ssi.inference.workers.executors import LocalWorkers

    _, here = batch_seconds("without workers", 1, nullcontext)
    same = True
    for kind, make in (("local", LocalWorkers), ("Dask", dask_cluster)):
        one, two = (batch_seconds(f"{n} {kind}", n, lambda: make(n)) for n in (1, 2))  # noqa: B023
        same &= all(there.tobytes() == here.tobytes() for _, there in (one, two))
        print(f"speed-up of two over one, {kind}: {one[0] / two[0]:.2f}", flush=True)
    print(f"values identical everywhere: {same}")


PARTS = {each.__name__: each for each in (likelihood, start, responses, workers)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--runs", type=int, default=9, help="of starting up")
    options = parser.parse_args()
    PARTS[options.part](options)


if __name__ == "__main__":
    main()
