"""Identified modes as they were read."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table

from bayes_ssi.measurements.modes.merging import MergedModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.modal_estimates import MethodModes, ModalEstimates
from bayes_ssi.report.tables.layout import add_row, new_table, number


def modes_table(data: ModalData, most: int | None = None) -> Table:
    """The identified modes as they were read, at most the first ``most`` of them."""
    table = new_table(
        data.source,
        ["mode"],
        ["frequency Hz", "c.o.v. %", "damping %", "shape at", "shape ±", "phases °"],
    )
    for mode in data.modes[:most]:
        cov, damping = (
            number(None if fraction is None else 100.0 * fraction, ".3g")
            for fraction in (mode.frequency_cov, mode.damping)
        )
        has_shape = mode.n_measured > 0
        add_row(
            table,
            mode.label,
            f"{mode.frequency_hz:.5g}",
            cov,
            damping,
            f"{mode.n_measured} of {len(data.sensors)}" if has_shape else "-",
            number(mode.shape_sd, ".2g"),
            f"{mode.phase_scatter_deg:.1f}" if has_shape else "-",
        )
    return table


def estimates_table(modes: ModalEstimates) -> Table:
    """Modes identified from a record, with standard deviations."""
    table = new_table(
        f"Modes by {modes.method}",
        ["mode"],
        ["frequency Hz", "± %", "damping %", "±", "shape ±"],
    )
    rows = zip(
        modes.frequencies_hz, modes.frequency_covs, modes.dampings, modes.damping_sds,
        modes.shape_sds, strict=True,
    )  # fmt: skip
    for label, (frequency, cov, damping, damping_sd, shape_sd) in enumerate(rows, 1):
        add_row(
            table,
            str(label),
            f"{frequency:.5g}",
            f"{100.0 * cov:.2g}",
            f"{100.0 * damping:.3g}",
            f"{100.0 * damping_sd:.2g}",
            f"{shape_sd:.2g}",
        )
    return table


def methods_table(by: Mapping[str, MethodModes | str], names: Mapping[str, str]) -> Table:
    """Each mode by every method, with the MAC of its shape with that of the first."""
    shown = {name: modes for name, modes in by.items() if not isinstance(modes, str)}
    first = next(iter(shown.values()))
    table = new_table("Modes by every method", ["mode", "method"], ["frequency Hz", "± %",
                      "damping %", "±", "shape ±", "MAC"])  # fmt: skip
    for i in range(len(first.frequencies_hz)):
        for name, modes in shown.items():
            covs, dampings = modes.frequency_covs, modes.dampings
            add_row(
                table,
                str(i + 1),
                names[name],
                f"{modes.frequencies_hz[i]:.5g}",
                number(None if covs is None else 100.0 * covs[i], ".2g"),
                number(None if dampings is None else 100.0 * dampings[i], ".3g"),
                number(None if modes.damping_sds is None else 100.0 * modes.damping_sds[i], ".2g"),
                number(None if modes.shape_sds is None else modes.shape_sds[i], ".2g"),
                f"{float(modes.shapes[:, i] @ first.shapes[:, i]) ** 2:.4f}",
            )
    return table


def merged_table(merged: MergedModes) -> Table:
    """Merged modes, with the scatter between tests over the errors that these claim."""
    table = new_table(
        merged.data.source,
        ["mode"],
        ["frequency Hz", "± %", "scatter/±", "shape ±", "scatter/±", "tests"],
    )
    for row, mode in zip(merged.modes, merged.data.modes, strict=True):
        cov = mode.frequency_cov
        add_row(
            table,
            row.label,
            f"{mode.frequency_hz:.5g}",
            number(None if cov is None else 100.0 * cov, ".2g"),
            number(None if row.frequency is None else row.frequency.ratio, ".2f"),
            number(mode.shape_sd, ".2g"),
            number(None if row.shape is None else row.shape.ratio, ".2f"),
            str(len(row.labels)),
        )
    return table
