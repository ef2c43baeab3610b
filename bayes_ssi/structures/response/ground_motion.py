"""Ground motion: an acceleration at equal time steps, in m/s²."""

import math
import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.argument_types import require_one_of
from bayes_ssi.foundations.arrays import FloatArray

# Unit of an acceleration → its value in m/s²; standard gravity, inch and foot are exact by
# definition.
UNITS = {
    "g": 9.80665, "m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 0.001, "in/s2": 0.0254, "ft/s2": 0.3048,
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
