"""Calibrations: every minimum, and the modes before and after."""

from __future__ import annotations

from rich.table import Table

from bayes_ssi.calibration.calibration import Calibration
from bayes_ssi.model_class.configuration import label_in
from bayes_ssi.tables.layout import NUMBER, TERMINAL, add_columns, add_row, new_table, number


def calibration_table(calibration: Calibration) -> Table:
    """Every distinct minimum: parameter values, objective and distance.

    Parameters are columns where the terminal is wide enough for them; otherwise they are rows, and
    as many of the best minima as fit are columns.
    """
    names = (*calibration.parameter_names, "f_ob (%)", "d (%)")
    fits = {"before": calibration.before}
    fits |= {str(i): fit for i, fit in enumerate(calibration.minima, 1)}
    cells = {
        label: (
            *(f"{value:.4g}" for value in fit.values),
            f"{100 * fit.objective:.3f}",
            f"{100 * fit.distance:.1f}",
        )
        for label, fit in fits.items()
    }
    title = f"Minima of {calibration.name!r}, λ = {calibration.shape_weight:g}"
    across = TERMINAL // NUMBER
    if len(names) <= across:
        table = new_table(title, numbers=("", *names))
        for label, row in cells.items():
            add_row(table, label, *row)
        return table
    # The names of parameters may take as much room as three columns.
    shown = list(cells)[: across - 3]
    if len(shown) < len(cells):
        title += f": the best {len(shown) - 1} of {len(calibration.minima)}"
    table = new_table(title)
    table.add_column("", overflow="fold", min_width=min(2 * NUMBER, max(map(len, names))))
    add_columns(table, numbers=shown)
    for i, name in enumerate(names):
        add_row(table, name, *(cells[label][i] for label in shown))
    return table


def calibration_modes_table(calibration: Calibration) -> Table:
    """Frequencies and MAC before calibration and at the best minimum."""
    table = new_table(f"Modes of {calibration.name!r}")
    table.add_column("mode", justify="right", overflow="fold")
    add_columns(table, numbers=(
        "model\nmode", "identified\nHz", "before\nHz", "after\nHz", "MAC\nbefore", "MAC\nafter",
    ))  # fmt: skip
    pairs = zip(calibration.before.modes, calibration.best.modes, strict=True)
    for before, after in pairs:
        add_row(
            table,
            label_in(after.configuration, after.label),
            str(before.model_mode),
            f"{before.identified_hz:.4g}",
            f"{before.model_hz:.4g}",
            f"{after.model_hz:.4g}",
            number(before.mac, ".4f"),
            number(after.mac, ".4f"),
        )
    return table
