"""What a stored result predicts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.predictions.bands import Band
from bayes_ssi.predictions.predicted_modes import predicted_modes, predicted_shapes, shown_places
from bayes_ssi.predictions.response_bands import ResponseBands
from bayes_ssi.tables.layout import add_row, new_table

__all__ = ["frequency_table", "peak_table", "shape_tables"]

# Columns of a terminal, and how many a component of a shape takes with the space about it.
WIDTH, COMPONENT = 80, 9


def frequency_table(data: ModalData, responses: Sequence[ResponseBands]) -> Table:
    """Frequency of every identified mode before and after updating, median and band.

    A mode that only some of the averaged classes explain shows in what share of the draws.
    """
    level = responses[0].request.level
    table = new_table(f"Natural frequencies (Hz) before and after updating, {100 * level:g} % band")
    _add_columns(table, ("model class", "mode"), ("identified", "before", "median", "band"))
    rows = [
        (each.name, mode)
        for each in responses
        for mode in predicted_modes(data, each.predictions, level)
    ]
    with_shares = any(mode.share < 1.0 for _, mode in rows)
    if with_shares:
        table.add_column("share", justify="right")
    for name, mode in rows:
        low, median, high = mode.after_hz
        share = [f"{mode.share:.3g}"] if with_shares else []
        add_row(
            table, name, mode.label, f"{mode.identified_hz:.5g}", f"{mode.before_hz:.4g}",
            f"{median:.4g}", f"{low:.4g}-{high:.4g}", *share,
        )  # fmt: skip
    return table


def shape_tables(data: ModalData, each: ResponseBands) -> Iterator[Table]:
    """Medians of the shapes of identified modes, as many modes a table as a terminal is wide."""
    places = shown_places(each.predictions, data)
    wide = max(COMPONENT, 3 + max((len(label) for label in data.labels), default=0))
    at_once = max(1, (WIDTH - min(30, max(map(len, places))) - 2) // wide)
    shapes = list(predicted_shapes(data, each.predictions, each.request.level))
    for start in range(0, len(shapes), at_once):
        part = shapes[start : start + at_once]
        table = new_table(f"Mode shapes of {each.name!r} at unit length, medians")
        _add_columns(table, ("mode",), tuple(label for label, _ in part))
        for i, place in enumerate(places):
            # Adding zero makes a negative zero a plain one.
            add_row(table, place, *(f"{round(shape.median[i], 3) + 0.0:.3f}" for _, shape in part))
        yield table


def peak_table(responses: Sequence[ResponseBands]) -> Table:
    """Peaks of transfer functions and of time histories at every place, median and band."""
    request = responses[0].request
    level = f"{100 * request.level:g} % band"
    table = new_table(f"Peak {request.output.quantity}, absolute value, {level}")
    _add_columns(table, ("model class", "of", "place"), ("median", "band", "unit"))
    for each in responses:
        found = [(name, request.unit, band) for name, band in each.peaks.items()]
        if each.transfer_peaks is not None:
            name = "transfer"
            found.insert(0, (name, request.transfer_unit, each.transfer_peaks))
        for name, unit, band in found:
            for i, place in enumerate(request.output.labels):
                add_row(table, each.name, name, place, *_interval(band, i), unit)
    return table


def _add_columns(table: Table, texts: Sequence[str], numbers: Sequence[str]) -> None:
    """Columns whose words may be broken, and columns of numbers, which may not."""
    for heading in texts:
        table.add_column(heading, overflow="fold")
    for heading in numbers:
        table.add_column(heading, justify="right", no_wrap=True)


def _interval(band: Band, i: int) -> tuple[str, str]:
    low, median, high = (part[i] for part in band)
    return f"{median:.4g}", f"{low:.4g}-{high:.4g}"
