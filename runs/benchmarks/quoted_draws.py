"""Are quoted posterior draws chains of emcee's, and how good are they by arviz?"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import arviz
import emcee
import numpy as np

Array = np.ndarray
# Chains may keep every second, third … step; more are not looked for.
MOST_THINNED = 20


@contextmanager
def watching_emcee() -> Iterator[Callable[[], list[Array]]]:
    """A function that returns, and forgets, the steps of all emcee samplers made meanwhile.

    Each are (n_steps, n_walkers, d) coordinates; those of samplers that store no steps are left
    out.
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
    columns = [np.ascontiguousarray(draws[..., i]) for i in range(draws.shape[-1])]
    return {
        "n_chains": draws.shape[0],
        "n_draws": draws.shape[0] * draws.shape[1],
        "ess_bulk": min(float(arviz.ess(each, method="bulk")) for each in columns),
        "ess_tail": min(float(arviz.ess(each, method="tail")) for each in columns),
        "r_hat": max(float(arviz.rhat(each)) for each in columns),
    }
