"""The curvature of -ln posterior as a record has it, not as records have it on average.

Where one process drives all modes, ratios between sensors are known far better than the spectrum
of the process, and the posterior is a narrow ridge that bends. There the information of the record
at hand differs from the expected (Fisher) information, and gives the errors that are conditional
on the record (Efron and Hinkley 1978); from the expected information they come out a fifth too
small.
"""

from __future__ import annotations

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.records.scoring import WeakPrior
from bayes_ssi.records.spectra import Spectra
from bayes_ssi.records.spectral_derivatives import gradient
from bayes_ssi.records.spectral_model import SpectralModel

# Gradients are differenced over so many expected standard deviations.
STEP = 0.01


def observed_curvature(
    model: SpectralModel, data: Spectra, q: int, prior: WeakPrior, expected: FloatArray
) -> FloatArray | None:
    """The second derivatives (p, p) of -ln posterior, from differences of its gradient.

    Args:
        model: the most probable one.
        data: spectral matrices.
        q: how often accelerations were integrated.
        prior: of the coordinates.
        expected: (p, p), the expected curvature, whose principal axes are those of the steps.

    Returns:
        The curvature; None where the posterior has no maximum at the model.
    """
    values, vectors = np.linalg.eigh(expected)
    steps = STEP * vectors / np.sqrt(values)
    here = _slope(model, data, q, prior, np.zeros(len(values)))
    differences = [_slope(model, data, q, prior, step) - here for step in steps.T]
    # In units of expected standard deviations, where all entries are about one.
    relative = steps.T @ np.array(differences).T / STEP**2
    relative = 0.5 * (relative + relative.T)
    if np.linalg.eigvalsh(relative)[0] <= 0.0:
        return None
    back = vectors * np.sqrt(values)
    curvature: FloatArray = back @ relative @ back.T
    return curvature


def _slope(
    model: SpectralModel, data: Spectra, q: int, prior: WeakPrior, step: FloatArray
) -> FloatArray:
    """The gradient of -ln posterior after a step, in the coordinates of the model."""
    at, (n_columns, n, _) = model.layout, model.planes.shape
    moved = model.moved(step)
    slope = gradient(moved, data, q)
    # Planes at the moved shapes are others: shapes are s = (s₀ + B t) / |s₀ + B t|.
    in_space = np.einsum("ict,it->ic", moved.planes, slope[at.shapes].reshape(n_columns, n - 1))
    offsets = step[at.shapes].reshape(n_columns, n - 1)
    lengths = np.sqrt(1.0 + (offsets**2).sum(1, keepdims=True))
    slope[at.shapes] = (np.einsum("ict,ic->it", model.planes, in_space) / lengths).ravel()
    off = prior.off(moved)
    off[at.shapes] = step[at.shapes]
    return slope + prior.precisions * off
