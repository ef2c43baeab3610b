"""Modes of a band with their joint uncertainty, from the spectral matrices (Bayesian FFT).

All modes of the band are identified together, so that close modes need nothing else. The most
probable modes, forces and noise are found from spectral matrices that are averaged over blocks of
lines; the covariance is the inverse curvature of -ln posterior there (Yuen and Katafygiotis 2003;
Au 2017, Operational Modal Analysis). Averages are repeated with every line divided by what the
model says of it, until the modes do not move: whitened lines can be averaged without loss.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import ComplexArray, FloatArray
from bayes_ssi.records.modal_estimates import ModalEstimates, Poles, with_positive_largest
from bayes_ssi.records.observed_curvature import observed_curvature
from bayes_ssi.records.scoring import MostProbable, WeakPrior, are_modes, most_probable
from bayes_ssi.records.spectra import Lines, Spectra, spectra
from bayes_ssi.records.spectral_derivatives import gain_of_mode
from bayes_ssi.records.spectral_model import SpectralModel, covariances, misfit

# Where to begin: with noise as a share of the sensor's power that leaves no narrow valleys, until
# a step gains less than a nat; then with the noise to be found, until it gains no more than moves
# modes by a few hundredths of a standard deviation.
FIRST_NOISE = 0.01
ROUGH, FINE = 1.0, 1e-3
# Averages are repeated until no frequency or damping moves by more than this, in standard
# deviations, or this often.
STILL, MOST_PASSES = 0.05, 8


class Loads(NamedTuple):
    """What drives the modes.

    Attributes:
        moving_ground: whether sensors also measure a quasi-static motion, as absolute
            accelerations do when the ground moves.
        n_sources: independent processes; None for as many as there are modes, and the
            quasi-static motion.
        coloured: whether their spectra change with frequency, all alike.
    """

    moving_ground: bool = False
    n_sources: int | None = None
    coloured: bool = False

    def __str__(self) -> str:
        if not self.moving_ground:
            name = "independent loads"
        elif self.n_sources is None:
            name = "ground motion and independent loads"
        else:
            name = "ground motion in one direction"
        return f"{name}, coloured" if self.coloured else name


@dataclass(frozen=True, eq=False)
class BandFit:
    """The most probable modes of a band under some loads.

    Attributes:
        loads: what drives the modes.
        model: modes, forces and noise, in units in which the mean power of the band is one.
        data: the spectral matrices, averaged as the model says.
        n_tapers: (K,), of their blocks.
        q: how often accelerations were integrated.
        curvature: (p, p), of -ln posterior in the model's coordinates, as the record has it.
        log_evidence: by Laplace's approximation, up to a constant of the lines.
        whiteness: chi-square of the whitened spectral matrices over degrees of freedom: about 1
            where the model is right.
        allowed_whiteness: the highest that leaves no doubt of the claimed uncertainty.
        settled: whether the climb to the most probable modes came to an end.
        is_maximum: whether the posterior has a maximum there, and not a saddle, as with one mode in
            place of two.
    """

    loads: Loads
    model: SpectralModel
    data: Spectra
    n_tapers: NDArray[np.intp]
    q: int
    curvature: FloatArray
    log_evidence: float
    whiteness: float
    allowed_whiteness: float
    settled: bool
    is_maximum: bool

    @property
    def is_most_probable(self) -> bool:
        """Whether these are the most probable modes."""
        return self.settled and self.is_maximum

    @property
    def is_white(self) -> bool:
        """Whether the modes are the most probable ones, and explain the spectral matrices."""
        return self.is_most_probable and self.whiteness <= self.allowed_whiteness

    @property
    def are_modes(self) -> NDArray[np.bool_]:
        """Whether each resonance is in the band, and damped no more than structures are (m,)."""
        return are_modes(self.model, self.data)

    @property
    def poles(self) -> Poles:
        """The modes without their errors, in the order of the model."""
        model, m = self.model, self.model.n_modes
        return Poles(np.exp(model.log_frequencies), np.exp(model.log_dampings), model.shapes[:, :m])

    def residuals(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies of the blocks (K,), and what each adds to the whiteness (K,).

        The squared deviations of the whitened spectral matrix from the unit matrix, over their
        number.
        """
        frequencies = self.data.frequencies_hz
        squares = _squares(covariances(self.model, frequencies, self.q), self.data)[0]
        return frequencies, self.n_tapers * squares / len(self.model.shapes) ** 2

    def explains(self, low_hz: float, high_hz: float) -> bool:
        """Whether the model is the most probable one, and explains a part of the band."""
        frequencies, added = self.residuals()
        inside = (frequencies > low_hz) & (frequencies < high_hz)
        allowed = allowed_whiteness(self.n_tapers[inside], len(self.model.shapes), 0)
        return self.is_most_probable and float(added[inside].mean()) <= allowed

    def nats_of_forces(self) -> FloatArray:
        """(m,): half the squared distance of every mode's forces from zero, in their covariance.

        About the logarithm by which the misfit is better with the mode than without.
        """
        at, forces = self.model.layout, self.model.forces
        rows, columns = np.tril_indices(len(forces), -1, forces.shape[1])
        row_of = np.concatenate([np.arange(forces.shape[1]), rows, rows])
        values = np.concatenate(
            [forces.diagonal().real, forces[rows, columns].real, forces[rows, columns].imag]
        )
        covariance = np.linalg.inv(self.curvature)[
            at.diagonal.start : at.imaginary.stop, at.diagonal.start : at.imaginary.stop
        ]
        nats = np.empty(self.model.n_modes)
        for i in range(len(nats)):
            own = np.flatnonzero(row_of == i)
            nats[i] = 0.5 * values[own] @ np.linalg.solve(covariance[np.ix_(own, own)], values[own])
        return nats

    @property
    def n_unknowns_of_a_mode(self) -> int:
        """Unknowns that one more mode brings."""
        n, (n_columns, n_sources) = len(self.model.shapes), self.model.forces.shape
        forces = 2 * n_sources + (1 if n_sources == n_columns else 0)
        return 2 + (n - 1) + forces

    def gain_of(self, candidate: Poles) -> float:
        """About how many nats the misfit falls by with one more mode."""
        frequency, damping = float(candidate.frequencies_hz[0]), float(candidate.dampings[0])
        mode = frequency, damping, candidate.shapes[:, 0]
        return gain_of_mode(self.model, self.data, self.q, mode)

    def estimates(self, band_hz: tuple[float, float], sensors: tuple[str, ...]) -> ModalEstimates:
        """The modes in ascending order, with the covariance of their errors."""
        model, at = self.model, self.model.layout
        m, n = model.n_modes, len(model.shapes)
        of_coordinates = np.linalg.inv(self.curvature)
        order = np.argsort(model.log_frequencies)
        shapes, signs = with_positive_largest(model.shapes[:, :m])
        # From coordinates to (ln f, ln ζ, shapes).
        turn = np.zeros((2 * m + m * n, at.n_coordinates))
        for place, i in enumerate(order):
            turn[place, at.log_frequencies.start + i] = 1.0
            turn[m + place, at.log_dampings.start + i] = 1.0
            first = at.shapes.start + i * (n - 1)
            rows = slice(2 * m + place * n, 2 * m + (place + 1) * n)
            turn[rows, first : first + n - 1] = signs[i] * model.planes[i]
        return ModalEstimates(
            "Bayesian FFT",
            band_hz,
            sensors,
            np.exp(model.log_frequencies[order]),
            np.exp(model.log_dampings[order]),
            shapes[:, order],
            turn @ of_coordinates @ turn.T,
        )


def fit_band(lines: Lines, starts: Poles, q: int, loads: Loads) -> BandFit:
    """The most probable modes of a band.

    Args:
        lines: of the record in the band.
        starts: modes to begin with, about right in frequency.
        q: how often accelerations were integrated: 0, 1 for velocities, 2 for displacements.
        loads: what drives the modes.

    Raises:
        ValueError: the band has fewer lines than the model has unknowns, or a sensor measures
            nothing in it.
    """
    power = (np.abs(lines.transforms) ** 2).mean(1)
    if not power.min() > 0.0:
        raise ValueError("a sensor measures nothing in the band")
    lines = lines._replace(transforms=lines.transforms / math.sqrt(power.sum()))
    data = spectra(lines)
    model = _start(data, starts, q, loads)
    n_unknowns, n_lines = model.layout.n_coordinates, int(lines.n_tapers.sum())
    if n_lines * len(power) < n_unknowns:
        raise ValueError(
            f"the band has {n_lines} lines of {len(power)} sensors, fewer than the {n_unknowns} "
            "unknowns of its modes; take a wider band, a longer record, or fewer modes"
        )
    if loads.n_sources is not None:
        model = _with_signs(model, data, q)
    prior = WeakPrior.of(model, data, q)
    known = prior.with_noise(model.log_noise, model.layout)
    found = most_probable(model, data, q, known, ROUGH)
    for _ in range(MOST_PASSES):
        before = found.model

        data = spectra(lines, partial(covariances, before, q=q))
        found = most_probable(before, data, q, prior, FINE)
        if not found.settled or _moved(before, found) < STILL:
            break  # where loads are others, it may not settle
    return _described(loads, found, lines, q, prior)


def _start(data: Spectra, starts: Poles, q: int, loads: Loads) -> SpectralModel:
    """A model at the starts, with forces that explain the power at their peaks."""
    power = data.matrices.diagonal(axis1=1, axis2=2).real
    accelerations = (2.0 * np.pi * data.frequencies_hz) ** (2 * q) * power.sum(1)
    nearest = np.abs(data.frequencies_hz[:, None] - starts.frequencies_hz).argmin(0)
    amplitudes = 2.0 * starts.dampings * np.sqrt(accelerations[nearest])
    shapes = starts.shapes
    if loads.moving_ground:
        # Where there is least power, all sensors move as the ground does.
        quiet = accelerations.argmin()
        motion = np.linalg.eigh(data.matrices[quiet].real)[1][:, -1]
        shapes = np.column_stack([shapes, motion])
        amplitudes = np.append(amplitudes, math.sqrt(accelerations[quiet]))
    if loads.n_sources is None:
        forces = np.diag(amplitudes)
    else:
        forces = np.tril(np.repeat(amplitudes[:, None], loads.n_sources, axis=1))
    return SpectralModel(
        np.log(starts.frequencies_hz),
        np.log(starts.dampings),
        shapes,
        forces.astype(complex),
        np.log(FIRST_NOISE * power.mean(0)),
        np.zeros(2 if loads.coloured else 0),
        float(np.sqrt(data.frequencies_hz[0] * data.frequencies_hz[-1])),
    )


def _with_signs(model: SpectralModel, data: Spectra, q: int) -> SpectralModel:
    """The model with those signs of forces of common sources that explain the record best.

    Each sign is turned if that explains it better, until none does.
    """
    best = misfit(model, data, q)
    turned = True
    while turned:
        turned = False
        for i in range(1, len(model.forces)):
            signs = np.ones((len(model.forces), 1))
            signs[i] = -1.0
            other = replace(model, forces=model.forces * signs)
            if (value := misfit(other, data, q)) < best:
                model, best, turned = other, value, True
    return model


def _moved(before: SpectralModel, found: MostProbable) -> float:
    """The largest move of a frequency or damping in standard deviations."""
    after = found.model
    moves = np.concatenate(
        [
            after.log_frequencies - before.log_frequencies,
            after.log_dampings - before.log_dampings,
        ]
    )
    return float(np.abs(moves * np.sqrt(found.curvature.diagonal()[: len(moves)])).max())


def _described(
    loads: Loads, found: MostProbable, lines: Lines, q: int, prior: WeakPrior
) -> BandFit:
    """Evidence and whiteness of the most probable model."""
    model, at = found.model, found.model.layout
    data = spectra(lines, partial(covariances, model, q=q))
    observed = None
    if found.settled:
        observed = observed_curvature(model, data, q, prior, found.curvature)
    curvature = found.curvature if observed is None else observed
    squares, traces = _squares(covariances(model, data.frequencies_hz, q), data)
    dof = len(squares) * len(model.shapes) ** 2 - at.n_coordinates
    whiteness = float((lines.n_tapers * squares).sum() / max(1, dof))
    # ln|E| of every line, as each was whitened by its own.
    log_determinants = data.log_determinants
    value = float((data.weights * (log_determinants + traces)).sum()) + prior.penalty(model)
    p = at.n_coordinates
    log_volume = 0.5 * (p * math.log(2.0 * math.pi) - np.linalg.slogdet(curvature)[1])
    # The same spectral matrices belong to modes in any order and sources of either sign.
    equal = math.lgamma(model.n_modes + 1) + model.forces.shape[1] * math.log(2.0)
    return BandFit(
        loads,
        model,
        data,
        lines.n_tapers,
        q,
        curvature,
        -value + prior.log_constant + log_volume + equal,
        whiteness,
        allowed_whiteness(lines.n_tapers, len(model.shapes), at.n_coordinates),
        found.settled,
        observed is not None,
    )


def allowed_whiteness(n_tapers: NDArray[np.intp], n: int, n_unknowns: int) -> float:
    """1.1, where claimed deviations are too small by a twentieth, and three times the scatter.

    The mean W of w independent Gaussian vectors of n complex components with unit covariance has
    w |W - I|² with the mean n² and the variance 2n² + (4n³ + 2n) / w.
    """
    variance = float((2.0 * n**2 + (4.0 * n**3 + 2.0 * n) / n_tapers).sum())
    return 1.1 + 3.0 * math.sqrt(variance) / max(1, len(n_tapers) * n**2 - n_unknowns)


def _squares(covariance: ComplexArray, data: Spectra) -> tuple[FloatArray, FloatArray]:
    """Squared deviations of whitened spectral matrices from the unit matrix, and their traces."""
    inverse = np.linalg.inv(np.linalg.cholesky(covariance))
    white = inverse @ data.matrices @ inverse.conj().swapaxes(1, 2)
    squares = (np.abs(white - np.eye(white.shape[1])) ** 2).sum((1, 2))
    return squares, white.diagonal(axis1=1, axis2=2).real.sum(1)
