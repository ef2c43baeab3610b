"""The result of a comparison of two tests."""

from rich.table import Table

from bayes_ssi.report.tables.layout import TABLES, add_row, new_table
from bayes_ssi.report.tables.search_tables import hypothesis_notes
from bayes_ssi.results.wording import quantity
from bayes_ssi.studies.changes.change_search import ChangeRecord, ChangeSearch
from bayes_ssi.studies.ranking.comparison import probability_text


def change_table(record: ChangeRecord) -> Table:
    """Places by the probability of a change: what they lost, and what would have been seen.

    A dash stands where no loss would have been.
    """
    heading = ["smallest visible (%)"] if record.has_visible else []
    table = new_table(
        "Changes by place, averaged over all hypotheses: medians and 90 % intervals",
        ["place", "loss"],
        ["probability", "share lost (%)", *heading],
    )
    for each in record.places_by_probability[: TABLES.most_places]:
        least = each.smallest_visible
        visible = "-" if least is None else f"{100.0 * least:.2g}"
        of_place = [each.place.name, probability_text(each.probability), visible]
        for loss, shares in each.change.losses.items():
            name, probability, seen = of_place
            lost = quantity(*(100.0 * share for share in shares))
            cells = [name, loss.removeprefix("loss, "), probability, lost]
            add_row(table, *cells, *([seen] if heading else []))
            of_place = ["", "", ""]
    return table


def change_notes(search: ChangeSearch) -> list[str]:
    """What was compared, and what the notes of every search say."""
    record, n_more = search.record, len(search.record.places) - TABLES.most_places
    notes = [f"{n_more} less probable places are in the saved result."] if n_more > 0 else []
    if record.has_visible:
        notes.append(
            "Smallest visible: the loss of all stiffness of that place that these tests would have "
            "shown, nine times as probable as no change, with probability 0.9."
        )
    return notes + hypothesis_notes(search)
