"""The most probable spectral model under weak normal priors, by damped Fisher scoring."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.identification.shape_density import log_sphere_area
from bayes_ssi.records.spectra import Spectra
from bayes_ssi.records.spectral_derivatives import derivatives
from bayes_ssi.records.spectral_model import Layout, SpectralModel, misfit, transfer

# Structures in service mostly have a damping of 0.5 to 4 %, two thirds within this factor.
DAMPING, LOG_DAMPING_SD = 0.015, 1.0
# A sensor's own noise is between a millionth and all of its power in the band, with 95 %.
LOG_NOISE, LOG_NOISE_SD = 0.5 * math.log(1e-6), 0.25 * math.log(1e6)
# Loads mostly have spectra between f² and f⁻², bent a little: those of wind fall as f^(-5/3).
COLOUR_SD = (2.0, 1.0)
# Damping of steps as a share of the curvature: at first, and by what it changes (Marquardt 1963).
FIRST_DAMPING, DAMPING_FACTOR, MOST_DAMPING = 1e-3, 5.0, 1e10
MOST_STEPS = 100
# A climb that ends at the most steps has arrived if one more should gain less than this in nats:
# the most probable modes are then within a third of a standard deviation.
ARRIVED = 0.05
# A step goes no further than this in ln f (in dampings), ln ζ, ln s and shapes: the derivatives
# say nothing of what lies beyond.
LONGEST = {"log_frequencies": 2.0, "log_dampings": 1.0, "log_noise": 2.0, "shapes": 0.3}
# Heavier damping than that of any structure in service: such a resonance stands for something else.
HEAVIEST = 0.2


@dataclass(frozen=True, eq=False)
class WeakPrior:
    """Independent normal priors of the coordinates of a model.

    Uniform shapes are normal in their planes, with half the area of the sphere as volume.

    Attributes:
        centres: (p,); those of shapes are not used, since a plane begins at its shape.
        precisions: (p,)
    """

    centres: FloatArray
    precisions: FloatArray

    @classmethod
    def of(cls, model: SpectralModel, data: Spectra, q: int) -> WeakPrior:
        """The prior for the spectral matrices of a band."""
        at = model.layout
        centres, precisions = np.zeros(at.n_coordinates), np.zeros(at.n_coordinates)
        low, high = np.log(data.frequencies_hz[[0, -1]])
        centres[at.log_frequencies] = 0.5 * (low + high)
        precisions[at.log_frequencies] = (0.5 * (high - low)) ** -2
        centres[at.log_dampings] = math.log(DAMPING)
        precisions[at.log_dampings] = LOG_DAMPING_SD**-2
        power = data.matrices.diagonal(axis1=1, axis2=2).real
        # Forces of this density, on modes of usual damping, cause the power of the band.
        usual = replace(model, log_dampings=np.full(model.n_modes, math.log(DAMPING)))
        caused = (np.abs(transfer(usual, data.frequencies_hz, q)) ** 2).sum(1)
        precisions[at.diagonal.start : at.imaginary.stop] = caused.mean() / power.sum(1).mean()
        n = len(model.shapes)
        half = log_sphere_area(n) - math.log(2.0)
        precisions[at.shapes] = 2.0 * math.pi * math.exp(-2.0 * half / (n - 1))
        centres[at.log_noise] = LOG_NOISE + np.log(power.mean(0))
        precisions[at.log_noise] = LOG_NOISE_SD**-2
        precisions[at.colour] = np.array(COLOUR_SD)[: len(model.colour)] ** -2
        return cls(centres, precisions)

    def with_noise(self, log_noise: FloatArray, at: Layout) -> WeakPrior:
        """The prior with noise known to one part in a hundred."""
        centres, precisions = self.centres.copy(), self.precisions.copy()
        centres[at.log_noise], precisions[at.log_noise] = log_noise, 1e4
        return WeakPrior(centres, precisions)

    def off(self, model: SpectralModel) -> FloatArray:
        """How far the model is from the centres (p,)."""
        off = coordinates(model) - self.centres
        off[model.layout.shapes] = 0.0
        return off

    def penalty(self, model: SpectralModel) -> float:
        """-ln prior without its constant."""
        return 0.5 * float((self.precisions * self.off(model) ** 2).sum())

    @property
    def log_constant(self) -> float:
        """ln of the density at the centres."""
        return 0.5 * float(np.log(self.precisions / (2.0 * math.pi)).sum())


class MostProbable(NamedTuple):
    """The most probable model.

    Attributes:
        model: its modes, forces and noise.
        curvature: (p, p), of -ln posterior in the coordinates of the model.
        settled: whether the climb has arrived; a climb ends on the way where a mode has left the
            band or becomes no resonance of a structure, and does not come back from there.
    """

    model: SpectralModel
    curvature: FloatArray
    settled: bool


def most_probable(
    model: SpectralModel, data: Spectra, q: int, prior: WeakPrior, settled: float
) -> MostProbable:
    """Climb to the most probable model.

    Args:
        model: where to begin.
        data: spectral matrices.
        q: how often accelerations were integrated.
        prior: of the coordinates.
        settled: the climb ends when a step should gain less than this, in nats.
    """
    now = derivatives(model, data, q)
    value = now.misfit + prior.penalty(model)
    precisions = np.diag(prior.precisions)
    damping = FIRST_DAMPING
    n_steps = 0
    while True:
        if not are_modes(model, data).all():
            return MostProbable(model, now.information + now.bending + precisions, settled=False)
        slope = now.gradient + prior.precisions * prior.off(model)
        curvature = now.information + now.bending + precisions
        while True:
            damped = curvature + damping * np.diag(curvature.diagonal())
            step = np.asarray(-np.linalg.solve(damped, slope), dtype=np.float64)
            gain = -0.5 * float(slope @ step)
            if gain < settled or n_steps == MOST_STEPS or damping > MOST_DAMPING:
                return MostProbable(model, curvature, gain < max(settled, ARRIVED))
            trial = model.moved(_shortened(step, model))
            n_steps += 1
            tried = misfit(trial, data, q) + prior.penalty(trial)
            if tried < value:
                damping /= DAMPING_FACTOR
                break
            damping *= DAMPING_FACTOR
        model, value = trial, tried
        now = derivatives(model, data, q)


def are_modes(model: SpectralModel, data: Spectra) -> NDArray[np.bool_]:
    """Whether each resonance is within the band, and damped no more than structures are (m,)."""
    low, high = np.log(data.frequencies_hz[[0, -1]])
    frequencies = model.log_frequencies
    in_band = (frequencies > low) & (frequencies < high)
    are: NDArray[np.bool_] = in_band & (model.log_dampings < math.log(HEAVIEST))
    return are


def _shortened(step: FloatArray, model: SpectralModel) -> FloatArray:
    """The step, made so short that no part of it is longer than the longest."""
    smallest = float(np.exp(model.log_dampings).min())
    share = 1.0
    for part, longest in LONGEST.items():
        longest *= smallest if part == "log_frequencies" else 1.0
        most = np.abs(step[getattr(model.layout, part)]).max()
        share = min(share, longest / max(float(most), np.finfo(float).tiny))
    return share * step


def coordinates(model: SpectralModel) -> FloatArray:
    """(p,): ln f, ln ζ, entries of L, ln s, c; zero for shapes, the origins of their planes."""
    at = model.layout
    rows, columns = np.tril_indices(len(model.forces), -1, model.forces.shape[1])
    vector = np.zeros(at.n_coordinates)
    vector[at.log_frequencies] = model.log_frequencies
    vector[at.log_dampings] = model.log_dampings
    vector[at.diagonal] = model.forces.diagonal().real
    vector[at.real] = model.forces[rows, columns].real
    vector[at.imaginary] = model.forces[rows, columns].imag
    vector[at.log_noise] = model.log_noise
    vector[at.colour] = model.colour
    return vector
