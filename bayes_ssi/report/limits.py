"""How much a report shows: what a page has room for, and a reader patience."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportLimits:
    """Largest numbers of what a report shows; what is left out stays in the result directory.

    Attributes:
        classes: described in full, the best first; a search may have sampled dozens.
        hypotheses: of a search in its table.
        sensors: whose shape components a table of identified modes has as columns.
        classes_with_modes: whose modes and parameters are drawn.
        classes_in_frequencies: drawn relative to the identified frequencies.
        parameters_in_corner: whose joint densities are drawn, the best determined ones.
        least_probability: of a class that is drawn, unless it is the first, or the second of one
            test, or cannot be distinguished from the first.
    """

    classes: int = 8
    hypotheses: int = 12
    sensors: int = 8
    classes_with_modes: int = 2
    classes_in_frequencies: int = 5
    parameters_in_corner: int = 6
    least_probability: float = 0.01


LIMITS = ReportLimits()
