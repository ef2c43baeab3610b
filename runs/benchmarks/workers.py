"""Speed-up of sampling a slow model with workers: local processes, and a Dask cluster.

    pip install -e ".[dask]"
    python runs/benchmarks/workers.py

A shear building that sleeps for a fixed time per point is evaluated in batches of typical size:
without workers, with one and two processes, and with one and two workers of a Dask cluster on this
machine. The first batch, which starts the processes and sends them the model, is timed separately.
The overhead is the time in excess of the sleep alone, shared among the workers.
Then one class is sampled as a whole with one and two processes; the results must be identical.
"""

import logging
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, contextmanager, nullcontext
from time import perf_counter

import numpy as np
from distributed import LocalCluster

import bayes_ssi as bs
from bayes_ssi.inference.workers.executors import DaskWorkers, LocalWorkers
from bayes_ssi.inference.workers.workers import Workers, evaluate

BATCHES, BATCH = 6, 64
SECONDS_A_POINT = 0.05
SECONDS_A_POINT_SAMPLED = 0.001
SETTINGS = bs.SamplingSettings(log_evidence_error=0.2, particles=64, searches=1)
LEAST_SPEED_UP = 1.8
LARGEST_OVERHEAD = 0.15


class SlowBuilding(bs.ShearBuilding):
    """A shear building whose modes take ``seconds`` per point."""

    seconds = SECONDS_A_POINT
    n_points = 0  # evaluated in this process

    def modes(self, values):
        type(self).n_points += len(values)
        time.sleep(self.seconds * len(values))
        return super().modes(values)


class LessSlowBuilding(SlowBuilding):
    seconds = SECONDS_A_POINT_SAMPLED


def model_class(building: type[SlowBuilding]) -> bs.ModelClass:
    """Two storeys of one unknown stiffness."""
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    structure = building(masses=(1.0, 1.0), stiffnesses=(40.0 * k, 40.0 * k))
    frequencies, shapes = bs.ShearBuilding.modes(structure, np.ones((1, 1)))
    modes = tuple(
        bs.IdentifiedMode(str(i + 1), float(frequencies[0, i]), shapes[0, :, i]) for i in range(2)
    )
    data = bs.ModalData(modes, (0.0, 3.0), structure.degrees_of_freedom)
    error = bs.ErrorModel(0.02, 0.05)
    return bs.ModelClass("slow", structure, data, error, pairing={"1": 1, "2": 2})


@contextmanager
def dask_cluster(n: int):
    with (
        LocalCluster(
            n_workers=n,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        DaskWorkers(cluster.scheduler_address) as pool,
    ):
        yield pool


def time_batches(
    name: str, n: int, make: Callable[[], AbstractContextManager[Workers | None]]
) -> tuple[float, np.ndarray]:
    """Seconds of the batches, and their values."""
    candidate = model_class(SlowBuilding)
    batches = np.random.default_rng(0).standard_normal((BATCHES, BATCH, 1))
    begun = perf_counter()
    with make() as pool:

        def values(z: np.ndarray) -> np.ndarray:
            if pool is None:
                return evaluate(candidate.log_likelihood_at, z).values
            return pool.evaluate(candidate.log_likelihood_at, z).values

        values(batches[0, : 4 * n])
        ready = perf_counter()
        all_values = np.concatenate([values(z) for z in batches])
        seconds = perf_counter() - ready
    ideal = BATCHES * BATCH * SECONDS_A_POINT / n
    print(
        f"{name:20s} {seconds:6.2f} s, overhead {100 * (seconds / ideal - 1):4.1f} %; "
        f"started in {ready - begun - 4 * SECONDS_A_POINT:.1f} s",
        flush=True,
    )
    return seconds, all_values


def time_sampling(n: int) -> tuple[float, bs.Posterior]:
    candidate = model_class(LessSlowBuilding)
    LessSlowBuilding.n_points = 0
    with LocalWorkers(n) as pool:
        begun = perf_counter()
        posterior = bs.sample(candidate, 0, SETTINGS, bs.Run(pool))
        seconds = perf_counter() - begun
    print(
        f"sampling, {n} local      {seconds:6.2f} s; {posterior.n_evaluations} evaluations by "
        f"workers, {LessSlowBuilding.n_points} points here",
        flush=True,
    )
    return seconds, posterior


def verdict(text: str, kept: bool) -> None:
    print(f"{text}: {'as wanted' if kept else 'NOT AS WANTED'}", flush=True)


def main() -> None:
    print(f"{BATCHES} batches of {BATCH} points, {1e3 * SECONDS_A_POINT:g} ms a point")
    _, here = time_batches("without workers", 1, nullcontext)
    seconds, same = {}, True
    for kind, make in (("local", LocalWorkers), ("Dask", dask_cluster)):
        for n in (1, 2):
            seconds[kind, n], there = time_batches(f"{n} {kind}", n, lambda: make(n))  # noqa: B023
            same &= there.tobytes() == here.tobytes()
        speed_up = seconds[kind, 1] / seconds[kind, 2]
        verdict(f"speed-up of two over one, {kind}: {speed_up:.2f}", speed_up >= LEAST_SPEED_UP)
    ideal = BATCHES * BATCH * SECONDS_A_POINT / 2
    for name, reference in (("two local", seconds["local", 2]), ("the ideal", ideal)):
        more = seconds["Dask", 2] / reference - 1.0
        verdict(f"two of Dask over {name}: {100 * more:+.1f} %", more < LARGEST_OVERHEAD)
    verdict("values identical everywhere", same)

    print(f"\none class as a whole, {1e3 * SECONDS_A_POINT_SAMPLED:g} ms a point")
    one_seconds, one = time_sampling(1)
    two_seconds, two = time_sampling(2)
    print(f"speed-up of two over one: {one_seconds / two_seconds:.2f}")
    same = one.draws.tobytes() == two.draws.tobytes() and one.evidence == two.evidence
    verdict("results identical", same)


if __name__ == "__main__":
    main()
