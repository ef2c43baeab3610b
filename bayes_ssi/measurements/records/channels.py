"""What one file holds of a record: channels, and what the file states about them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.record import Place

# Names under which files of arrays, attributes and comments state what the samples are.
STATED = ("rate_hz", "dt_s", "quantity", "unit")
# Steps hardly longer than the last digit to which times are printed are rounded to one of it or
# two, in turn: where fewer than this share are two, samples are missing.
FEW_LONG = 0.1


class Channels(NamedTuple):
    """Channels of one file.

    Attributes:
        samples: (n, N).
        names: of the channels; empty where the file has none.
        units: every statement of the unit.
        places: node and direction of the channels; empty where the file has none.
    """

    samples: FloatArray
    names: tuple[str, ...] = ()
    rates_hz: tuple[float, ...] = ()
    quantities: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    places: tuple[Place, ...] = ()


def with_statements(
    samples: FloatArray, names: Sequence[str], stated: Mapping[str, Any]
) -> Channels:
    """Channels of a file that states things by name (:data:`STATED`)."""
    rates = [_number(stated, "rate_hz")] if "rate_hz" in stated else []
    if "dt_s" in stated:
        rates.append(1.0 / _number(stated, "dt_s"))
    return Channels(
        samples,
        tuple(names),
        tuple(rates),
        (str(stated["quantity"]),) if "quantity" in stated else (),
        (str(stated["unit"]),) if "unit" in stated else (),
    )


def _number(stated: Mapping[str, Any], key: str) -> float:
    try:
        number = float(stated[key])
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError(f"{key} must be a positive, finite number, got {stated[key]}")
    return number


def step_of(times: FloatArray) -> float:
    """The step of a column of times in s."""
    steps = np.diff(times)
    step = float(np.median(steps))
    # Times are printed to a few digits, and may be wrong by half of the last one.
    rounding = 10.0 ** -_decimals(times)
    long = steps > 1.5 * step
    wrong = (np.abs(steps - step) > 0.01 * step + rounding) | (step <= 0.0)
    apart = times - np.linspace(times[0], times[-1], len(times))
    if long.mean() < FEW_LONG or np.ptp(apart) > 2.0 * rounding:
        wrong |= long
    if not wrong.any():
        return float(times[-1] - times[0]) / (len(times) - 1)
    at = int(wrong.argmax())
    gap = ""
    if step > 0.0 and long[at]:
        missing = np.round(steps[long] / step).astype(int) - 1
        gap = f": {missing[0]} missing"
        if len(missing) > 1:
            gap += f", and {missing[1:].sum()} more at {len(missing) - 1} other places"
    raise ValueError(
        f"times must advance by equal steps; after sample {at + 1} (at {times[at]:.10g} s) the "
        f"step is {steps[at]:.6g} s, most are {step:.6g} s{gap}"
    )


def _decimals(times: FloatArray) -> int:
    """The fewest decimals that the first times need, at most 9."""
    first = times[:100]
    exact = 1e-10 + 2.0 * np.spacing(np.abs(first).max())
    return next((k for k in range(9) if np.allclose(first, np.round(first, k), 0.0, exact)), 9)
