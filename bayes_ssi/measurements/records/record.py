"""A vibration record: what the sensors of one setup measured at equal time steps."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import repeated, require_known, require_one_of
from bayes_ssi.foundations.arrays import BoolArray, FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.measurements.modes.identified_mode import checked_band, checked_sensors
from bayes_ssi.measurements.records.record_checks import remarks_on
from bayes_ssi.structures.response import UNITS, checked_unit

NAMED_GAPS = 3
# Quantity → units in which it may be given; spellings of accelerations are those of ground motion.
QUANTITIES = {
    "acceleration": tuple(UNITS),
    "velocity": ("m/s", "cm/s", "mm/s", "in/s", "ft/s"),
    "displacement": ("m", "cm", "mm", "in", "ft"),
}


@dataclass(frozen=True, eq=False, repr=False)
class Record(Displayed):
    """What n sensors measured at N equal time steps.

    Attributes:
        samples: (n, N), a row for each sensor.
        rate_hz: samples per second.
        sensors: name of each sensor, as the structure names its degrees of freedom or sensors.
        quantity: ``"acceleration"``, ``"velocity"`` or ``"displacement"``.
        unit: of all samples, such as ``"m/s2"`` or ``"g"``.
        source: where the record comes from.
        gaps: (first, end) of each run of instants that not all sensors measured, in samples from 0,
            ascending. Samples there are on straight lines; the record begins and ends outside.
            Instants with NaN are gaps.

    Raises:
        ValueError: there are no more samples than sensors; a sample is infinite; half of the
            instants or more are missing; names are missing or repeated; the rate, quantity or unit
            is not valid.
    """

    samples: FloatArray
    rate_hz: float
    sensors: tuple[str, ...]
    quantity: str
    unit: str
    source: str = ""
    gaps: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        if twice := repeated(self.sensors):
            raise ValueError(
                f"record: two sensors are named {twice[0]!r}; name all in their order (--sensor)"
            )
        object.__setattr__(self, "sensors", checked_sensors(self.sensors, "record"))
        object.__setattr__(self, "samples", self._checked_samples())
        object.__setattr__(self, "rate_hz", checked_rate(self.rate_hz))
        object.__setattr__(self, "unit", checked_unit_of(self.quantity, self.unit))

    def _checked_samples(self) -> FloatArray:
        try:
            if np.iscomplexobj(self.samples):
                raise TypeError
            samples = np.asarray(self.samples, dtype=float)
        except (TypeError, ValueError):
            raise ValueError("record: samples must be rows of real numbers, all as long") from None
        if samples.ndim != 2:
            raise ValueError(f"record: samples must be (n_sensors, n_samples), got {samples.shape}")
        n, length = samples.shape
        if n >= length:
            raise ValueError(
                f"record: samples must be (n_sensors, n_samples), got {n} rows of {length}; is the "
                "array the wrong way round?"
            )
        if n < 1:
            raise ValueError("record: no sensors")
        if len(self.sensors) != n:
            raise ValueError(f"record: {len(self.sensors)} names for {n} sensors")
        for name, row in zip(self.sensors, samples, strict=True):
            if (infinite := np.isinf(row)).any():
                i = int(infinite.argmax())
                where = f"sensor {name!r}: sample {i + 1}"
                raise ValueError(f"record: {where} is not finite: {float(row[i])!r}")
        if (missing := np.isnan(samples).any(0)).any():
            samples = self._bridged(samples, missing)
        # A long record fills memory: an array that nobody can change is not copied.
        if samples.flags.writeable or not samples.flags.c_contiguous:
            samples = np.array(samples, order="C")
            samples.setflags(write=False)
        return samples

    def _bridged(self, samples: FloatArray, missing: BoolArray) -> FloatArray:
        """The samples from the first whole instant to the last, with straight lines in gaps."""
        if missing.mean() >= 0.5:
            shares = np.isnan(samples).mean(1)
            worst = self.sensors[int(shares.argmax())]
            raise ValueError(
                f"record: {missing.mean():.0%} of the instants are missing at some sensor, at "
                f"{worst!r} {shares.max():.0%}; leave that sensor out, or take another span"
            )
        whole = np.flatnonzero(~missing)
        kept = slice(whole[0], whole[-1] + 1)
        samples, missing, whole = np.array(samples[:, kept]), missing[kept], whole - whole[0]
        for row in samples:
            row[missing] = np.interp(np.flatnonzero(missing), whole, row[whole])
        edges = np.flatnonzero(np.diff(missing)) + 1
        object.__setattr__(self, "gaps", tuple(map(tuple, edges.reshape(-1, 2).tolist())))
        return samples

    @property
    def is_measured(self) -> BoolArray:
        """(N,), whether an instant is in no gap."""
        measured = np.ones(self.n_samples, dtype=bool)
        for first, end in self.gaps:
            measured[first:end] = False
        return measured

    def longest_piece(self) -> "Record":
        """The longest piece between gaps, all of the record where there are none."""
        edges = np.array([0, *np.ravel(self.gaps), self.n_samples]).reshape(-1, 2)
        first, end = edges[np.diff(edges).argmax()]
        return replace(self, samples=self.samples[:, first:end], gaps=())

    @property
    def n_samples(self) -> int:
        """N, the number of samples of each sensor."""
        return self.samples.shape[1]

    @property
    def duration_s(self) -> float:
        """N over the rate, in s."""
        return self.n_samples / self.rate_hz

    @property
    def nyquist_hz(self) -> float:
        """Half the rate; the samples carry nothing above it."""
        return 0.5 * self.rate_hz

    def checked_band(self, band_hz: Sequence[float]) -> tuple[float, float]:
        """Lowest and highest frequency in Hz of a band that the record covers.

        Args:
            band_hz: the two frequencies.

        Raises:
            ValueError: the band is empty, begins below the record's lowest frequency, 1/duration,
                or ends beyond its Nyquist frequency.
        """
        low, high = checked_band(band_hz)
        if high > self.nyquist_hz:
            raise ValueError(
                f"band_hz: {high:g} Hz is beyond {self.nyquist_hz:g} Hz, half the rate of the "
                "record"
            )
        if low * self.duration_s < 1.0:
            raise ValueError(
                f"band_hz: {low:g} Hz is below {1.0 / self.duration_s:.3g} Hz, the lowest "
                f"frequency in {self.duration_s:g} s"
            )
        return low, high

    def selected(self, sensors: Sequence[str]) -> "Record":
        """The record of some sensors, in the order given.

        Args:
            sensors: their names.

        Raises:
            ValueError: a name is unknown or repeated, or none is given.
        """
        sensors = (sensors,) if isinstance(sensors, str) else tuple(sensors)
        require_known("record: no sensor", sensors, self.sensors)
        samples = self.samples[[self.sensors.index(name) for name in sensors]]
        samples.setflags(write=False)
        return replace(self, samples=samples, sensors=sensors)

    def warnings(self) -> list[str]:
        """What looks wrong with the record, a sentence each."""
        n, rate = len(self.gaps), self.rate_hz
        if not n:
            return remarks_on(self.samples, rate, self.sensors)
        spans = [
            f"{end - first:,} samples from {first / rate:.5g} to {end / rate:.5g} s"
            for first, end in self.gaps[:NAMED_GAPS]
        ]
        more = f", and {n - NAMED_GAPS} more gaps" if n > NAMED_GAPS else ""
        named = f"missing: {', '.join(spans)}{more}; the pieces are used together"
        return [named, *remarks_on(self.samples[:, self.is_measured], rate, self.sensors)]

    def _line(self) -> str:
        sensors = counted(len(self.sensors), "sensor")
        return f"of {self.quantity}, {sensors}, {self.duration_s:.5g} s at {self.rate_hz:g} Hz"

    def _rows(self) -> list[dict[str, Any]]:
        rms = self.samples.std(axis=1)
        return [
            {"sensor": name, f"rms, {self.unit}": float(size)}
            for name, size in zip(self.sensors, rms, strict=True)
        ]


def checked_rate(rate_hz: float) -> float:
    number = isinstance(rate_hz, (int, float, np.number)) and not isinstance(rate_hz, bool)
    if not (number and 0.0 < rate_hz < math.inf):
        got = float(rate_hz) if number else rate_hz
        raise ValueError(f"record: rate_hz must be a positive, finite number, got {got!r}")
    return float(rate_hz)


def units_of(quantity: str) -> tuple[str, ...]:
    require_one_of("record: quantity", quantity, QUANTITIES)
    return QUANTITIES[quantity]


def checked_unit_of(quantity: str, unit: str) -> str:
    """The unit in its usual spelling."""
    if quantity != "acceleration":
        require_one_of(f"record: unit of {quantity}", unit, units_of(quantity))
        return unit
    return checked_unit(unit)


def quantity_of(unit: str) -> str | None:
    """The quantity that has a unit, of which no two quantities have the same; None if none has."""
    for quantity in QUANTITIES:
        with suppress(ValueError):
            checked_unit_of(quantity, unit)
            return quantity
    return None
