"""Probabilities, quantities and lists as they stand in a sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bayes_ssi.ranking.comparison import probability_text

# The calibrated language of the IPCC (Mastrandrea et al. 2010), by the least probability.
LIKELIHOOD = (
    (0.99, "virtually certain"),
    (0.95, "extremely likely"),
    (0.90, "very likely"),
    (0.66, "likely"),
    (0.50, "more likely than not"),
)
# The central 90 % of a normal distribution, in standard deviations.
CENTRAL_90 = 3.29


def likelihood_in_words(probability: float) -> str:
    """A probability in the IPCC's words; "less likely than not" below one half."""
    words = (words for least, words in LIKELIHOOD if probability >= least)
    return next(words, "less likely than not")


def probability_in_words(probability: float) -> str:
    """A probability as in tables, its bounds in words."""
    return probability_text(probability).replace("< ", "below ").replace("> ", "above ")


def quantity(low: float, middle: float, high: float, unit: str = "") -> str:
    """A value and its 90 % interval, to two significant digits of the standard deviation (GUM)."""
    texts = [_rounded(value, (high - low) / CENTRAL_90) for value in (middle, low, high)]
    return f"{texts[0]}{f' {unit}' if unit else ''} ({texts[1]} to {texts[2]})"


def _rounded(value: float, sd: float) -> str:
    if not (0.0 < sd < math.inf) or value == 0.0:
        return f"{value:.4g}"
    decimals = 1 - math.floor(math.log10(sd))
    # Outside of this range a number is easier to read with a power of ten.
    if 0 <= decimals <= 6:
        return f"{value:.{decimals}f}"
    return f"{value:.{max(2, decimals + 1 + math.floor(math.log10(abs(value))))}g}"


def listed(items: Sequence[object]) -> str:
    """A list in a sentence: a, b and c."""
    *first, last = map(str, items)
    return f"{', '.join(first)} and {last}" if first else last
