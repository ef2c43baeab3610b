"""How fast are likelihoods, starting up, whole commands and workers?

    python runs/benchmarks/speed.py likelihood
    python runs/benchmarks/speed.py start [--runs 9]
    python runs/benchmarks/speed.py commands [--runs 3] [--only "shear building;…"]
    python runs/benchmarks/speed.py workers

``likelihood``: CPU time of ``ModelClass.log_likelihood`` of a batch of 512 over that of
``numpy.linalg.eigh`` on the same matrices, for shear buildings of 3, 4 and 7 degrees of freedom,
two of 3 storeys with a tuned pendulum and so two close modes in all rows, and all of the steel
frame, timed in turn, the fastest of each; with BLAS's own threads and one.

``start``: import times, by ``python -X importtime``, of numpy, scipy.linalg and scipy.special
together, of bayes_ssi, and of ``bayes-ssi --help``, processes in turn; medians and ratios.

``commands``: every command as a process of its own with its defaults; wall time, and processor time
of all its processes, each the median.

``workers``: batches of a shear building that sleeps for 50 ms a point, with one and two processes;
values must be identical. The overhead is the time in excess of the sleep alone.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np

import bayes_ssi as bs

STUDIES = Path(__file__).parents[2] / "model_classes"


def exact_building(n: int, building: type[bs.ShearBuilding] = bs.ShearBuilding) -> bs.ModelClass:
    """An n-storey building with a factor on every storey, and all n modes measured everywhere."""
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(n)]
    return exact_class(f"n = {n}", building([1.0] * n, [400.0 * k for k in factors]), n)


def tuned_building(mass: float) -> bs.ModelClass:
    """Three storeys whose pendulum on the roof is tuned to the second mode, close in all draws."""
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.02)) for i in range(3)]
    frame = bs.ShearBuilding([1.0] * 3, [400.0 * k for k in factors])
    hz = float(frame.modes(np.ones((1, 3))).frequencies_hz[0, 1])
    pendulum = bs.Pendulum(on="floor 3", mass=mass, frequency=hz)
    return exact_class(f"tuned {mass:g}", frame.with_element(pendulum), 3)


def exact_class(name: str, structure: bs.ShearBuilding, n_sensors: int) -> bs.ModelClass:
    """All modes at the medians of the parameters, measured at the floors."""
    sensors = structure.degrees_of_freedom[:n_sensors]
    frequencies, shapes = structure.modes(structure.prior_medians())[:2]
    modes = tuple(
        bs.IdentifiedMode(str(i), float(hz), shape[:n_sensors])
        for i, (hz, shape) in enumerate(zip(frequencies[0], shapes[0].T, strict=True), 1)
    )
    data = bs.ModalData(modes, (0.0, 10.0), sensors)
    pairing = {mode.label: i for i, mode in enumerate(modes, 1)}
    return bs.ModelClass(name, structure, data, bs.ErrorModel(0.01, 0.05), pairing=pairing)


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
        tuned = map(tuned_building, (0.02, 0.0002))
        for candidate in (*map(exact_building, (3, 4, 7)), *tuned, *steel_frame):
            with threadpool_limits(threads, user_api="blas"):
                own, eigh = least_milliseconds(candidate)
            print(f"{candidate.name:12s} log-likelihood {own:6.2f} ms, eigen-solutions {eigh:6.2f} "
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


# Whole commands, and the seconds that are wanted on two cores.

CLI = (sys.executable, "-c", "from bayes_ssi.cli import main; main()")
COMMANDS = {
    "shear building": (5.0, (*CLI, "rank", "model_classes/shear_building.py")),
    "Liverpool frame": (20.0, (*CLI, "rank", "model_classes/liverpool_frame.py")),
    "steel frame": (30.0, (*CLI, "rank", "model_classes/steel_frame.py")),
    "search, bare building": (10.0, (*CLI, "search", "model_classes/bare_building.py")),
    "search, 20 storeys": (30.0, (sys.executable, "runs/benchmarks/tall_building.py")),
}


def seconds_of(command: tuple[str, ...]) -> tuple[float, float]:
    """Wall time, and processor time of a command and all processes that it starts."""
    # As a user has it: linear algebra may use what threads it likes.
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    with TemporaryDirectory() as directory:
        if command[: len(CLI)] == CLI:
            command += ("--out", f"{directory}/r", "--quiet", "--accept-failed-checks")
        before, begun = os.times(), perf_counter()
        subprocess.run(command, cwd=STUDIES.parent, env=environment, check=True,
                       stdout=subprocess.DEVNULL)  # fmt: skip
        after = os.times()
    return perf_counter() - begun, sum(after[2:4]) - sum(before[2:4])


def commands(options: argparse.Namespace) -> None:
    print(f"{options.runs} runs each on {len(os.sched_getaffinity(0))} cores; seconds, medians")
    for name in options.only.split(";") if options.only else COMMANDS:
        wanted, command = COMMANDS[name]
        runs = [seconds_of(command) for _ in range(options.runs)]
        wall, processor = (statistics.median(each) for each in zip(*runs, strict=True))
        print(
            f"{name:22s} wall {wall:6.1f} of {wanted:.0f}, processor {processor:7.2f}", flush=True
        )


# Workers.

SLOW_BATCHES, SLOW_BATCH, SECONDS_A_POINT = 6, 64, 0.05


class SlowBuilding(bs.ShearBuilding):
    """A shear building whose modes take a while."""

    def modes(self, values):
        time.sleep(SECONDS_A_POINT * len(values))
        return super().modes(values)


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
    from bayes_ssi.inference.workers.workers import Workers

    _, here = batch_seconds("without workers", 1, nullcontext)
    one, two = (batch_seconds(f"{n} workers", n, lambda: Workers(n_workers=n)) for n in (1, 2))  # noqa: B023
    print(f"speed-up of two over one: {one[0] / two[0]:.2f}", flush=True)
    same = all(there.tobytes() == here.tobytes() for _, there in (one, two))
    print(f"values identical everywhere: {same}")


PARTS = {each.__name__: each for each in (likelihood, start, commands, workers)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--runs", type=int, default=9, help="of starting up, and of commands")
    parser.add_argument("--only", help="names of commands, separated by semicolons")
    options = parser.parse_args()
    PARTS[options.part](options)


if __name__ == "__main__":
    main()
