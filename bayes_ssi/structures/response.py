"""Ground motion, and the response of a structure: transfer functions and time histories, by modes.

With u the displacement relative to the ground, a_g the ground's acceleration and p a force,

    M ü + C u̇ + K u = -M ι a_g + p,    u = Σ_r φ_r q_r,
    q̈_r + 2 ζ_r ω_r q̇_r + ω_r² q_r = -Γ_r a_g + φ_rᵀ p,

where φ_r has unit modal mass and Γ_r = φ_rᵀ M ι. Modes that a structure does not give are assumed
to move with the ground: their displacement is neglected, their inertia is not.

Exact response of damped oscillators to a record that is linear between samples, by filters.

A mode of pole λ = -ζω + iω√(1-ζ²) has the state s' = λ s + f, f being the record; displacement,
velocity and acceleration of the mode are imaginary parts of multiples of s. Over a step in which
f is linear,

    s_after = E s_before + dt (φ₁(z) - φ₂(z)) f_before + dt φ₂(z) f_after,    z = λ dt, E = e^z,

with φ₁ = (e^z - 1)/z and φ₂ = (e^z - 1 - z)/z². With q for the delay by one sample, s is the output
of the filter (c₁ + c₀ q)/(1 - E q) on f, c₁ = dt φ₂ and c₀ = dt (φ₁ - φ₂). Numerator and
denominator times 1 - E* q make it one of second order, with real coefficients.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from bayes_ssi.foundations.argument_types import require_one_of
from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.structures.geometry import SensorMatrix
from bayes_ssi.structures.modal import ModalModel
from bayes_ssi.structures.structure import Structure

# Unit of an acceleration → its value in m/s²; standard gravity, inch and foot are exact by
# definition.
UNITS = {
    "g": 9.80665, "m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 0.001, "in/s2": 0.0254, "ft/s2": 0.3048,
    "mg": 0.00980665,
}  # fmt: skip
SPELLINGS = {"gal": "cm/s2", "gals": "cm/s2", "g0": "g", "gs": "g"}
# In m/s². Earthquakes have been recorded with 40 m/s² (Iwate-Miyagi 2008; Aoi et al. 2008, Science
# 322), and with hardly more.
LARGEST_RECORDED = 50.0


def checked_unit(unit: str) -> str:
    """The unit of acceleration as a key of :data:`UNITS`, from any usual spelling of it.

    Files write ``CM/S/S``, ``cm/sec^2``, ``M/S**2``, ``m s-2``, ``Gal`` or ``g's``, among others.
    """
    plain = str(unit).lower().replace("²", "2").replace("⁻", "-")
    plain = re.sub(r"[\s^*·.'’()\[\]]", "", plain)
    plain = re.sub(r"sec(?:ond)?", "s", plain)
    plain = re.sub(r"(?:/s/s|/?s-2)$", "/s2", plain)
    plain = SPELLINGS.get(plain, plain)
    if plain not in UNITS:
        require_one_of("unit of acceleration", unit, UNITS)
    return plain


@dataclass(frozen=True, eq=False)
class GroundMotion:
    """The acceleration of the ground, linear between samples.

    Attributes:
        acceleration: (n_samples,), in m/s².
        dt: time between samples in s.
        name: name for titles and tables.

    Raises:
        ValueError: there are fewer than two samples, one is not finite, or dt is not positive.
    """

    acceleration: FloatArray
    dt: float
    name: str = ""

    def __post_init__(self) -> None:
        where = f"ground motion {self.name!r}" if self.name else "ground motion"
        try:
            acceleration = np.array(self.acceleration, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"{where}: the acceleration must be a list of numbers") from None
        if acceleration.ndim != 1 or len(acceleration) < 2:
            got = acceleration.shape if acceleration.ndim != 1 else len(acceleration)
            raise ValueError(f"{where}: needs a row of two samples or more, got {got}")
        if not np.isfinite(acceleration).all():
            first = int(np.flatnonzero(~np.isfinite(acceleration))[0])
            raise ValueError(
                f"{where}: sample {first + 1} is not finite: {float(acceleration[first])!r}"
            )
        if not (isinstance(self.dt, (int, float, np.number)) and 0.0 < self.dt < math.inf):
            raise ValueError(f"{where}: dt must be positive and finite (s), got {self.dt!r}")
        acceleration.setflags(write=False)
        object.__setattr__(self, "acceleration", acceleration)
        object.__setattr__(self, "dt", float(self.dt))

    def __len__(self) -> int:
        return len(self.acceleration)

    @cached_property
    def times(self) -> FloatArray:
        """Times of the samples (n_samples,), in s, from 0."""
        return np.arange(len(self.acceleration), dtype=np.float64) * self.dt

    @property
    def nyquist_hz(self) -> float:
        """Half the sampling frequency; the samples carry nothing above it."""
        return 0.5 / self.dt

    def warnings(self, frequencies_hz: FloatArray) -> list[str]:
        """What an analyst should know before using this record, a sentence each.

        Args:
            frequencies_hz: (n_modes,), ascending frequencies of the structure that it shakes.
        """
        warnings = []
        if self.peak_acceleration > LARGEST_RECORDED:
            warnings.append(
                f"record {self.name}: its peak, {self.peak_acceleration / UNITS['g']:.3g} g, is "
                "beyond that of any earthquake recorded; is its unit right?"
            )
        above = np.flatnonzero(frequencies_hz > self.nyquist_hz)
        if len(above):
            warnings.append(
                f"record {self.name}: {self.dt:g} s between samples carry frequencies up to "
                f"{self.nyquist_hz:g} Hz; mode {above[0] + 1} of the structure, at "
                f"{frequencies_hz[above[0]]:.3g} Hz, and any above it are not driven as the ground "
                "drives them"
            )
        return warnings

    @property
    def peak_acceleration(self) -> float:
        """PGA in m/s²."""
        return float(np.abs(self.acceleration).max())


GROUND = "ground"
Quantity = Literal["displacement", "acceleration", "drift"]
# One ratio for all modes, or one for each.
Damping = float | Sequence[float]
# Modes of structures that are damped by more than a fifth of critical are not identified.
HEAVY_DAMPING = 0.2


@dataclass(frozen=True)
class Output:
    """A response quantity at one or more places.

    Attributes:
        quantity: "displacement" (relative to the ground), "acceleration" (absolute), or "drift"
            (the displacement of one place minus that of another).
        places: labels of degrees of freedom, or of the structure's sensors; for drift pairs of
            them, (lower, upper), of which the lower may be "ground".

    Raises:
        ValueError: the quantity is unknown, there is no place, or a place has the wrong form for
            the quantity.
    """

    quantity: Quantity
    places: tuple[str, ...] | tuple[tuple[str, str], ...]

    def __post_init__(self) -> None:
        require_one_of("output: quantity", self.quantity, get_args(Quantity))
        if isinstance(self.places, str) or not len(self.places):
            raise ValueError(f"output: places must be a list of one or more, got {self.places!r}")
        pairs = self.quantity == "drift"
        for place in self.places:
            if not (_is_pair(place) if pairs else isinstance(place, str)):
                form = "a pair such as ('ground', 'floor 1')" if pairs else "a label"
                raise ValueError(
                    f"output: a place of {self.quantity!r} must be {form}, got {place!r}"
                )
        places = tuple(tuple(place) if pairs else place for place in self.places)
        object.__setattr__(self, "places", places)

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for every place."""
        return tuple(each if isinstance(each, str) else " to ".join(each) for each in self.places)

    def matrix_on(self, structure: Structure) -> SensorMatrix:
        """What gives displacements at the places, or their differences for drift.

        Raises:
            ValueError: a place is no degree of freedom or sensor of the structure.
        """
        drifts = self.quantity == "drift"
        pairs: list[Any] = [place if drifts else (GROUND, place) for place in self.places]
        labels: list[str] = [label for pair in pairs for label in pair if label != GROUND]
        structure.sensor_matrix(labels, "place")  # refuses those that are not there
        motions: dict[Any, Mapping[str, float]] = {GROUND: {}}
        motions |= zip(labels, structure.sensor_motions(labels), strict=True)
        rows = []
        for lower, upper in pairs:
            row = dict(motions[upper])
            for label, share in motions[lower].items():
                row[label] = row.get(label, 0.0) - share
            rows.append(row)
        return SensorMatrix(rows, structure.degrees_of_freedom)


def _is_pair(place: object) -> bool:
    return (
        isinstance(place, (tuple, list))
        and len(place) == 2
        and all(isinstance(label, str) for label in place)
        and place[0] != place[1]
    )


def heavy_damping_warning(ratio: float) -> str:
    """What to say of a damping ratio above :data:`HEAVY_DAMPING`."""
    return (
        f"damping is {ratio:g}, a fraction: {100 * ratio:.3g} % of critical damping; "
        "is it a percentage?"
    )


def damping_ratios(damping: Damping, n_modes: int) -> FloatArray:
    """Modal damping ratios (n_modes,), as fractions of critical damping."""
    try:
        ratios = np.array(damping, dtype=float)
    except (TypeError, ValueError):
        ratios = np.array(np.nan)
    if not ((ratios > 0.0) & (ratios < 1.0)).all():
        raise ValueError(
            "damping must be a fraction of critical damping strictly between 0 and 1, "
            f"got {damping!r}"
        )
    if ratios.shape not in ((), (n_modes,)):
        raise ValueError(
            f"damping must be one ratio or one for each of the {n_modes} modes, got "
            f"{ratios.size} ratios"
        )
    return np.broadcast_to(ratios, (n_modes,))


def modal_histories(
    poles: ComplexArray, factors: ComplexArray, record: FloatArray, dt: float
) -> Iterator[FloatArray]:
    """Im(factor · s) of every mode, from rest (s = 0 at the first sample).

    Args:
        poles: (B, n_modes), λ, as are the factors.
        record: (n_samples,), f.

    Yields:
        (n_modes + 1, n_samples) for each row of B in turn, in an array that is reused; its last
        row is the record.
    """
    from scipy.signal import lfilter

    z = poles * dt
    decay = np.exp(z)
    phi1, phi2 = phi_functions(z)
    after, before = factors * (dt * phi2), factors * (dt * (phi1 - phi2))
    turned = after * decay.conj()
    numerators = np.stack([after, before - turned, -before * decay.conj()], axis=-1).imag
    denominators = np.stack([np.ones(z.shape), -2.0 * decay.real, np.abs(decay) ** 2], axis=-1)
    # From a filter at rest, s would begin at c₁ f rather than at zero.
    initial = np.stack([-after, turned], axis=-1).imag * record[0]
    histories = np.empty((z.shape[1] + 1, len(record)))
    histories[-1] = record
    for row in zip(numerators, denominators, initial, strict=True):
        for mode, (numerator, denominator, state) in enumerate(zip(*row, strict=True)):
            histories[mode], _ = lfilter(numerator, denominator, record, zi=state)
        yield histories


def phi_functions(z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """φ₁(z) = (e^z - 1)/z and φ₂(z) = (e^z - 1 - z)/z², without cancellation for small z."""
    small = np.abs(z) < 0.5
    series = np.zeros_like(z)
    for k in range(16, 1, -1):  # 1/2! + z/3! + z²/4! + …
        series = (series * z + 1.0) / k
    other = np.where(small, 1.0, z)
    phi2 = np.where(small, series, ((np.exp(other) - 1.0) / other - 1.0) / other)
    return 1.0 + z * phi2, phi2


# In Hz; the fourth power of circular frequencies, in the squares of amplitudes, stays finite.
HIGHEST_HZ = 1e75


def modal_model_of(structure: Structure, values: FloatArray) -> ModalModel:
    """The structure's modal model, with the shapes of its arrays checked."""
    model = ModalModel(*structure.modal_model(values))
    n, n_dof, n_modes = len(values), len(structure.degrees_of_freedom), structure.n_modes
    expected = ((n, n_modes), (n, n_dof, n_modes), (n, n_modes), (n_dof,))
    shapes = tuple(np.shape(part) for part in model)
    if shapes != expected:
        raise ValueError(
            f"structure {type(structure).__name__}: its modal model holds frequencies, shapes, "
            f"participation and influence of shapes {shapes}, expected {expected}"
        )
    return model


def ground_influence(structure: Structure) -> FloatArray | None:
    """Displacements (n_dof,) when the ground moves by 1 and nothing deforms; None if not known."""
    try:
        return modal_model_of(structure, structure.prior_medians()).influence
    except TypeError:
        return None


def transfer_functions(
    structure: Structure,
    values: FloatArray,
    frequencies_hz: FloatArray,
    output: Output,
    damping: Damping,
    *,
    force_at: str | None = None,
) -> ComplexArray:
    """Response (B, n_places, F) to a harmonic ground acceleration or force of amplitude 1, e^{iωt}.

    For ground acceleration, accelerations have the unit 1 and displacements s²; for a force, these
    units are divided by the structure's unit of mass.

    Args:
        values: (B, n_parameters).
        frequencies_hz: (F,), of the input.
        force_at: the degree of freedom or sensor at which a force acts; ground motion if None.
    """
    omega = 2.0 * np.pi * checked_frequencies(frequencies_hz)
    matrix = output.matrix_on(structure)
    ratios = damping_ratios(damping, structure.n_modes)
    model = modal_model_of(structure, values)
    own = 2.0 * np.pi * model.frequencies_hz[:, :, None]
    receptance = 1.0 / (own**2 - omega**2 + 2j * ratios[:, None] * own * omega)
    if force_at is None:
        driven = -model.participation
    else:
        driven = structure.sensor_matrix([force_at], "place").apply(model.shapes)[:, 0, :]
    at_places = np.ascontiguousarray(matrix.apply(model.shapes))
    response = ((at_places * driven[:, None, :]) @ receptance).astype(np.complex128, copy=False)
    if output.quantity == "acceleration":
        response *= -(omega**2)
        if force_at is None:
            response += matrix.apply(model.influence, axis=0)[:, None]
    return response


def checked_frequencies(frequencies_hz: FloatArray) -> FloatArray:
    frequencies = np.asarray(frequencies_hz, dtype=float)
    if frequencies.ndim != 1 or not len(frequencies):
        raise ValueError(f"frequencies_hz must be a row of numbers, got shape {frequencies.shape}")
    wrong = ~((frequencies >= 0.0) & (frequencies <= HIGHEST_HZ))
    if wrong.any():
        raise ValueError(
            f"frequencies_hz must be from 0 to {HIGHEST_HZ:.0e}, "
            f"got {float(frequencies[wrong][0])!r}"
        )
    return frequencies


def time_histories(
    structure: Structure, values: FloatArray, motion: GroundMotion, output: Output, damping: Damping
) -> FloatArray:
    """Response (B, n_places, n_samples) to a ground motion from rest, in m/s² or m.

    Exact if the motion is linear between samples; ``values`` are (B, n_parameters).
    """
    matrix = output.matrix_on(structure)
    ratios = damping_ratios(damping, structure.n_modes)
    model = modal_model_of(structure, values)
    omega = 2.0 * np.pi * model.frequencies_hz
    damped = omega * np.sqrt(1.0 - ratios**2)
    poles = -ratios * omega + 1j * damped
    at_places = np.ascontiguousarray(matrix.apply(model.shapes))
    # With s' = λ s + a_g: q = -Γ Im(s)/ω_d and q̈ = -Γ (Im(λ² s)/ω_d + a_g).
    factors = (-model.participation / damped).astype(np.complex128)
    of_ground = np.zeros((*at_places.shape[:2], 1))
    if output.quantity == "acceleration":
        factors *= poles**2
        moved = matrix.apply(model.influence, axis=0)
        of_ground[:, :, 0] = moved - (at_places * model.participation[:, None, :]).sum(-1)
    weights = np.concatenate([at_places, of_ground], axis=2)
    modes_and_ground = modal_histories(poles, factors, motion.acceleration, motion.dt)
    responses = np.empty((len(values), len(output.places), len(motion)))
    for response, own, rows in zip(responses, weights, modes_and_ground, strict=True):
        np.matmul(own, rows, out=response)
    return responses
