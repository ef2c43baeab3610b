"""A part of the spectrum explained by modes: their errors in channels, and how sure each peak is.

How close two modes may be and still be told apart follows from the record's length: two equal modes
with the same shape, d half-power bandwidths apart, fit better than one by (π/4) d⁴ ζ f T nats to
leading order in d, whether their forces are coherent or not, since the best single mode takes up
all else.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.local_fit import LocalFit
from bayes_ssi.measurements.records.resonances import Resonances


class ExplainedPeak(NamedTuple):
    """A peak of the spectra, and how its explanations compare with one mode with a real shape."""

    modes: tuple[int, ...]  # places of its modes among those of the band
    # By which one mode whose sensors have phases explains it better; what is rarer before has fewer
    # already.
    nats_of_phases: float
    nats_of_two: float  # by which two modes do

    @property
    def probabilities(self) -> tuple[float, float]:
        """Of phases, and of two modes."""
        nats = np.array([0.0, self.nats_of_phases, self.nats_of_two])
        highest = nats.max()
        if not math.isfinite(highest):
            return 0.0, 0.0
        shares = np.exp(np.maximum(nats - highest, -700.0))
        _, phases, two = (shares / shares.sum()).tolist()
        return phases, two


@dataclass(frozen=True, eq=False)
class Explained:
    """A band and its modes; those beside the search are not wanted, but known."""

    fit: LocalFit
    peaks: tuple[ExplainedPeak, ...]
    is_wanted: bool

    def distance_to(self, frequency_hz: float) -> float:
        """How far a frequency is from the middle of the band, in half bands."""
        low, high = self.band_hz
        return abs(2.0 * frequency_hz - low - high) / (high - low)

    def singular_values(self) -> FloatArray:
        """Of the fitted spectral matrices of all channels (K, r), descending."""
        data = self.fit.data
        squares = data.to_channels.T @ data.to_channels
        factors = np.linalg.cholesky(self.fit.covariances)
        turned: ComplexArray = factors.conj().swapaxes(1, 2) @ squares @ factors
        return np.asarray(np.linalg.eigvalsh(turned)[:, ::-1], dtype=np.float64)

    @property
    def excess(self) -> float:
        """Chi-square over what is allowed."""
        return self.fit.whiteness / self.fit.allowed_whiteness

    @property
    def doubt(self) -> str | None:
        """Why errors that are claimed may be wrong; None if all is well."""
        low, high = self.band_hz
        where = f"from {low:.4g} to {high:.4g} Hz"
        if not self.fit.converged:
            return f"{where} the most probable modes were not reached"
        if self.excess > 1.0:
            return (
                f"{where} the modes do not explain the spectra (chi-square over degrees of freedom "
                f"{self.fit.whiteness:.2f}, allowed {self.fit.allowed_whiteness:.2f}); errors "
                f"are {math.sqrt(self.fit.whiteness):.2g} times as large as otherwise"
            )
        return None

    def estimates(
        self, places: Sequence[int], channels: Sequence[int]
    ) -> tuple[Resonances, FloatArray]:
        """Some of its modes in some channels, with real shapes, and the covariance of their errors.

        It is that of (ln f, ln ζ, shapes), shapes mode by mode. Errors grow by the root of
        chi-square where that is more than is allowed.
        """
        fit, data = self.fit, self.fit.data
        rest, variances = rest_of_shapes(fit)
        r, m = fit.modes.shapes.shape
        n, n_places = len(channels), len(places)
        to_channels, rest_to_channels = data.to_channels[channels], data.rest_to_channels[channels]
        shapes = np.empty((n, n_places))
        jacobian = np.zeros((n_places * (2 + n), 2 * m * (1 + r)))
        of_rest = np.zeros((n_places * (2 + n), n_places * (2 + n)))
        for k, i in enumerate(places):
            jacobian[k, i] = jacobian[n_places + k, m + i] = 1.0
            full = data.to_channels @ fit.modes.shapes[:, i] + data.rest_to_channels @ rest[:, i]
            turn = np.exp(-0.5j * np.angle((full**2).sum()))
            real = (turn * full).real[channels]
            length = np.linalg.norm(real)
            shape = shapes[:, k] = real / length
            across = (np.eye(n) - np.outer(shape, shape)) / length
            rows = slice(2 * n_places + k * n, 2 * n_places + (k + 1) * n)
            at = 2 * m + i * r
            jacobian[rows, at : at + r] = turn.real * (across @ to_channels)
            at += m * r
            jacobian[rows, at : at + r] = -turn.imag * (across @ to_channels)
            outside = across @ rest_to_channels
            of_rest[rows, rows] = variances[i] * outside @ outside.T
        covariance = jacobian @ fit.covariance @ jacobian.T + of_rest
        if self.excess > 1.0:
            covariance *= fit.whiteness
        return fit.modes.at(places)._replace(shapes=shapes), covariance

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency."""
        return self.fit.data.band_hz

    @property
    def modes(self) -> Resonances:
        """In channels; all that the leading directions show."""
        shapes = self.fit.data.to_channels @ self.fit.modes.shapes
        return self.fit.modes._replace(shapes=shapes / np.linalg.norm(shapes, axis=0))


def resolution(fit: LocalFit, i: int) -> float:
    """Half-power bandwidths by which two modes of one shape must differ to be told from one."""
    width = 2.0 * float(fit.modes.half_widths_hz[i])
    n_lines = max(math.e, width / fit.data.line_hz)
    r = fit.modes.shapes.shape[0]
    cost = 0.5 * (3 * r + 1) * math.log(n_lines)
    return float((8.0 * cost / (math.pi * n_lines)) ** 0.25)


def rest_of_shapes(fit: LocalFit) -> tuple[ComplexArray, FloatArray]:
    """Shapes in all other directions (n - r, m), and the variance of each component (m,).

    Cross spectra of these with the leading directions are linear in them.
    """
    data, m = fit.data, fit.modes.shapes.shape[1]
    if not data.rest.shape[1]:
        return np.zeros((0, m), dtype=complex), np.zeros(m)
    factors = np.linalg.inv(np.linalg.cholesky(fit.covariances)).conj().swapaxes(1, 2)
    factors = factors * np.sqrt(data.weights)[:, None, None]
    at = fit.scene
    h = fit.model.h(at)
    forces = fit.model.drive.forces(at, fit.modes, h)
    r = data.matrices.shape[1]
    smooth = at.powers[:2].T[:, :, None, None] * np.eye(r)
    rows = np.concatenate(
        [
            (h[:, None] * forces.conj()).swapaxes(1, 2),
            fit.model.drive.crosses(at, fit.modes, h),
            smooth.reshape(len(h), 2 * r, r),
        ],
        axis=1,
    )
    regressors = (rows @ factors).swapaxes(1, 2).reshape(-1, rows.shape[1])
    targets = (data.rest @ factors).transpose(0, 2, 1).reshape(-1, data.rest.shape[1])
    products = regressors.conj().T @ regressors
    products += 1e-9 * np.diag(products.diagonal())
    solution = np.linalg.solve(products, regressors.conj().T @ targets)
    variances = 0.5 * np.linalg.inv(products).diagonal().real[:m]
    return solution[:m].T, np.asarray(variances, dtype=np.float64)
