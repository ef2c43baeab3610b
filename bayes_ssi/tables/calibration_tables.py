"""Fits: every minimum, and the modes before and after."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from bayes_ssi.calibration.calibration import Calibration
from bayes_ssi.model_class.configuration import label_in
from bayes_ssi.tables.layout import add_row, new_table, number

__all__ = [
    "calibration_modes_table",
    "calibration_table",
]

# Characters of a mode's label that stay on one line.
LABEL_WIDTH = 16
# More parameters than this are rows instead of columns; as many minima fit beside them.
PARAMETERS_ACROSS = 6
MINIMA_ACROSS = 4


def calibration_table(calibration: Calibration) -> Table:
    """Every distinct minimum: parameter values, objective and distance.

    A model with many parameters has them below one another, and only the best minima.
    """
    if len(calibration.parameter_names) > PARAMETERS_ACROSS:
        return _tall_calibration_table(calibration)
    table = new_table(f"Minima of {calibration.name!r}, λ = {calibration.shape_weight:g}")
    table.add_column("", justify="right")
    for name in calibration.parameter_names:
        table.add_column(Text(name), justify="right")
    table.add_column("f_ob (%)", justify="right")
    table.add_column("d (%)", justify="right")
    rows = [("before", calibration.before)]
    rows += [(str(i), fit) for i, fit in enumerate(calibration.minima, 1)]
    for label, fit in rows:
        values = (f"{value:.4g}" for value in fit.values)
        add_row(table, label, *values, f"{100 * fit.objective:.3f}", f"{100 * fit.distance:.1f}")
    return table


def _tall_calibration_table(calibration: Calibration) -> Table:
    """A row a parameter, a column a minimum."""
    count = len(calibration.minima)
    title = f"Minima of {calibration.name!r}, λ = {calibration.shape_weight:g}"
    if count > MINIMA_ACROSS:
        title += f": the best {MINIMA_ACROSS} of {count}"
    table = new_table(title)
    fits = (calibration.before, *calibration.minima[:MINIMA_ACROSS])
    longest = max(map(len, calibration.parameter_names))
    table.add_column("", overflow="fold", min_width=min(longest, LABEL_WIDTH))
    for heading in ("before", *range(1, len(fits))):
        table.add_column(str(heading), justify="right", no_wrap=True)
    for i, name in enumerate(calibration.parameter_names):
        add_row(table, name, *(f"{fit.values[i]:.4g}" for fit in fits))
    add_row(table, "f_ob (%)", *(f"{100 * fit.objective:.3f}" for fit in fits))
    add_row(table, "d (%)", *(f"{100 * fit.distance:.1f}" for fit in fits))
    return table


def calibration_modes_table(calibration: Calibration) -> Table:
    """Frequencies and MAC before calibration and at the best minimum."""
    table = new_table(f"Modes of {calibration.name!r}")
    labels = [label_in(mode.configuration, mode.label) for mode in calibration.best.modes]
    table.add_column("mode", justify="right", overflow="fold")
    for heading in (
        "model\nmode", "identified\nHz", "before\nHz", "after\nHz", "MAC\nbefore", "MAC\nafter"
    ):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    pairs = zip(calibration.before.modes, calibration.best.modes, strict=True)
    for label, (before, after) in zip(labels, pairs, strict=True):
        add_row(
            table,
            label,
            str(before.model_mode),
            f"{before.identified_hz:.4g}",
            f"{before.model_hz:.4g}",
            f"{after.model_hz:.4g}",
            number(before.mac, ".4f"),
            number(after.mac, ".4f"),
        )
    return table
