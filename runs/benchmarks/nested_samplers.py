"""dynesty beside bayes_ssi on problems that users have: computing time at equal error.

    pip install -e ".[benchmarks,fem]"
    python runs/benchmarks/nested_samplers.py FILE [--sampler bayes_ssi] [--seeds 0:10]
        [--only NAME,…] [--time-limit 200]
    python runs/benchmarks/nested_samplers.py FILE [FILE …] --summary

The first appends a line of JSON for each run. ``--sampler`` is bayes_ssi at its defaults (its whole
``sample``: draws, evidence, checks, adequacy), dynesty at its defaults, or dynesty-rwalk and
-rslice, with random walks or slices in place of its choice. All see the same likelihood. dynesty
evaluates it point by point; it is charged as if it could evaluate batches of 512, by the cost of
such batches at its own posterior draws. A reduced finite-element model is reduced once for dynesty,
which is charged to it; ours goes on refining it. A black box is charged a second a call, above what
the processor did.

dynesty's error falls with the root of its number of live points, to which its cost is proportional
(``--live 2000`` shows it), so its time at equal error is its time multiplied by the square of the
ratio of root-mean-square errors. The best of dynesty's samplings counts.
"""

from __future__ import annotations

import argparse
import math
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import NamedTuple

import beside_tests  # noqa: F401
import dynesty
import economical
import numpy as np
import quoted_draws
import scaling
from problems_modal import any_pairing_of_twelve_degrees_of_freedom, two_frequencies
from quoted_draws import Run
from scipy.special import ndtri

import bayes_ssi as bs

STUDIES = Path(__file__).parents[2] / "model_classes"
BATCH = 512


class UsersProblem(NamedTuple):
    """A class, its log evidence where it is known, and seconds a call besides."""

    model_class: Callable[[], bs.ModelClass]
    log_evidence: float
    a_call: float = 0.0


def of_study(study: str, name: str) -> bs.ModelClass:
    (candidate,) = bs.load_study(STUDIES / f"{study}.py").only([name]).model_classes
    return candidate


def exact_data() -> bs.ModelClass:
    """Modes without noise, errors of 0.01 %."""
    return replace(of_study("shear_building", "3"), error=bs.ErrorModel(1e-4, 1e-4))


def many_modes() -> bs.ModelClass:
    """Ten modes of ten storeys, a sensor on each, a stiffness factor for each."""
    structure = economical.building(10)
    data, error, pairing = economical.identified(
        structure, economical.TEN, 10, structure.degrees_of_freedom
    )
    return bs.ModelClass("ten storeys", structure, data, error, pairing=pairing)


PROBLEMS = {
    # Independent nested sampling and quadrature.
    "veering": UsersProblem(lambda: of_study("shear_building", "3"), 16.067),
    "exact data": UsersProblem(exact_data, math.nan),
    "errors inferred": UsersProblem(
        lambda: of_study("four_storey_frame", "each storey, free errors"), math.nan
    ),
    "two tests": UsersProblem(lambda: of_study("liverpool_frame", "x"), math.nan),
    # As problems_modal.py has it; so the next but two.
    "any pairing": UsersProblem(lambda: any_pairing_of_twelve_degrees_of_freedom(1e-2), 139.909),
    "own finite elements": UsersProblem(lambda: scaling.model_class(1000), math.nan),
    "black box of 1 s": UsersProblem(
        lambda: economical.six_storeys_at_sensors().model_class, math.nan, a_call=1.0
    ),
    "frequencies alone": UsersProblem(two_frequencies, 1.8121),
    "many modes": UsersProblem(many_modes, math.nan),
}


def ours(candidate: bs.ModelClass, seed: int, _: int, economical: bool) -> Run:
    error = 0.05 if economical else 0.01
    settings = bs.SamplingSettings(economical=economical, log_evidence_error=error)
    posterior = bs.sample(candidate, seed, settings)
    return {
        "log_evidence": posterior.evidence.log_evidence,
        "claimed": posterior.evidence.error,
        "evaluations": posterior.n_evaluations,
        "failed_checks": posterior.failed_checks,
    }


def of_dynesty(
    candidate: bs.ModelClass, seed: int, live: int, _: bool, sample: str = "auto"
) -> Run:
    sampler = dynesty.NestedSampler(
        lambda z: float(np.nan_to_num(candidate.log_likelihood_at(z[None])[0], nan=-1e300)),
        ndtri,
        len(candidate.parameters),
        nlive=live,
        sample=sample,
        rstate=np.random.default_rng(seed),
    )
    sampler.run_nested(print_progress=False)
    sampling = process_time()
    result = sampler.results
    draws = result.samples_equal(rstate=np.random.default_rng(seed))
    z = draws[np.random.default_rng(0).integers(len(draws), size=BATCH)]
    one_by_one, batched = (price(candidate, z, size) for size in (1, BATCH))
    calls = int(np.sum(result.ncall))
    return {
        "log_evidence": float(result.logz[-1]),
        "claimed": float(result.logzerr[-1]),
        "evaluations": calls,
        "priced": process_time() - sampling,
        "saved_by_batches": calls * max(one_by_one - batched, 0.0),
    }


def price(candidate: bs.ModelClass, z: np.ndarray, size: int) -> float:
    """Seconds of one of the log-likelihoods in batches of ``size``, the least of three."""
    parts = np.split(z, len(z) // size)[:100]
    times = []
    for _ in range(3):
        begun = process_time()
        for each in parts:
            candidate.log_likelihood_at(each)
        times.append((process_time() - begun) / (len(parts) * size))
    return min(times)


SAMPLERS = {
    "bayes_ssi": ours,
    "dynesty": of_dynesty,
    **{f"dynesty-{name}": partial(of_dynesty, sample=name) for name in ("rwalk", "rslice")},
}


def sample_within(sampler: str, name: str, seed: int, live: int, limit: int) -> Run:
    """What the sampler answers, or why it has no answer, after at most ``limit`` CPU seconds."""
    problem = PROBLEMS[name]
    candidate = problem.model_class()

    def end(*_: object) -> None:
        raise TimeoutError(f"not finished after {limit} s")

    signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, limit)
    begun = process_time()
    try:
        answer = SAMPLERS[sampler](candidate, seed, live, problem.a_call > 0.0)
    except Exception as error:  # noqa: BLE001 - whatever a sampler raises is its answer
        answer = {"unfinished": f"{type(error).__name__}: {error}"}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return {**answer, "seconds": process_time() - begun - answer.pop("priced", 0.0)}


def rms(runs: list[Run], exact: float) -> float:
    return float(np.sqrt(np.mean([(run["log_evidence"] - exact) ** 2 for run in runs])))


def seconds(runs: list[Run], a_call: float) -> float:
    each = [r["seconds"] - r.get("saved_by_batches", 0.0) + a_call * r["evaluations"] for r in runs]
    return float(np.mean(each))


def summary(runs: list[Run]) -> None:
    print(
        f"{'problem':20s} {'sampler':14s} runs {'evaluations':>11s} {'s':>8s} {'fair s':>8s} "
        f"{'rms error':>9s} {'claimed':>7s}  times ours, at equal error"
    )
    for name, problem in PROBLEMS.items():
        own = None
        for sampler in SAMPLERS:
            those = [r for r in runs if (r["problem"], r["sampler"]) == (name, sampler)]
            finished = [run for run in those if "log_evidence" in run]
            if not finished:
                if those:
                    print(f"{name:20s} {sampler:14s} {those[0]['unfinished']}")
                continue
            error, fair = rms(finished, problem.log_evidence), seconds(finished, problem.a_call)
            line = (
                f"{name:20s} {sampler:14s} {len(finished):4d} "
                f"{np.mean([run['evaluations'] for run in finished]):11.0f} "
                f"{np.mean([r['seconds'] for r in finished]):8.2f} {fair:8.2f} {error:9.4f} "
                f"{np.mean([run['claimed'] for run in finished]):7.4f}"
            )
            if sampler == "bayes_ssi":
                own = fair, error
                flagged = sum(bool(run["failed_checks"]) for run in finished)
                line += f"  failed checks in {flagged}" if flagged else ""
            elif own:
                line += f"  {fair / own[0]:10.1f} {fair / own[0] * (error / own[1]) ** 2:10.0f}"
            print(line)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--sampler", choices=tuple(SAMPLERS), default="bayes_ssi")
    parser.add_argument("--seeds", default="0:10", help="first:last + 1")
    parser.add_argument("--only", help="names of problems, separated by commas")
    parser.add_argument("--live", type=int, default=500, help="live points of dynesty")
    parser.add_argument("--time-limit", type=int, default=200, help="CPU seconds of a run")
    parser.add_argument("--summary", action="store_true")
    options = parser.parse_args()
    if options.summary:
        runs = [
            run
            for file in options.files
            for each in quoted_draws.read(file).values()
            for run in each
        ]
        summary(runs)
        return
    for name in options.only.split(",") if options.only else PROBLEMS:
        bs.sample(of_study("shear_building", "1-a"), 1000)  # imports are not compared
        for seed in range(*map(int, options.seeds.split(":"))):
            run = {"problem": name, "sampler": options.sampler, "seed": seed}
            run |= sample_within(options.sampler, name, seed, options.live, options.time_limit)
            quoted_draws.append(options.files[0], [run])
            print(f"{name}: {run}", flush=True)


if __name__ == "__main__":
    main()
