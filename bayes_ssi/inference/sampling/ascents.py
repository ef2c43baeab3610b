"""Many local ascents to maxima of a posterior at once.

A batch holds what all of them ask for next: as of a small structure a batch takes hardly longer
than one row, there are to be few.
"""

import math

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, IntArray
from bayes_ssi.inference.sampling.target import Target

# In prior standard deviations. Forward differences, whose truncation and rounding errors balance
# for log-likelihoods of some thousand nats.
GRADIENT_STEP = 1e-6
# Where a model is noisy: over the root of the noise, the best at sd 0.03.
STEP_OVER_NOISE = 0.05
# An ascent along a curved ridge may need more steps: `maxima_near` continues it once.
STEPS_OF_ASCENT = 60
LONGEST_STEP = 2.0
STEP_LENGTHS = np.array([1.0, 0.4, 0.1, 0.01])  # tried together, as shares of the BFGS step
LEAST_RISE = 1e-3  # nats of the last step
# Ascents also end where so many steps rise by less than this share of the least: they creep up to
# an edge, over which the log posterior falls.
MOST_CREEPING, CREEPING = 6, 0.1


def ascend(
    target: Target, starts: FloatArray, inverse: FloatArray, axes: FloatArray | None = None,
    least_rise: float = LEAST_RISE,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """All ascents by BFGS with finite differences: end points and their log posteriors.

    ``inverse`` (S, k, k) are the first inverse Hessians, along the orthonormal ``axes`` (k, d) that
    ascents keep to; those of the coordinates if None. Gains below ``least_rise`` end them.
    """
    ascents = _Ascents(target, starts, inverse, axes, least_rise)
    while len(ascents.active):
        ascents.go_on()
    return ascents.z, ascents.value


class _Ascents:
    """S ascents, each of which tries a step, or asks for the gradient where its last one led."""

    def __init__(
        self, target: Target, starts: FloatArray, inverse: FloatArray, axes: FloatArray | None,
        least_rise: float,
    ) -> None:  # fmt: skip
        self.target, self.z = target, np.array(starts, dtype=float)  # (S, d)
        n, d = self.z.shape
        self.axes = np.eye(d) if axes is None else axes
        self.inverse = inverse.copy()
        self.difference = max(GRADIENT_STEP, STEP_OVER_NOISE * math.sqrt(target.noise))
        self.least_rise = max(least_rise, 3.0 * target.noise)
        self.last_step, self.gradient = np.zeros((2, n, len(self.axes)))
        self.reach, (self.n_steps, self.n_creeping) = np.ones(n), np.zeros((2, n), dtype=int)
        # Whether the gradient at z is known, and whether the last step was a full one: the next one
        # then tends to be, so that the gradient at its end is asked for along with it.
        self.has_gradient, self.was_full = np.zeros((2, n), dtype=bool)
        self.value, ahead = self._log_posteriors(self.z, self._ahead_of(self.z))
        self.active = np.flatnonzero(np.isfinite(self.value))
        self._set_gradients(self.active, ahead[self.active])

    def go_on(self) -> None:
        """All by one batch."""
        ready = self.has_gradient[self.active]
        asking, trying = self.active[~ready], self.active[ready]
        steady = np.flatnonzero(self.was_full[trying])
        tried, expected = self._tried_steps(trying)
        ends = self.z[trying] + tried @ self.axes
        values, of_asking, of_steady = self._log_posteriors(
            ends, self._ahead_of(self.z[asking]), self._ahead_of(ends[0, steady])
        )
        self._set_gradients(asking, of_asking)
        best, which = values.argmax(axis=0), np.arange(len(trying))
        rise = values[best, which] - self.value[trying]
        better = rise > 0
        self.was_full[trying] = better & (best == 0)
        best, which, moved = best[better], which[better], trying[better]
        self.z[moved], self.value[moved] = ends[best, which], values[best, which]
        self.last_step[moved], self.has_gradient[moved] = tried[best, which], False
        full = self.was_full[trying[steady]]
        self._set_gradients(trying[steady[full]], of_steady[full])
        self._finish(trying, rise, expected)

    def _tried_steps(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Steps (4, n, k) to try, and the rise that the gradient promises (n,)."""
        slope = self.gradient[rows]
        direction = np.einsum("nij,nj->ni", self.inverse[rows], slope)
        expected = np.einsum("nd,nd->n", direction, slope)
        lengths = np.linalg.norm(direction, axis=1)
        direction *= np.minimum(1.0, LONGEST_STEP / np.maximum(lengths, 1e-300))[:, None]
        return (STEP_LENGTHS[:, None] * self.reach[rows])[..., None] * direction, expected

    def _finish(self, rows: IntArray, rise: FloatArray, expected: FloatArray) -> None:
        """What steps of some ascents come to: where they end, or how far they try next."""
        better = rise > 0
        # An ascent without a rise tries shorter steps; after a rise it returns to full steps.
        self.reach[rows] = np.where(better, 1.0, self.reach[rows] * STEP_LENGTHS[-1])
        self.n_creeping[rows] += better & (rise < CREEPING * self.least_rise)
        self.n_steps[rows] += 1
        finished = better & (rise < self.least_rise) & (expected < 10 * self.least_rise)
        finished |= (self.reach[rows] < 1e-5) | (self.n_creeping[rows] >= MOST_CREEPING)
        finished |= self.n_steps[rows] >= STEPS_OF_ASCENT
        self.active = np.setdiff1d(self.active, rows[finished], assume_unique=True)

    def _ahead_of(self, z: FloatArray) -> FloatArray:
        """Points (n, k, d) beside z (n, d), for forward differences along the axes."""
        return z[:, None, :] + self.difference * self.axes

    def _log_posteriors(self, *points: FloatArray) -> list[FloatArray]:
        """At points (..., d), all in one batch."""
        rows = [each.reshape(-1, each.shape[-1]) for each in points]
        values = self.target.log_posterior(np.concatenate(rows))
        parts = np.split(values, np.cumsum([len(each) for each in rows[:-1]]))
        return [part.reshape(each.shape[:-1]) for part, each in zip(parts, points, strict=True)]

    def _set_gradients(self, rows: IntArray, ahead: FloatArray) -> None:
        """From log posteriors (n, k) ahead; with the BFGS update where the curvature allows it."""
        rise = ahead - self.value[rows, None]
        gradient = np.nan_to_num(rise / self.difference, nan=0.0, posinf=0.0, neginf=0.0)
        step, fall = self.last_step[rows], self.gradient[rows] - gradient
        self.gradient[rows], self.has_gradient[rows] = gradient, True
        curvature = np.einsum("nd,nd->n", step, fall)
        curved = curvature > 1e-12
        rows, step, fall, curvature = rows[curved], step[curved], fall[curved], curvature[curved]
        scale = curvature[:, None, None]
        left = np.eye(step.shape[1]) - step[:, :, None] * fall[:, None, :] / scale
        self.inverse[rows] = (
            left @ self.inverse[rows] @ left.transpose(0, 2, 1)
            + step[:, :, None] * step[:, None, :] / scale
        )
