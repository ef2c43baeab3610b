"""Are quoted posterior draws chains of emcee's, and how good are they by arviz? Runs in files."""

from __future__ import annotations

import gc
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import emcee
import numpy as np

from bayes_ssi.foundations import arviz_functions

Array = np.ndarray
Run = dict[str, Any]
# Chains may keep every second, third … step; more are not looked for.
MOST_THINNED = 100
TAILS = (0.05, 0.95)  # arviz's first generation takes these where none are given


@contextmanager
def watching_emcee() -> Iterator[Callable[[], list[Array]]]:
    """A function that returns, and forgets, the steps of all emcee samplers made meanwhile.

    Each are (n_steps, n_walkers, d) coordinates; none of samplers that store no steps.
    """
    made: list[emcee.EnsembleSampler] = []
    begin = emcee.EnsembleSampler.__init__

    def noted(sampler: emcee.EnsembleSampler, *args: Any, **options: Any) -> None:
        begin(sampler, *args, **options)
        made.append(sampler)

    def steps() -> list[Array]:
        stored = [sampler.get_chain() for sampler in made if sampler.backend.iteration]
        made.clear()
        gc.collect()
        return stored

    with patch.object(emcee.EnsembleSampler, "__init__", noted):
        yield steps


def share_of_emcee(draws: Array, steps: Sequence[Array]) -> float:
    """Share of the chains (n_chains, n_draws, d) that are the way of one of emcee's walkers.

    Its steps in their order, all of them or every second, third …; ``steps`` are those of the
    samplers, (n_steps, n_walkers, d) each, in the draws' coordinates.
    """
    return float(np.mean([any(_is_way(chain, each) for each in steps) for chain in draws]))


def _is_way(chain: Array, steps: Array) -> bool:
    ends = np.isclose(steps, chain[-1], rtol=1e-9, atol=0.0).all(axis=-1)
    n = len(chain)
    for last, walker in np.argwhere(ends):
        for thinned in range(1, min(MOST_THINNED, last // max(n - 1, 1)) + 1):
            way = steps[last - (n - 1) * thinned : last + 1 : thinned, walker]
            if np.allclose(way, chain, rtol=1e-9, atol=0.0):
                return True
    return False


def diagnostics(draws: Array) -> dict[str, float]:
    """arviz's bulk and tail effective sample sizes and R-hat of draws (n_chains, n_draws, d).

    Of all coordinates, the least and the largest.
    """
    arviz = arviz_functions.arviz()
    columns = [np.ascontiguousarray(draws[..., i]) for i in range(draws.shape[-1])]
    return {
        "n_chains": draws.shape[0],
        "n_draws": draws.shape[0] * draws.shape[1],
        "ess_bulk": min(float(arviz.ess(each, method="bulk")) for each in columns),
        "ess_tail": min(float(arviz.ess(each, method="tail", prob=TAILS)) for each in columns),
        "r_hat": max(float(arviz.rhat(each)) for each in columns),
    }


def quality(runs: Sequence[Run]) -> str:
    """What several runs quote, by :func:`diagnostics`, and ``emcee``, the share of its chains."""
    least = [min(run[key] for run in runs) for key in ("ess_bulk", "ess_tail")]
    below = [sum(run[key] < 400 for run in runs) for key in ("ess_bulk", "ess_tail")]
    return (
        f"all quoted chains are emcee's in {sum(run['emcee'] == 1.0 for run in runs)} of "
        f"{len(runs)} runs; bulk ESS at least {least[0]:.0f}, below 400 in {below[0]}, tail ESS at "
        f"least {least[1]:.0f}, below 400 in {below[1]}; R-hat at most "
        f"{max(run['r_hat'] for run in runs):.3f}, above 1.01 in "
        f"{sum(not run['r_hat'] <= 1.01 for run in runs)}"
    )


def print_ratios(before: dict[str, list[Run]], after: dict[str, list[Run]]) -> None:
    """How evaluations and seconds of what both have changed; means over the runs of each."""
    both = [name for name in after if name in before]
    for key in ("evaluations", "seconds"):
        old, new = (
            np.array([np.mean([run[key] for run in runs[name]]) for name in both])
            for runs in (before, after)
        )
        low, middle, high = np.quantile(new / old, (0.1, 0.5, 0.9))
        print(
            f"{key} of {len(both)}, after over before: all {new.sum() / old.sum():.2f}, median "
            f"{middle:.2f}, tenths {low:.2f} and {high:.2f}; at most 0.75 in "
            f"{(new <= 0.75 * old).sum()}; most "
            + ", ".join(f"{both[i]} {new[i] / old[i]:.2f}" for i in np.argsort(-new / old)[:5])
        )


def append(file: Path, runs: Sequence[Run]) -> None:
    """A line of JSON for each run."""
    with file.open("a") as lines:
        lines.writelines(json.dumps(run) + "\n" for run in runs)


def read(file: Path, *keys: str) -> dict[str, list[Run]]:
    """The runs of a file, by the values of ``keys``."""
    runs: dict[str, list[Run]] = {}
    for run in map(json.loads, file.read_text().splitlines()):
        runs.setdefault(", ".join(str(run[key]) for key in keys), []).append(run)
    return runs
