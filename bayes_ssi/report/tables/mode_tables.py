"""Identified modes: as they were read, by every method, and merged."""

from collections.abc import Mapping

from rich.table import Table

from bayes_ssi.measurements.modes.merging import MergedModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.modal_estimates import MethodModes, ModalEstimates
from bayes_ssi.report.tables.layout import add_row, new_table, number, percent

# Of each mode by one method, with standard deviations.
ESTIMATES = ("frequency Hz", "± %", "damping %", "±", "shape ±")


def modes_table(data: ModalData, most: int | None = None) -> Table:
    """The identified modes as they were read, at most the first ``most`` of them."""
    table = new_table(
        data.source,
        ["mode"],
        ["frequency Hz", "c.o.v. %", "damping %", "shape at", "shape ±", "phases °"],
    )
    for mode in data.modes[:most]:
        has_shape = mode.n_measured > 0
        add_row(
            table,
            mode.label,
            f"{mode.frequency_hz:.5g}",
            percent(mode.frequency_cov, ".3g"),
            percent(mode.damping, ".3g"),
            f"{mode.n_measured} of {len(data.sensors)}" if has_shape else "-",
            number(mode.shape_sd, ".2g"),
            f"{mode.phase_scatter_deg:.1f}" if has_shape else "-",
        )
    return table


def estimates_table(modes: ModalEstimates) -> Table:
    """Modes identified from a record, with standard deviations."""
    table = new_table(f"Modes by {modes.method}", ["mode"], ESTIMATES)
    for i in range(modes.n_modes):
        add_row(table, str(i + 1), *_estimates(modes.method_modes, i))
    return table


def methods_table(by: Mapping[str, MethodModes | str], names: Mapping[str, str]) -> Table:
    """Each mode by every method, with the MAC of its shape with that of the first."""
    shown = {name: modes for name, modes in by.items() if not isinstance(modes, str)}
    first = next(iter(shown.values()))
    table = new_table("Modes by every method", ["mode", "method"], [*ESTIMATES, "MAC"])
    for i in range(len(first.frequencies_hz)):
        for name, modes in shown.items():
            mac = float(modes.shapes[:, i] @ first.shapes[:, i]) ** 2
            add_row(table, str(i + 1), names[name], *_estimates(modes, i), f"{mac:.4f}")
    return table


def _estimates(modes: MethodModes, i: int) -> tuple[str, ...]:
    cov, damping, damping_sd, shape_sd = (
        None if column is None else float(column[i])
        for column in (modes.frequency_covs, modes.dampings, modes.damping_sds, modes.shape_sds)
    )
    return (
        f"{modes.frequencies_hz[i]:.5g}",
        percent(cov, ".2g"),
        percent(damping, ".3g"),
        percent(damping_sd, ".2g"),
        number(shape_sd, ".2g"),
    )


def merged_table(merged: MergedModes) -> Table:
    """Merged modes, with the scatter between tests over the errors that these claim."""
    table = new_table(
        merged.data.source,
        ["mode"],
        ["frequency Hz", "± %", "scatter/±", "shape ±", "scatter/±", "tests"],
    )
    for row, mode in zip(merged.modes, merged.data.modes, strict=True):
        add_row(
            table,
            row.label,
            f"{mode.frequency_hz:.5g}",
            percent(mode.frequency_cov, ".2g"),
            number(None if row.frequency is None else row.frequency.ratio, ".2f"),
            number(mode.shape_sd, ".2g"),
            number(None if row.shape is None else row.shape.ratio, ".2f"),
            str(len(row.labels)),
        )
    return table
