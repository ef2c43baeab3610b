"""Evidences of identified modes that are hard to sample: razor ridges, any pairing, several models.

Where a docstring names no quadrature, the log evidence was computed without the engine, to the
digits given here: least-squares ascents of every pairing from draws of the prior give the maxima,
and importance sampling from one Student t at each, and from the prior, the evidence. Where
frequencies alone are known, a quadrature over cells that are halved about the likelihood agrees.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from known_evidence import Array, Problem, log_normal_pdf
from problems import STUDY
from scipy.special import logsumexp

import bayes_ssi as bs

ERRORS = (1e-2, 1e-3, 1e-4)


def storeys(n: int, spread: float) -> bs.ShearBuilding:
    """n storeys of unit mass, first frequency 1 Hz, factors of the stiffnesses inferred."""
    nominal = (math.pi / math.sin(math.pi / (4 * n + 2))) ** 2
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, spread)) for i in range(1, n + 1)]
    return bs.ShearBuilding((1.0,) * n, tuple(nominal * factor for factor in factors))


def frequencies_alone(
    name: str, n: int, observed: Array, error: float, spread: float = 0.3
) -> bs.ModelClass:
    """The lowest frequencies of n storeys, in a band that ends just above them."""
    modes = tuple(bs.IdentifiedMode(str(i), float(f)) for i, f in enumerate(observed, 1))
    return bs.ModelClass(
        name, storeys(n, spread), bs.ModalData(modes, (0.0, 1.2 * float(observed[-1]))),
        bs.ErrorModel(frequency_cov=error, shape_sd=0.05),
        pairing={mode.label: i for i, mode in enumerate(modes, 1)},
    )  # fmt: skip


def as_problem(candidate: bs.ModelClass, log_evidence: float) -> Problem:
    d = len(candidate.parameters)
    at = candidate.log_likelihood_at
    return Problem(candidate.name, d, at, log_evidence, model_class=candidate)


def razor_ridge(n: int, error: float = 3e-4) -> Problem:
    """One frequency for the stiffnesses of n storeys.

    Quadrature. With b orthogonal to the mean a of the coordinates, f = exp(κa) F(b): over a by
    Gauss-Hermite about the identified frequency, over b by the trapezoidal rule. Within the
    likelihood the second frequency is far above the band.
    """
    candidate = frequencies_alone(f"razor ridge d={n}", n, np.ones(1), error)
    kappa = math.sqrt(math.log1p(0.3**2)) / (2.0 * math.sqrt(n))
    step = 0.1
    axis = np.arange(-8.0, 8.0 + step / 2, step)
    orthogonal = np.linalg.svd(np.ones((1, n)))[2][1:]
    b = np.stack(np.meshgrid(*[axis] * (n - 1)), axis=-1).reshape(-1, n - 1)
    log_frequency = np.log(
        candidate.modes(candidate.values(b @ orthogonal))[0].frequencies_hz[:, 0]
    )
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    f = 1.0 + error * nodes
    a = (np.log(f) - log_frequency[:, None]) / kappa
    over_a = np.exp(-0.5 * a * a) / (2.0 * math.pi * kappa * f) @ weights
    over_b = np.exp(-0.5 * (b * b).sum(1)) * (step / math.sqrt(2.0 * math.pi)) ** (n - 1)
    known = candidate.identification
    detected = math.log(known.detection_probability) - known.expected_spurious_modes
    return as_problem(candidate, detected + math.log(over_a @ over_b))


def two_frequencies() -> bs.ModelClass:
    """Two frequencies to 0.03 % for three stiffnesses: a ridge in three dimensions."""
    nominal = storeys(3, 0.3).modes(np.ones((1, 3)))[0][0]
    return frequencies_alone("razor ridge, two frequencies", 3, nominal[:2], 3e-4)


def without_noise(n: int, error: float) -> bs.ModelClass:
    """All frequencies of n storeys without noise, which several sets of stiffnesses have."""
    nominal = storeys(n, 0.5).modes(np.ones((1, n)))[0][0]
    return frequencies_alone(f"several models d={n}", n, nominal, error, 0.5)


def any_pairing_of_shear_building(name: str, error: float) -> bs.ModelClass:
    """A class of the numerical study with the pairing inferred, and other sizes of errors."""
    (candidate,) = bs.load_study(STUDY).only([name]).model_classes
    label = {"1-a": "infill as mass", "3": "infill"}[name]
    return replace(
        candidate.with_any_pairing(f"any pairing, {label}, {error:.0e}"),
        error=bs.ErrorModel(frequency_cov=error, shape_sd=5.0 * error),
    )


def exact_modes(true: bs.Structure, n: int, end_hz: float | None = None) -> bs.ModalData:
    """The n lowest modes at all degrees of freedom; the band ends 5 % above, or where told so."""
    frequencies, shapes = (each[0] for each in true.modes(np.empty((1, 0))))
    band = (0.0, end_hz or 1.05 * float(frequencies[n - 1]))
    given = frequencies[:n], shapes[:, :n], band, true.degrees_of_freedom
    return bs.ModalData.from_arrays(*given)


def any_pairing_of_twelve_degrees_of_freedom(error: float) -> bs.ModelClass:
    """Four storeys that move in x, y and torsion; stiffnesses of the first storey and the others.

    The six lowest modes without noise, close in x and y, at three sensors of each floor.
    """
    names = ("x of storey 1", "x above", "y of storey 1", "y above")
    factors = [bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in names]

    def building(kx1, kx, ky1, ky) -> bs.ShearBuilding3D:
        along = (1000.0 * kx1, *[1000.0 * kx] * 3), (1100.0 * ky1, *[1100.0 * ky] * 3)
        masses, ones = (3.2, 2.6, 2.6, 1.8), (1.0,) * 4
        return bs.ShearBuilding3D(masses, ones, *along, (1900.0,) * 4, ((0.05, 0.1),) * 4)

    data = exact_modes(building(0.9, 1.1, 1.1, 1.0), 6)
    return bs.ModelClass(
        f"any pairing, 12 degrees of freedom, {error:.0e}", building(*factors), data,
        bs.ErrorModel(frequency_cov=error, shape_sd=5.0 * error), pairing="any",
    )  # fmt: skip


def repeated_modes() -> Problem:
    """Two storeys whose modes in x and y almost repeat; given pairing, so that swaps cost.

    Quadrature by the midpoint rule in the sum and the difference of the coordinates: where the
    stiffnesses are equal the modes change places, and the likelihood jumps.
    """
    kx, ky = (bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in ("kx", "ky"))

    def building(x: bs.Parameter | float, y: bs.Parameter | float) -> bs.ShearBuilding3D:
        return bs.ShearBuilding3D(
            (1.0, 1.0), (1.0, 1.0), (100.0 * x,) * 2, (100.0 * y,) * 2, (300.0, 300.0)
        )

    data = exact_modes(building(1.0, 1.0001), 2, end_hz=2.0)
    error = bs.ErrorModel(frequency_cov=0.005, shape_sd=0.03)
    candidate = bs.ModelClass(
        "repeated modes d=2", building(kx, ky), data, error, pairing={"1": 1, "2": 2}
    )
    # The posterior's standard deviation is 0.034, that of 2 · 0.005 over that of ln k.
    side, n = 0.4, 100
    axis = (np.arange(-n, n) + 0.5) * (side / n)
    both, apart = (grid.ravel() for grid in np.meshgrid(axis, axis))
    z = np.column_stack([both + apart, both - apart]) / math.sqrt(2.0)
    logs = candidate.log_likelihood_at(z) + log_normal_pdf(z, 0.0, 1.0).sum(1)
    return as_problem(candidate, float(logsumexp(logs)) + 2.0 * math.log(side / n))


def error_size_inferred() -> Problem:
    """One storey's frequency without noise, and the size of its error: a funnel of two dimensions.

    Quadrature by the trapezoidal rule over the error's size, and by Gauss-Hermite over ln f with
    it. The one mode cannot be missed.
    """
    mode = bs.IdentifiedMode("1", 1.0)
    size = bs.Parameter("frequency_cov", bs.LogNormal(0.01, 1.0))
    candidate = bs.ModelClass(
        "error size inferred d=2", storeys(1, 0.3), bs.ModalData((mode,), (0.0, 2.0)),
        bs.ErrorModel(frequency_cov=size, shape_sd=0.05), pairing={"1": 1},
    )  # fmt: skip
    kappa = 0.5 * math.sqrt(math.log1p(0.3**2))
    axis = np.arange(-8.0, 8.0 + 0.025, 0.05)
    sizes = np.asarray(size.prior.from_normal(axis))[:, None]
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    # f = 1 + σx has its normal density over x; a negative f has none.
    f = 1.0 + sizes * nodes
    with np.errstate(invalid="ignore", divide="ignore"):
        prior = np.where(f > 0, np.exp(-0.5 * (np.log(f) / kappa) ** 2) / (kappa * f), 0.0)
    over_f = np.nan_to_num(prior) @ weights / (2.0 * math.pi)
    known = candidate.identification
    detected = math.log(known.detection_probability) - known.expected_spurious_modes
    total = 0.05 * np.exp(log_normal_pdf(axis, 0.0, 1.0)) @ over_f
    return as_problem(candidate, detected + math.log(total))


def modal_classes() -> list[bs.ModelClass]:
    """The classes whose log evidences follow."""
    return [
        two_frequencies(),
        without_noise(2, 1e-3),
        without_noise(3, 1e-3),
        *(any_pairing_of_shear_building(name, e) for name in ("1-a", "3") for e in ERRORS),
        *(any_pairing_of_twelve_degrees_of_freedom(e) for e in ERRORS),
    ]


# In the order of modal_classes(); standard errors up to 0.003.
LOG_EVIDENCES = (
    1.8121, 0.7980, 0.8716,
    0.249, -6.719, -20.796,
    16.070, 34.529, 52.950,
    139.909, 296.409, 452.984,
)  # fmt: skip


def problems() -> list[Problem]:
    references = [
        as_problem(candidate, log_evidence)
        for candidate, log_evidence in zip(modal_classes(), LOG_EVIDENCES, strict=True)
    ]
    return [razor_ridge(2), razor_ridge(3), *references, repeated_modes(), error_size_inferred()]
