"""The identification of modes from a record in words."""

from collections.abc import Iterator

from bayes_ssi.foundations.displayed import counted, in_words
from bayes_ssi.measurements.modes.identification_summary import SURE_PROBABILITY, Peak
from bayes_ssi.measurements.records.modal_identification import ModalIdentification
from bayes_ssi.results.wording import listed


def identification_answer(identified: ModalIdentification) -> str:
    """Which modes, how precisely, and how many each peak holds."""
    frequencies = [mode.frequency_hz for mode in identified.modes]
    low, high = (f"{f:.4g}" for f in (min(frequencies), max(frequencies)))
    least, most = (
        f"{100.0 * end(m.frequency_cov for m in identified.modes):.2g}" for end in (min, max)
    )
    where = f"at {low} Hz" if len(frequencies) == 1 else f"from {low} to {high} Hz"
    minutes = identified.record.duration_s / 60.0
    precisely = f"{least} %" if least == most else f"{least} to {most} %"
    found = (
        f"{counted(len(frequencies), 'mode')} {where}, from {minutes:.3g} minutes of "
        f"{counted(len(identified.quoted.sensors), 'sensor')}, with standard deviations of "
        f"{precisely} of frequency."
    )
    return " ".join([found, *_peaks(identified)])


def _peaks(identified: ModalIdentification) -> Iterator[str]:
    """What is said of peaks that do not hold one mode for sure, and of the others together."""
    peaks = identified.peaks
    unknown = [each for each in peaks if each.probability_of_phases is None]
    turned = [each for each in peaks if (each.probability_of_phases or 0.0) > 0.5]
    open_ = [each for each in peaks if each.is_open and each not in turned]
    two = [each for each in peaks if (each.probability_of_two or 0.0) > SURE_PROBABILITY]
    if unknown:
        yield f"The spectra around {_at(unknown)} are not explained."
    if turned:
        yield f"At {_at(turned)} the sensors move out of phase."
    if open_:
        yield f"Whether one mode or two are at {_at(open_)}, the record cannot tell."
    if two:
        yield f"At {_at(two)} there are two modes and not one."
    rest = len(peaks) - len({id(each) for each in (*unknown, *turned, *open_, *two)})
    if rest and identified.is_explained and not identified.not_identified:
        yield f"One mode explains every {'' if rest == len(peaks) else 'other '}peak."


def _at(peaks: list[Peak]) -> str:
    return f"{listed(' and '.join(f'{f:.4g}' for f in each.frequencies_hz) for each in peaks)} Hz"


@in_words.register
def _(identified: ModalIdentification) -> str:
    """Failed checks, then the answer, a paragraph each."""
    checks = (f"(!) {check}" for check in identified.failed_checks)
    return "\n\n".join([*checks, identification_answer(identified)])
