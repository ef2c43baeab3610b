"""What a model class claims, in words: its parameters, the modes it explains, why it loses.

Medians and 90 % intervals throughout.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from bayes_ssi.foundations.summaries import Summary
from bayes_ssi.inference.model_class.class_record import ClassRecord
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.posterior import ParameterSummary, Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.wording import listed, quantity
from bayes_ssi.studies.ranking.comparison import SCALE, RankedClass

# Parameters, or classes, listed in a sentence, about as many as one reads; tables hold all.
MOST_LISTED = 8
# A parameter whose posterior is at least this wide, relative to its prior: the data take away less
# than a fifth of its variance.
UNDETERMINED = 0.9
# A difference that is not worth more than a bare mention, in nats.
BARE_MENTION = SCALE[0][0] / 2.0


def parameters_in_words(posterior: Posterior, record: ClassRecord) -> list[str]:
    """The parameters of a class: structural ones, errors, and what the data say nothing about."""
    errors = {each.name for each in record.parameters if each.is_error}
    structural = [row for row in posterior.summary if row.name not in errors]
    sentences = []
    if structural:
        shown = best_determined(structural)
        what = "Its parameters"
        if len(shown) < len(structural):
            what = f"The {len(shown)} best determined of its {len(structural)} parameters"
        sentences.append(f"{what}, medians and 90 % intervals: {quantities(shown, record)}.")
    if errors:
        rows = [row for row in posterior.summary if row.name in errors]
        inferred = [p for product in record.error.correlations for p in product.parameters]
        what = "sizes and correlations" if inferred else "sizes"
        sentences.append(f"Inferred {what} of prediction errors: {quantities(rows, record)}.")
    vague = [row.name for row in posterior.summary if row.relative_spread >= UNDETERMINED]
    if vague:
        more = f" and {len(vague) - MOST_LISTED} others" if len(vague) > MOST_LISTED else ""
        names = ", ".join(vague[:MOST_LISTED]) if more else listed(vague)
        sentences.append(f"The data say next to nothing about {names}{more}.")
    return sentences


def best_determined(rows: Sequence[ParameterSummary]) -> list[ParameterSummary]:
    """The parameters that the data determine best, as many as a sentence lists, in their order."""
    best = sorted(rows, key=lambda row: row.relative_spread)[:MOST_LISTED]
    return [row for row in rows if row in best]


def quantities(rows: Sequence[Summary], record: ClassRecord) -> str:
    """Names, medians and 90 % intervals."""
    units = {each.name: each.unit for each in record.parameters}
    return "; ".join(
        f"{row.name} = {quantity(row.quantile_05, row.median, row.quantile_95, units[row.name])}"
        for row in rows
    )


def differ(one: Summary, other: Summary) -> bool:
    """Whether each median lies outside the other's 90 % interval."""
    return not (
        one.quantile_05 <= other.median <= one.quantile_95
        or other.quantile_05 <= one.median <= other.quantile_95
    )


def differing(one: Posterior, other: Posterior) -> tuple[list[str], list[str]]:
    """Names of the parameters of both classes: those on which they disagree, and the others."""
    theirs = {row.name: row for row in other.summary}
    shared = [row for row in one.summary if row.name in theirs]
    different = [row.name for row in shared if differ(row, theirs[row.name])]
    return different, [row.name for row in shared if row.name not in different]


def explained(posterior: Posterior, tests: Mapping[str, ModalData]) -> str:
    """Which identified modes a class explains, and how closely: "explains …"."""
    labels: list[str] = []
    missed: list[str] = []
    errors: list[float] = []
    macs: list[float] = []
    for modes in posterior.configurations:
        data = tests[modes.name]
        for label in data.labels:
            (labels if label in modes.pairing else missed).append(label_in(modes.name, label))
        for mode in modes.updated.modes:
            errors.append(abs(mode.after_hz[1] / data.mode(mode.label).frequency_hz - 1.0))
            macs += [mode.mac_after[1]] if mode.mac_after is not None else []
    if not labels:
        return "explains none of the identified modes and takes all for spurious"
    closeness = [f"frequencies within {100.0 * max(errors):.2g} %"] if errors else []
    # Rounded down, and below the 1 that no MAC exceeds.
    closeness += [f"MAC above {min(math.floor(1e3 * min(macs)), 999) / 1e3:.3f}"] if macs else []
    how = f" ({', '.join(closeness)})" if closeness else ""
    if not missed:
        return f"explains all {len(labels)} identified modes{how}"
    n = len(labels) + len(missed)
    spurious = f"takes {listed(map(repr, missed))} for spurious"
    return f"explains {len(labels)} of {n} identified modes{how} and {spurious}"


def why_it_loses(row: RankedClass, best: RankedClass) -> str:
    """Fit against complexity, in plain words."""
    if row.log_bayes_factor > 0.0:
        return "The data favour it, but its prior probability is too low."
    fit = best.mean_log_likelihood - row.mean_log_likelihood
    tuning = row.information_gained - best.information_gained
    if fit > BARE_MENTION:
        if tuning < -BARE_MENTION:
            return "It loses because it fits the data worse, though its parameters are tuned less."
        also = ", even with its parameters tuned more" if tuning > BARE_MENTION else ""
        return f"It loses because it fits the data worse{also}."
    if tuning > BARE_MENTION:
        if fit < -BARE_MENTION:
            return (
                "It loses because its better fit takes more tuning of its parameters than it "
                "justifies."
            )
        return "It loses because its parameters must be tuned more to fit equally well."
    return "It loses by a little in fit and by a little in the tuning that its parameters need."
