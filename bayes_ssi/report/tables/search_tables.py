"""The result of a search for appendages, or for what changed between two tests."""

from collections.abc import Iterator
from typing import Any

from rich.table import Table

from bayes_ssi.foundations.displayed import columns, counted
from bayes_ssi.report.tables import layout
from bayes_ssi.results.stored_result import StoredResult
from bayes_ssi.results.wording import quantity
from bayes_ssi.studies.appendages.appendage_search import SearchRecord
from bayes_ssi.studies.ranking.comparison import PROBABLE, Comparison, probability_text
from bayes_ssi.studies.search.findings import FamilyRecord

APPROXIMATELY = "≈ "
# Of baselines and of hypotheses.
NUMBERS = ("prior probability", "probability", "log evidence", "ln B")


def first_tables(result: StoredResult) -> Iterator[Table]:
    """The hypotheses of a search that are probable, and the places, if there is anything."""
    record = result.search
    assert record is not None
    yield search_table(record, result.comparison, result.record.study, PROBABLE)
    if record.is_more_likely:
        yield places_table(record, PROBABLE)


def places_table(record: FamilyRecord, least: float = 0.0) -> Table:
    """Where the features of a family are; those below a probability in one line."""
    if isinstance(record, SearchRecord):
        return appendage_place_table(record, least)
    return place_table(record, least)


def further_tables(result: StoredResult) -> Iterator[Table | str]:
    """The other tables and the notes on a search, in the order in which they are read."""
    record = result.search
    assert record is not None
    yield search_table(record, result.comparison, result.record.study)
    yield places_table(record)
    if isinstance(record, SearchRecord):
        if len(record.baselines) > 1:
            yield baseline_table(record)
        yield from baseline_notes(record)
    yield averaged_table(record)
    yield from search_notes(record)


def baseline_table(record: SearchRecord) -> Table:
    """The baselines by the probability of all hypotheses on each; a dash where none was tried."""
    best = record.best_without_appendages.log_evidence
    rows = [
        (
            layout.marked(each.name, each in record.beaten),
            probability_text(each.prior_probability) if each.prior_probability > 0.0 else "-",
            probability_text(each.probability) if each.prior_probability > 0.0 else "-",
            f"{each.log_evidence:.2f}",
            f"{each.log_evidence - best:.2f}",
        )
        for each in record.baselines
    ]
    title = "Baselines, and classes to compare them with: log evidence without any appendage"
    return layout.new_table(title, ["baseline"], NUMBERS, rows)


def baseline_notes(record: SearchRecord) -> list[str]:
    """Baselines that another class beats without any appendage, and classes left out."""
    best = record.best_without_appendages
    notes = [
        f"(!) {each.name!r}: without any appendage, {best.name!r} beats it by "
        f"{best.log_evidence - each.log_evidence:.1f} nats."
        for each in record.beaten
        if each.probability < PROBABLE  # others are a warning ahead of the answer
    ]
    return notes + [f"Left out: {reason}" for reason in record.left_out.values()]


def search_table(
    record: FamilyRecord, comparison: Comparison, title: str, least: float = 0.0
) -> Table:
    """Hypotheses of a search by probability; evidences that were not sampled have a sign.

    Those with features that are less probable than ``least`` are left out.
    """
    best = comparison.best.log_evidence
    failed = {row.name for row in comparison.classes if row.failed_checks}
    rows = []
    for row in _shown(record):
        if row.features and row.probability < least:
            continue
        sign = "" if row.is_sampled else APPROXIMATELY
        rows.append((
            layout.marked(row.name, row.name in failed),
            probability_text(row.prior_probability),
            f"{sign}{probability_text(row.probability)}".replace(f"{sign}<", "<"),
            f"{sign}{row.log_evidence:.2f}",
            f"{sign}{row.log_evidence - best:.2f}",
        ))  # fmt: skip
    return layout.new_table(title, ["hypothesis"], NUMBERS, rows)


def appendage_place_table(record: SearchRecord, least: float = 0.0) -> Table:
    """The most probable places, and the sum over the others: medians and 90 % intervals.

    Of one appendage after the other, each over all hypotheses with as many.
    """
    number = counted(len(record.matched), "appendage") if record.matched else "any"
    title = f"Appendages by place, averaged over all hypotheses with {number}"
    headings = ["probability", record.mass_heading, "frequency (Hz)"]
    table = layout.new_table(f"{title}: medians and 90 % intervals", ["place"], headings)
    for group in record.shown:
        shown = [each for each in group[: layout.MOST_PLACES] if each.probability >= least]
        for each in shown:
            amounts = (quantity(*each.amounts[name]) for name in ("mass", "frequency_hz"))
            layout.add_row(table, each.place.name, probability_text(each.probability), *amounts)
        if others := group[len(shown) :]:
            together = sum(each.probability for each in others)
            layout.add_row(table, f"{len(others)} others", probability_text(together), "", "")
    for each in record.motions:
        if each.probability >= PROBABLE:
            cells = probability_text(each.probability), "-", quantity(*each.amounts["frequency_hz"])
            layout.add_row(table, each.place.name, *cells)
    return table


def _shown(record: FamilyRecord) -> list[Any]:
    """The hypotheses that tables show: the most probable ones, and no feature."""
    rows = enumerate(record.hypotheses)
    return [row for i, row in rows if i < layout.MOST_HYPOTHESES or not row.features]


def averaged_table(record: FamilyRecord) -> Table:
    """The baseline's parameters averaged over sampled hypotheses, and of the simplest one."""
    fields = ("mean", "sd", "quantile_05", "quantile_95", "naive_mean", "naive_sd")
    rows = [
        [row.name, *layout.digits(*columns(row, fields).values())]
        for row in record.averaged_parameters
    ]
    title = f"Parameters averaged over sampled hypotheses; naive: {record.nothing}"
    headings = ["mean", "sd", "5 %", "95 %", "naive mean", "naive sd"]
    return layout.new_table(title, ["parameter"], headings, rows)


def search_notes(record: FamilyRecord) -> list[str]:
    """What numbers refer to, places nobody sees, and which hypotheses no table shows."""
    notes = []
    if isinstance(record, SearchRecord):
        notes += [f"Priors of masses are relative to {mass}." for mass in mass_scales(record)]
    else:
        if (n_more := len(record.places) - layout.MOST_PLACES) > 0:
            notes.append(f"{n_more} less probable places are in the saved result.")
        if record.has_visible:
            notes.append(
                "Smallest visible: the loss, the same share of each stiffness there, that these "
                "tests would have shown, nine times as probable as no change, with probability 0.9."
            )
    notes += filter(None, [unseen_note(record)])
    n_hidden = len(record.hypotheses) - len(_shown(record))
    if n_hidden > 0:
        notes.append(f"{n_hidden} less probable hypotheses are in the saved result.")
    notes.extend(unsampled_notes(record))
    if record.n_not_tried:
        notes.append(
            f"Not tried: {record.n_not_tried} with several {record.feature}s; expected probability "
            f"{probability_text(record.expected_not_tried)}."
        )
    return notes


def mass_scales(record: SearchRecord) -> list[str]:
    """The masses that mass ratios refer to, in words, one for all baselines where they agree."""
    scales = {each.name: each.mass_scale for each in record.baselines if each.mass_scale}
    unit = f" {record.mass_unit}" if record.mass_unit else ""
    words = [f"the {scale.name}, {scale.mass:.4g}{unit}" for scale in scales.values()]
    if len(set(words)) == 1:
        return words[:1]
    return [f"{text}, on {name!r}" for name, text in zip(scales, words, strict=True)]


def unseen_note(record: FamilyRecord) -> str:
    """The places about which the tests say nothing; empty if there are none."""
    unseen = [finding.place.name for finding in record.places if not finding.is_observed]
    if not unseen:
        return ""
    shown, others = unseen[: layout.MOST_PLACES], unseen[layout.MOST_PLACES :]
    return (
        f"The test says nothing about these places, {record.why_unseen}: "
        f"{', '.join(shown)}{f' and {len(others)} more' if others else ''}."
    )


def unsampled_notes(record: FamilyRecord) -> list[str]:
    """How many hypotheses were not sampled, how probable they are at most, and how far off."""
    if not record.n_unsampled:
        return []
    sampled = [each for each in record.hypotheses if each.is_sampled]
    errors = [each.screened - each.log_evidence for each in sampled]
    sign = APPROXIMATELY.strip()
    return [
        f"{sign}: not sampled, {record.n_unsampled} of {len(record.hypotheses)} hypotheses; "
        f"probability together at most {probability_text(record.most_probability_unsampled)}.",
        f"{sign}: off by {min(errors):+.2f} to {max(errors):+.2f} nats where "
        "hypotheses were sampled.",
    ]


def place_table(record: FamilyRecord, least: float = 0.0) -> Table:
    """Places by probability: how much there is at each, a row for each quantity.

    What changes would have been seen is a dash where none would have been.
    """
    what, amount = record.amount
    title = f"{record.feature.capitalize()}s by place, averaged over all hypotheses"
    headings = ["probability", amount, *["smallest visible (%)"] * record.has_visible]
    table = layout.new_table(f"{title}: medians and 90 % intervals", ["place", what], headings)
    for each in record.places_by_probability[: layout.MOST_PLACES]:
        if each.probability < least:
            continue
        visible = each.smallest_visible
        seen = ["-" if visible is None else f"{100.0 * visible:.2g}"] * record.has_visible
        of_place = [each.place.name, probability_text(each.probability), *seen]
        for quantity_name, of_one in each.amounts.items():
            name, probability, *others = of_place
            low, middle, high = (record.scale * one for one in of_one)
            label = quantity_name.removeprefix(f"{what}, ")
            layout.add_row(table, name, label, probability, quantity(low, middle, high), *others)
            of_place = [""] * len(of_place)
    return table
