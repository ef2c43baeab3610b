"""Modes as they were read, by every method, merged, and before and after calibrations."""

import math
from collections.abc import Mapping, Sequence

from rich.table import Table

from bayes_ssi.inference.calibration.calibration import Calibration, ModalSensitivities
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.measurements.modes.identification_summary import EstimatedMode
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.merging import MergedModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.report.tables.layout import MOST_COLUMNS, add_row, digits, new_table, number, percent
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


def estimates_table(modes: ModalData, method: str, estimated: Sequence[EstimatedMode]) -> Table:
    rows = [
        (mode.label, *_estimates(mode), number(each.mpc, ".3f"), number(each.mean_phase_deg, ".1f"))
        for mode, each in zip(modes.modes, estimated, strict=True)
    ]
    return new_table(f"Modes by {method}", ["mode"], (*ESTIMATES, "MPC", "phase °"), rows)


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
            mode.label,
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


def calibration_table(calibration: Calibration) -> Table:
    """Every distinct minimum: parameter values, objective and distance.

    A few parameters are columns; many are rows, and the best minima are columns.
    """
    names = (*calibration.parameter_names, "f_ob (%)", "d (%)")
    fits = {"before": calibration.before}
    fits |= {str(i): fit for i, fit in enumerate(calibration.minima, 1)}
    cells = [
        (label, *digits(*fit.values), f"{100 * fit.objective:.3f}", f"{100 * fit.distance:.1f}")
        for label, fit in fits.items()
    ]
    what = "Minima with the prior's pull" if calibration.with_prior else "Minima"
    weight = f", λ = {calibration.shape_weight:g}" * calibration.has_shapes
    title = f"{what} of {calibration.name!r}{weight}"
    if len(names) <= MOST_COLUMNS:
        return new_table(title, [""], names, cells)
    shown = cells[:MOST_COLUMNS]
    if len(shown) < len(cells):
        title += f": the best {len(shown) - 1} of {len(calibration.minima)}"
    headings, *rows = zip(("", *names), *shown, strict=True)
    return new_table(title, headings[:1], headings[1:], rows)


def calibration_modes_table(calibration: Calibration) -> Table:
    headings = ["model mode", "identified Hz", "before Hz", "after Hz"]
    macs = ["MAC before", "MAC after"] if calibration.has_shapes else []
    rows = [
        (
            label_in(after.configuration, after.label),
            str(before.model_mode),
            *digits(before.identified_hz, before.model_hz, after.model_hz),
            *(number(fit.mac, ".4f") for fit in (before, after) if macs),
        )
        for before, after in zip(calibration.before.modes, calibration.best.modes, strict=True)
    ]
    return new_table(f"Modes of {calibration.name!r}", ["mode"], [*headings, *macs], rows)


def standard_errors_table(calibration: Calibration) -> Table | None:
    """Each parameter by itself; None where the data determine all, and the prior has no part."""
    if calibration.determines_all and not calibration.with_prior:
        return None
    source = "data and prior" if calibration.with_prior else "the data alone"
    of_each = zip(calibration.best.values, calibration.standard_errors, strict=True)
    rows = [
        (name, f"{value:.4g}", "not determined" if math.isinf(error) else f"{error:.2g}")
        for name, (value, error) in zip(calibration.parameter_names, of_each, strict=True)
    ]
    title = f"Parameters one by one, from {source}"
    return new_table(title, [""], ["value", "standard error"], rows)


def sensitivities_table(sensitivities: ModalSensitivities) -> Table:
    """Of every paired mode to every parameter: of its frequency, and of its shape in brackets."""
    seen = bool((sensitivities.of_shapes >= 0.005).any())  # not zero to the digits shown
    of = "frequency" + " (of unit shape)" * seen
    title = f"Sensitivities of {sensitivities.name!r}: percent of {of} per percent"
    rows = []
    # Zero has no sign.
    of_frequencies = (sensitivities.of_frequencies.round(2) + 0.0).tolist()
    of_shapes = sensitivities.of_shapes.tolist()
    for mode, *of_one in zip(sensitivities.modes, of_frequencies, of_shapes, strict=True):
        pairs = zip(*of_one, strict=True)
        rows.append([mode, *(f"{f:+.2f}" + f" ({s:.2f})" * seen for f, s in pairs)])
    return new_table(title, ["mode"], sensitivities.parameters, rows)
