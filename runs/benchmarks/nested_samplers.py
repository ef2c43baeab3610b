"""dynesty and nautilus at their defaults on one problem, within a limit of computing time."""

from __future__ import annotations

import multiprocessing
import resource
from collections.abc import Callable
from multiprocessing.connection import Connection
from time import process_time

import numpy as np
from known_evidence import Array, Problem, from_unit_cube

Answer = dict[str, float | str]


def likelihood(problem: Problem) -> Callable[[Array], Array]:
    """The log-likelihood of coordinates (B, d), -inf where the model fails."""
    return lambda z: np.nan_to_num(problem.log_likelihood(z), nan=-np.inf, neginf=-np.inf)


def dynesty_default(problem: Problem, seed: int) -> Answer:
    import dynesty

    log_likelihoods = likelihood(problem)
    sampler = dynesty.NestedSampler(
        lambda z: float(log_likelihoods(z[None])[0]),
        from_unit_cube,
        problem.n_dimensions,
        rstate=np.random.default_rng(seed),
    )
    sampler.run_nested(print_progress=False)
    result = sampler.results
    return {
        "log_evidence": float(result.logz[-1]),
        "claimed": float(result.logzerr[-1]),
        "evaluations": int(np.sum(result.ncall)),
    }


def nautilus_default(problem: Problem, seed: int) -> Answer:
    import nautilus

    sampler = nautilus.Sampler(
        from_unit_cube, likelihood(problem), n_dim=problem.n_dimensions, vectorized=True,
        pass_dict=False, seed=seed,
    )  # fmt: skip
    sampler.run()
    return {
        "log_evidence": float(sampler.log_z),
        "claimed": float(1.0 / np.sqrt(sampler.n_eff)),
        "evaluations": int(sampler.n_like),
    }


SAMPLERS = {"dynesty": dynesty_default, "nautilus": nautilus_default}


def sample_within(name: str, problem: Problem, seed: int, limit: int) -> Answer:
    """What the sampler answers, or why it has no answer, after at most ``limit`` CPU seconds."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, name, problem, seed, limit))
    process.start()
    sender.close()
    try:
        answer = receiver.recv()
    except EOFError:
        answer = {"unfinished": f"not finished after {limit} s"}
    process.join()
    return answer


def _answer(sender: Connection, name: str, problem: Problem, seed: int, limit: int) -> None:
    # The system ends the process there, whatever it is doing.
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    begun = process_time()
    try:
        answer = SAMPLERS[name](problem, seed)
    except Exception as error:  # noqa: BLE001 - whatever a sampler raises is its answer
        answer = {"unfinished": f"{type(error).__name__}: {error}"}
    sender.send({**answer, "seconds": process_time() - begun})
