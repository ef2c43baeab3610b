"""Probabilities, quantities and lists as they stand in a sentence."""

import math
from collections.abc import Sequence

from bayes_ssi.foundations.displayed import listed as listed
from bayes_ssi.studies.ranking.comparison import probability_text

# What sentences list, and what they pass over.
MOST_LISTED = 8  # items of a list, about as many as one reads; tables hold all
# Posterior over prior spread of a parameter about which the data say next to nothing: they take
# away less than a fifth of its variance.
UNDETERMINED_SPREAD = 0.9
# Probability of all hypotheses that were not sampled, together, that needs no sentence.
NEGLIGIBLE_UNSAMPLED = 0.01

# The calibrated language of the IPCC (Mastrandrea et al. 2010), by the least probability.
LIKELIHOOD = (
    (0.99, "virtually certain"),
    (0.95, "extremely likely"),
    (0.90, "very likely"),
    (0.66, "likely"),
    (0.50, "more likely than not"),
)


def data_warnings(
    failed: Sequence[str], accepted: bool = False
) -> list[tuple[str, tuple[str, ...]]]:
    """What to understand before anything that follows from data with failed checks is trusted.

    Returns:
        A sentence with the items of the list below it; nothing if no check failed.
    """
    if not failed:
        return []
    text = (
        f"{len(failed)} check{'s' if len(failed) > 1 else ''} of the identified modes failed"
        f"{' (accepted when the result was saved)' if accepted else ''}: modes may be wrong or "
        "missing, or their errors too small. Whatever follows from them may be wrong, too."
    )
    return [(text, tuple(failed))]


def likelihood_in_words(probability: float) -> str:
    """A probability in the IPCC's words; "less likely than not" below one half."""
    words = (words for least, words in LIKELIHOOD if probability >= least)
    return next(words, "less likely than not")


def probability_in_words(probability: float) -> str:
    """A probability as in tables, its bounds in words."""
    return probability_text(probability).replace("< ", "below ").replace("> ", "above ")


def quantity(low: float, middle: float, high: float, unit: str = "") -> str:
    """A value and its 90 % interval, to two significant digits of the interval's width."""
    texts = [_rounded(value, high - low) for value in (middle, low, high)]
    return f"{texts[0]}{f' {unit}' if unit else ''} ({texts[1]} to {texts[2]})"


def _rounded(value: float, width: float) -> str:
    if not (0.0 < width < math.inf) or value == 0.0:
        return f"{value:.4g}"
    decimals = 1 - math.floor(math.log10(width))
    # Outside of this range a number is easier to read with a power of ten.
    if -5 <= decimals <= 6:
        return f"{round(value, decimals) + 0.0:.{max(0, decimals)}f}"  # no negative zero
    return f"{value:.{max(2, decimals + 1 + math.floor(math.log10(abs(value))))}g}"


def shortened(items: Sequence[str]) -> str:
    """The first of a list in a sentence, and how many others there are."""
    n = len(items) - MOST_LISTED
    others = [] if n <= 0 else ["one other"] if n == 1 else [f"{n} others"]
    return listed([*items[:MOST_LISTED], *others])
