"""The result of a search for appendages."""

from __future__ import annotations

from rich.table import Table

from bayes_ssi.appendages.search_result import AppendageSearch
from bayes_ssi.ranking.comparison import probability_text
from bayes_ssi.tables.layout import add_columns, add_row, interval, new_table

# Hypotheses and places listed in a terminal; the saved result has all.
HYPOTHESES_SHOWN = 8


def search_table(search: AppendageSearch) -> Table:
    """Hypotheses of a search by probability, with medians and 90 % intervals of appendages.

    The mass ratio is the vibrating mass over the mean floor mass.
    """
    table = new_table(search.ranking.study.name)
    table.add_column("hypothesis", overflow="fold", min_width=18)
    add_columns(table, numbers=["ln evidence", "probability", "mass ratio", "Hz"])
    rows = search.ranking.comparison.classes
    for rank, row in enumerate(rows):
        appendages = search.appendages(row.name)
        if rank >= HYPOTHESES_SHOWN and appendages:
            continue
        lines = " +\n".join(each.place.name for each in appendages) or row.name
        add_row(
            table,
            f"{lines} (!)" if row.failed_checks else lines,
            f"{row.log_evidence:.2f}",
            row.probability_text,
            "\n".join(_interval(each.mass_ratio) for each in appendages) or "-",
            "\n".join(_interval(each.frequency_hz) for each in appendages) or "-",
        )
    return table


def averaged_table(search: AppendageSearch) -> Table:
    """The baseline's parameters averaged over all hypotheses, and without any appendage."""
    table = new_table("Parameters averaged over the hypotheses; naive: without any appendage")
    table.add_column("parameter", overflow="fold")
    for heading in ("mean", "sd", "5 %", "95 %", "naive mean", "naive sd"):
        table.add_column(heading, justify="right")
    for row in search.record.averaged_parameters:
        numbers = (
            row.mean, row.sd, row.quantile_05, row.quantile_95, row.naive_mean, row.naive_sd
        )  # fmt: skip
        add_row(table, row.name, *(f"{number:.4g}" for number in numbers))
    return table


def search_notes(search: AppendageSearch) -> list[str]:
    """The answer of a search in words."""
    notes = [
        "Probability that there is an appendage: "
        f"{probability_text(search.record.probability_of_any)}. By place:"
    ]
    by_probability = sorted(search.record.place_probabilities.items(), key=lambda item: -item[1])
    notes += [
        f"  {place.name}: {probability_text(probability)}"
        for place, probability in by_probability[:HYPOTHESES_SHOWN]
    ]
    hidden = sum(bool(each.appendages) for each in search.record.hypotheses[HYPOTHESES_SHOWN:])
    if hidden > 0:
        notes.append(f"{hidden} less probable hypotheses are in the saved result.")
    return notes


def _interval(numbers: tuple[float, float, float]) -> str:
    low, middle, high = numbers
    return f"{middle:.2g} ({interval(low, high, '.2g')})"
