"""What a peak of the spectra holds, in words: one mode, one with phases, or two."""

from __future__ import annotations

from typing import NamedTuple

# The probability that leaves no doubt, in words.
SURE = 0.95


class Peak(NamedTuple):
    """A peak of the spectra, and how many modes it holds.

    Attributes:
        modes: their places among those quoted, from 0.
        probability_of_two: that it holds two modes rather than one, with real shapes or with
            phases, each explanation equally probable before; None where the spectra around it are
            explained by none.
    """

    frequencies_hz: tuple[float, ...]
    modes: tuple[int, ...]
    probability_of_two: float | None
    probability_of_phases: float | None
    resolution_hz: float
    resolution: float

    def __str__(self) -> str:
        at = " and ".join(f"{f:.4g}" for f in self.frequencies_hz)
        p, phases = self.probability_of_two, self.probability_of_phases
        if p is None or phases is None:
            return f"peak at {at} Hz: the spectra around it are not explained"
        text = f"peak at {at} Hz: two modes with a probability {_chance(p)}"
        if phases > 0.5:
            text += f", one mode whose sensors have phases with {_chance(phases)}"
        if p > SURE:
            return text
        closer = f"{self.resolution_hz:.2g} Hz ({self.resolution:.2g} bandwidths)"
        if p < 1.0 - SURE:
            return f"{text}; modes closer than about {closer} could not be told apart"
        return f"{text}: the record cannot tell"


def _chance(p: float) -> str:
    return "above 0.999" if p > 0.999 else "below 0.001" if p < 0.001 else f"{p:.3f}"
