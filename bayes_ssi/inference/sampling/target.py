"""What is sampled: a log-likelihood over standard-normal coordinates, evaluated in batches."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.workers.journal import Journal
from bayes_ssi.inference.workers.workers import Evaluated, Function, Workers, evaluate

# Points of a journal that are evaluated again, to see that the model is still the same: a change
# of the model would hardly spare all of them.
POINTS_TO_CHECK = 3
# By which share points are moved to be asked twice, as what a model remembers would show no noise,
# and how many nats count as rounding then.
NUDGE, ROUNDING = 1e-13, 1e-5
# Coordinates end here: farther out the prior's density, and the probability that the mapping to
# parameters begins with, vanish in double precision. Proposals with heavy tails go there.
FARTHEST = 38.0
# Positions (n, d) → log density and log-likelihood, (n,) each.
LogDensity = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def log_standard_normal(z: FloatArray) -> FloatArray:
    """log N(z; 0, I), (B,), for ``z`` (B, d)."""
    return -0.5 * np.einsum("bd,bd->b", z, z) - 0.5 * z.shape[1] * np.log(2.0 * np.pi)


class SuggestedStarts(NamedTuple):
    """Where a target that knows its problem expects maxima."""

    z: FloatArray  # (m, d), coordinates near them with a positive likelihood; m may be zero
    n_evaluations: int


@dataclass
class Target:
    """A log-likelihood over coordinates whose prior is N(0, I); counts its evaluations."""

    function: Function  # (B, d) coordinates → (B,) log-likelihoods; row i depends on row i alone
    n_dimensions: int
    workers: Workers | None = None  # where it is evaluated; in this process if None
    journal: Journal | None = None
    # Where a search should climb from besides its own draws, which each search calls with its own
    # generator; None where all that is known is the log-likelihood.
    suggest_starts: Callable[[np.random.Generator], SuggestedStarts] | None = None
    # (m, d), near maxima that an earlier search found, which counts as one of the independent
    # searches; None if there was none.
    known_starts: FloatArray | None = None
    # Coordinates (B, d) → parameter values (B, d), of which chains are judged; the coordinates
    # themselves if None.
    parameter_values: Callable[[FloatArray], FloatArray] | None = None
    # Whether hardly any parameter has an influence on it, which is then no reason for doubt.
    is_flat: bool = False
    noise: float = field(default=0.0, init=False)  # in nats, where it was measured
    n_evaluations: int = field(default=0, init=False)
    # Points at which the function raised, returned NaN or lost its worker; they count as likelihood
    # zero.
    n_failed: int = field(default=0, init=False)
    # The point (d,) at which it failed first, and why.
    first_failure: tuple[FloatArray, str] | None = field(default=None, init=False)

    def log_likelihood(self, z: FloatArray) -> FloatArray:
        """The log-likelihood (B,) at ``z`` (B, d); -inf where the function failed.

        It counts as -inf, and is not evaluated, where a coordinate is beyond ``±FARTHEST``.
        """
        beyond = (np.abs(z) > FARTHEST).any(axis=1)
        if beyond.any():
            values = np.full(len(z), -np.inf)
            values[~beyond] = self.log_likelihood(z[~beyond])
            return values
        if not len(z):
            return np.empty(0)
        values, reasons = self._evaluate(z) if self.journal is None else self._recall(z)
        self.n_evaluations += len(z)
        failed = np.isnan(values)
        if failed.any():
            self.n_failed += int(failed.sum())
            if self.first_failure is None:
                row = int(np.argmax(failed))
                # NaN in a batch: evaluated alone, the point may give a reason.
                alone = {} if row in reasons else self._evaluate(z[[row]]).failures
                reason = reasons.get(row) or alone.get(0, "the answer is NaN")
                self.first_failure = (z[row].copy(), reason)
            values = np.where(failed, -np.inf, values)
        if np.isposinf(values).any():
            where = np.array2string(z[np.isposinf(values)][0], precision=3)
            raise ValueError(
                f"the log-likelihood is +inf at coordinates {where}: did an error size go to zero "
                "where the data are fitted exactly? Give it a prior that keeps away from zero, "
                "such as LogNormal"
            )
        return values

    def log_posterior(self, z: FloatArray) -> FloatArray:
        """log-likelihood + log prior density, (B,): the posterior up to the evidence."""
        return self.log_density(z)[0]

    def log_density(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The log posterior and the log-likelihood, (B,) each."""
        values = self.log_likelihood(z)
        return values + log_standard_normal(z), values

    def values_of_chains(self, chains: FloatArray) -> FloatArray:
        """Parameter values at chains (n_chains, n_steps, d), of the same shape."""
        if self.parameter_values is None:
            return chains
        return self.parameter_values(chains.reshape(-1, chains.shape[-1])).reshape(chains.shape)

    def is_noisy_at(self, z: FloatArray) -> bool:
        """Whether answers differ at the first of ``z`` (n, d) moved in the last digits; kept."""
        z = z[:POINTS_TO_CHECK]
        once, again = self.log_likelihood(np.concatenate([z, z * (1.0 + NUDGE)])).reshape(2, -1)
        with np.errstate(invalid="ignore"):
            noise = float(np.abs(again - once).max())
        self.noise = noise if ROUNDING < noise < np.inf else 0.0
        return self.noise > 0.0

    def suggested(self, rng: np.random.Generator) -> FloatArray:
        """Suggested starts (m, d) of one search; none where nothing suggests any."""
        if self.suggest_starts is None:
            return np.empty((0, self.n_dimensions))
        recalled = self.journal and self.journal.recalled_suggestion(self.n_dimensions)
        # A child: what follows is the same whether they are recalled or not.
        rng_of_starts = rng.spawn(1)[0]
        z, n_evaluations = recalled or self.suggest_starts(rng_of_starts)
        if self.journal and not recalled:
            self.journal.add_suggestion(z, n_evaluations)
        self.n_evaluations += n_evaluations
        return z

    def _recall(self, z: FloatArray) -> Evaluated:
        """Values from the journal, or else new ones, which are added to it."""
        assert self.journal is not None
        recalled = self.journal.recalled(z)
        if recalled is None:
            recalled = self._evaluate(z)
            self.journal.add(z, recalled)
        elif self.n_evaluations == 0:
            again = self._evaluate(z[:POINTS_TO_CHECK]).values
            if not np.allclose(again, recalled.values[:POINTS_TO_CHECK], 1e-6, equal_nan=True):
                raise ValueError(
                    f"{self.journal.path}: the model gives other values than when this checkpoint "
                    "was made; remove it to begin again"
                )
        return recalled

    def _evaluate(self, z: FloatArray) -> Evaluated:
        if self.workers is None:
            return evaluate(self.function, z)
        return self.workers.evaluate(self.function, z)
