"""Formatting of numbers, lists and names in a report."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.results.wording import listed
from bayes_ssi.studies.ranking.comparison import probability_text

MISSING = "-"
# Endings of a column's name in a CSV file, and other columns that hold numbers.
UNITS = {"_hz": "Hz", "_s": "s"}
NUMBERS = ("low", "median", "high", "share")


def number(value: Any, digits: int = 4) -> str:
    """A number to some significant digits; a dash for None, NaN and infinities."""
    if value is None:
        return MISSING
    value = float(value)
    return f"{value:.{digits}g}" if math.isfinite(value) else MISSING


def fixed(value: Any, decimals: int = 2) -> str:
    """A number to some decimals, never -0.00; a dash for None, NaN and infinities."""
    if value is None or not math.isfinite(float(value)):
        return MISSING
    return f"{round(float(value), decimals) + 0.0:.{decimals}f}"


def interval(three: Sequence[Any] | None, digits: int = 4) -> str:
    """Median and ends of (low, median, high)."""
    if three is None:
        return MISSING
    low, median, high = (number(value, digits) for value in three)
    return f"{median} ({low} to {high})"


def percent(fraction: Any, digits: int = 3) -> str:
    return MISSING if fraction is None else f"{number(100.0 * float(fraction), digits)} %"


def error_percent(model: Any, identified: float) -> str:
    """The relative error of a frequency, with its sign."""
    if model is None or not math.isfinite(float(model)):
        return MISSING
    error = round(100.0 * (float(model) / identified - 1.0), 1)
    return f"{error:+.1f} %" if error else "0.0 %"


def prior(distribution: Any) -> str:
    """A prior by its name and its numbers."""
    values = {field.name: getattr(distribution, field.name) for field in fields(distribution)}
    numbers = [
        prior(value) if isinstance(value, Prior) else f"{key} {number(value)}"
        for key, value in values.items()
    ]
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", type(distribution).__name__).lower()
    return f"{name.replace('log-normal', 'lognormal')}: {', '.join(numbers)}"


def replaced(items: Sequence[Any], old: str, new: str) -> list[Any]:
    return [new if item == old else item for item in items]


def settings(given: SamplingSettings) -> str:
    """Settings in a line, without those that leave a choice to the sampling."""
    words = {True: "yes", False: "no"}
    return ", ".join(
        f"{key.replace('_', ' ')} {words[value] if isinstance(value, bool) else value}"
        for key, value in asdict(given).items()
        if value is not None
    )


def heading(name: str) -> str:
    """The heading of a CSV file's column in a table."""
    for ending, unit in UNITS.items():
        if name.endswith(ending):
            return f"{name.removesuffix(ending).replace('_', ' ')} ({unit})"
    return name.replace("_", " ")


def of_numbers(name: str) -> bool:
    """Whether a column of a predictions file holds numbers."""
    return name in NUMBERS or any(name.endswith(ending) for ending in UNITS)


FILTERS = {
    "number": number,
    "fixed": fixed,
    "interval": interval,
    "percent": percent,
    "error_percent": error_percent,
    "probability": probability_text,
    "prior": prior,
    "names": listed,
    "replaced": replaced,
    "settings": settings,
    "heading": heading,
}
TESTS = {"of_numbers": of_numbers}
