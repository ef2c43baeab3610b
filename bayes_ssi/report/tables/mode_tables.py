"""Identified modes: as they were read, by every method, and merged."""

from collections.abc import Mapping

from rich.table import Table

from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.merging import MergedModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.report.tables.layout import add_row, new_table, number, percent
from bayes_ssi.structures.modal import mac

# Of each mode by one method, with standard deviations.
ESTIMATES = ("frequency Hz", "± %", "damping %", "±", "shape ±")


def modes_table(data: ModalData) -> Table:
    headings = ["frequency Hz", "c.o.v. %", "damping %", "shape at", "shape ±", "phases °"]
    rows = [
        (
            mode.label,
            f"{mode.frequency_hz:.5g}",
            percent(mode.frequency_cov, ".3g"),
            percent(mode.damping, ".3g"),
            f"{mode.n_measured} of {len(data.sensors)}" if mode.n_measured else "-",
            number(mode.shape_sd, ".2g"),
            f"{mode.phase_scatter_deg:.1f}" if mode.n_measured else "-",
        )
        for mode in data.modes
    ]
    return new_table(data.source, ["mode"], headings, rows)


def estimates_table(modes: ModalData, method: str) -> Table:
    rows = [(mode.label, *_estimates(mode)) for mode in modes.modes]
    return new_table(f"Modes by {method}", ["mode"], ESTIMATES, rows)


def methods_table(by: Mapping[str, ModalData | str], names: Mapping[str, str]) -> Table:
    """Each mode by every method, with the MAC of its shape with that of the first."""
    shown = {name: modes for name, modes in by.items() if not isinstance(modes, str)}
    first = next(iter(shown.values()))
    table = new_table("Modes by every method", ["mode", "method"], [*ESTIMATES, "MAC"])
    for i, label in enumerate(first.labels):
        for name, modes in shown.items():
            alike = mac(first.unit_shapes, modes.unit_shapes)[i, modes.labels.index(label)]
            add_row(table, label, names[name], *_estimates(modes.mode(label)), f"{alike:.4f}")
    return table


def _estimates(mode: IdentifiedMode) -> tuple[str, ...]:
    return (
        f"{mode.frequency_hz:.5g}",
        percent(mode.frequency_cov, ".2g"),
        percent(mode.damping, ".3g"),
        percent(mode.damping_sd, ".2g"),
        number(mode.shape_sd, ".2g"),
    )


def merged_table(merged: MergedModes) -> Table:
    """Merged modes, with the scatter between tests over the errors that these claim."""
    headings = ["frequency Hz", "± %", "scatter/±", "shape ±", "scatter/±", "tests"]
    rows = [
        (
            row.label,
            f"{mode.frequency_hz:.5g}",
            percent(mode.frequency_cov, ".2g"),
            number(row.frequency and row.frequency.ratio, ".2f"),
            number(mode.shape_sd, ".2g"),
            number(row.shape and row.shape.ratio, ".2f"),
            str(len(row.labels)),
        )
        for row, mode in zip(merged.modes, merged.data.modes, strict=True)
    ]
    return new_table(merged.data.source, ["mode"], headings, rows)
