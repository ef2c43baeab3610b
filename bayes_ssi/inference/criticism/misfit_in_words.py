"""In an engineer's words: what of the data a model class does not explain, and a likely cause."""

from collections.abc import Iterator

from bayes_ssi.inference.criticism.adequacy import (
    Adequacy,
    CountMisfit,
    ModeMisfit,
    ParameterMisfit,
    PValue,
)
from bayes_ssi.inference.criticism.misfit import CRITICISM

POSSIBLE_CAUSES = (
    "wrong channel order, wrong units, wrong pairing, or a structure nobody wrote down"
)


def misfits_in_words(adequacy: Adequacy) -> list[str]:
    """The largest misfits, the worst first; the largest one alone if each is small by itself."""
    named = sorted(_each(adequacy), key=lambda item: -item[0].sds)
    large = [words for misfit, words in named[: CRITICISM.most_named] if misfit.is_small]
    return large or [
        f"misfits that are small one by one, but not together; the largest: {named[0][1]}"
    ]


def inadequacy_in_words(adequacy: Adequacy, others: str = "") -> str:
    """What of the data a class that is not adequate does not explain, and why that may be."""
    what = "the data are not explained"
    if adequacy.is_rough and not adequacy.overall.is_small:
        error = _percent(adequacy.frequency_error or 0.0)
        what = (
            f"the model does not fit: it infers an error of {error} for its frequencies, more than "
            f"{_percent(CRITICISM.rough)}"
        )
    elif not adequacy.overall.is_small:
        what, others = "the data are explained far better without a mistake in them", ""
    mistakes = (f"{hint.mistake} (gain {hint.gain:.0f} nats)" for hint in adequacy.hints)
    causes = "; ".join(mistakes) or POSSIBLE_CAUSES
    sentences = (f"{what}: {'; '.join(misfits_in_words(adequacy))}", others)
    return ". ".join([*filter(None, sentences), f"Likely cause: {causes}"])


def misfit_text(sds: float | None) -> str:
    """A misfit in standard deviations; a dash where it is not known."""
    if sds is None:
        return "-"
    return f"{sds:.1f} sd" if sds < 100.0 else "> 100 sd"


def _each(adequacy: Adequacy) -> Iterator[tuple[PValue, str]]:
    for mode in adequacy.modes:
        yield mode.misfit, _mode(mode)
    for parameter in adequacy.parameters:
        yield parameter.misfit, _parameter(parameter, adequacy)
    for count in adequacy.counts:
        yield count.misfit, _count(count)


def _mode(mode: ModeMisfit) -> str:
    """What is unusual about a mode, beyond what 95 % of right ones are; else all of it."""
    parts = []
    if mode.frequency_error is not None and mode.frequency_sd is not None:
        off, expected = _percent(mode.frequency_error), _percent(mode.frequency_sd)
        unusual = abs(mode.frequency_error) > 2.0 * mode.frequency_sd
        parts.append((unusual, f"{off} off where {expected} was expected"))
    if mode.mac is not None and mode.expected_mac is not None:
        text = "MAC {} where {} was expected".format(*_different(mode.mac, mode.expected_mac))
        parts.append((mode.mac < mode.expected_mac, text))
    shown = [text for unusual, text in parts if unusual] or [text for _, text in parts]
    return f"mode {mode.label!r}: {', '.join(shown) or 'spurious'}"


def _parameter(parameter: ParameterMisfit, adequacy: Adequacy) -> str:
    side = "above" if parameter.prior_sds > 0 else "below"
    text = (
        f"{parameter.name} is {parameter.value:.2g} where {parameter.prior_median:.2g} was "
        f"expected, {abs(parameter.prior_sds):.1f} standard deviations of its prior {side}"
    )
    # A large error size hides the misfit that made it large.
    paired = [mode for mode in adequacy.modes if mode.frequency_error is not None]
    if parameter.is_error_size and paired:
        farthest = max(paired, key=lambda mode: abs(mode.frequency_error or 0.0))
        text += f" (mode {farthest.label!r} is {_percent(farthest.frequency_error or 0.0)} off"
        scored = [mode for mode in paired if mode.mac is not None]
        if scored:
            least = min(scored, key=lambda mode: mode.mac or 0.0)
            text += f", mode {least.label!r} has MAC {least.mac:.2f}"
        text += ")"
    return text


def _count(count: CountMisfit) -> str:
    where = f"configuration {count.configuration!r}: " if count.configuration else ""
    return (
        f"{where}spurious modes {count.spurious:.2g} where {count.expected_spurious:.2g} was "
        f"expected, unidentified model modes in the band {count.unidentified:.2g}"
    )


def _different(*numbers: float) -> list[str]:
    """Numbers to two decimals, or to as many as tell them apart."""
    texts: list[str] = []
    for decimals in range(2, 9):
        texts = [f"{number:.{decimals}f}" for number in numbers]
        if len(set(texts)) == len(texts):
            break
    return texts


def _percent(fraction: float) -> str:
    return f"{100 * abs(fraction):.2g} %"
