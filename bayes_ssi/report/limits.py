"""How much a report shows, limited by the room on a page and the reader's patience."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportLimits:
    """Most items of each kind that a report shows; the result directory holds the others.

    Attributes:
        least_probability: smallest probability of a class that is drawn, unless it is the first,
            or the second of one test, or cannot be distinguished from the first.
    """

    classes: int = 8
    hypotheses: int = 12
    places: int = 12
    sensors: int = 8
    classes_with_modes: int = 2
    classes_in_frequencies: int = 5
    parameters_in_corner: int = 6
    least_probability: float = 0.01


LIMITS = ReportLimits()
