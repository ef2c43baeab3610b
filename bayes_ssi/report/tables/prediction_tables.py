"""Predictions from a stored result."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.report.tables.layout import add_columns, add_row, interval, new_table, number
from bayes_ssi.results.predictions.predicted_modes import (
    predicted_modes,
    predicted_shapes,
    shown_places,
)
from bayes_ssi.results.predictions.response_bands import ResponseBands
from bayes_ssi.structures.modal import SHAPE_SCALE


def frequency_table(data: ModalData, responses: Sequence[ResponseBands]) -> Table:
    """Frequency of every identified mode before and after updating, median and band.

    Where only some of the averaged classes explain a mode, the fraction of such draws is given.
    """
    level = responses[0].request.level
    rows = [
        (each.name, mode)
        for each in responses
        for mode in predicted_modes(data, each.predictions, level)
    ]
    table = new_table(
        f"Natural frequencies (Hz) before and after updating, {100 * level:g} % band",
        ("model class", "mode"),
        ("identified", "before", "median", "band"),
    )
    with_fractions = any(mode.share < 1.0 for _, mode in rows)
    if with_fractions:
        add_columns(table, numbers=["of draws"])
    for name, mode in rows:
        low, median, high = mode.after_hz
        add_row(
            table,
            name,
            mode.label,
            f"{mode.identified_hz:.5g}",
            f"{mode.before_hz:.4g}",
            f"{median:.4g}",
            interval(float(low), float(high)),
            *([f"{100 * mode.share:.3g} %"] if with_fractions else []),
        )
    return table


def shape_table(data: ModalData, each: ResponseBands) -> Table | None:
    """Medians of the shapes of identified modes; None where there are none."""
    places = shown_places(each.predictions, data)
    shapes = list(predicted_shapes(data, each.predictions, each.request.level))
    if not shapes:
        return None
    title = f"Mode shapes of {each.name!r}, medians, {SHAPE_SCALE}"
    table = new_table(title, ["place"], [label for label, _ in shapes])
    for i, place in enumerate(places):
        add_row(table, place, *(number(shape.median[i], ".3f") for _, shape in shapes))
    return table


def peak_table(responses: Sequence[ResponseBands]) -> Table:
    """Peaks of transfer functions and of time histories at every place, median and band."""
    request = responses[0].request
    table = new_table(
        f"Peak {request.output.quantity}, absolute value, {100 * request.level:g} % band",
        ("model class", "of", "place"),
        ("median", "band", "unit"),
    )
    for each in responses:
        for motion, unit, place, low, median, high in each.peak_rows():
            of = motion or "transfer"
            add_row(table, each.name, of, place, f"{median:.4g}", interval(low, high), unit)
    return table
