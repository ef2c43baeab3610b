"""Calibrations: every minimum, and the modes before and after."""

import math
from collections.abc import Mapping, Sequence

from rich.table import Table

from bayes_ssi.inference.calibration.calibration import Calibration
from bayes_ssi.inference.calibration.modal_sensitivities import ModalSensitivities
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.report.tables.layout import MOST_COLUMNS, MOST_COMPONENTS, digits, new_table, number


def calibration_table(calibration: Calibration, same: Sequence[str] = ()) -> Table:
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
    classes = ", ".join(map(repr, (calibration.name, *same)))
    weight = f", λ = {calibration.shape_weight:g}" * calibration.has_shapes
    title = f"{what} of {classes}{weight}"
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


def determination_tables(calibration: Calibration) -> list[Table]:
    """What the data determine: each parameter, combinations, and changes that they do not notice.

    Empty where each parameter is determined, and the prior has no part in it.
    """
    found = calibration.determination
    if not found.undetermined and not calibration.with_prior:
        return []
    source = "data and prior" if calibration.with_prior else "the data alone"
    names = calibration.parameter_names
    rows = [
        (name, f"{value:.4g}", "not determined" if math.isinf(error) else f"{error:.2g}")
        for name, value, error in zip(
            names, calibration.best.values, found.standard_errors, strict=True
        )
    ]
    title = f"Parameters one by one, from {source}"
    tables: list[Table] = [new_table(title, [""], ["value", "standard error"], rows)]
    symbols = {
        name: f"ln {name}" if positive else name
        for name, positive in zip(names, found.positive, strict=True)
    }
    if found.determined:
        sums = [
            (_signed(each.components, symbols), f"{each.standard_error:.2g}")
            for each in found.determined
        ]
        tables.append(new_table("Determined in combination", ["sum"], ["standard error"], sums))
    if found.undetermined:
        title = "Not determined: changes that the data notice less than the prior, or not at all"
        changes = [
            (
                _change(each.components, symbols),
                "infinite" if math.isinf(each.standard_error) else f"{each.standard_error:.2g}",
            )
            for each in found.undetermined
        ]
        tables.append(new_table(title, ["change"], ["standard error\nover prior sd"], changes))
    return tables


def _signed(components: Mapping[str, float], symbols: Mapping[str, str]) -> str:
    """A sum in the notation of algebra, its largest terms first: ``ln k3 - 0.98 ln k4``."""
    text = ""
    largest, rest = _largest(components)
    for name, component in largest:
        size = f"{abs(component):.2g}"
        sign = "-" if component < 0 else "+"
        text += f" {sign} " + (symbols[name] if size == "1" else f"{size} {symbols[name]}")
    return text.removeprefix(" + ") + (" + …" if rest else "")


def _change(components: Mapping[str, float], symbols: Mapping[str, str]) -> str:
    """A change in parameters, in per cent of those that are positive: ``k3 +1 %, k4 -0.98 %``."""
    largest, rest = _largest(components)
    text = ", ".join(
        f"{name} {component:+.2g} %" if symbols[name] != name else f"{name} {component / 100:+.2g}"
        for name, component in largest
    )
    return text + (", …" if rest else "")


def _largest(components: Mapping[str, float]) -> tuple[list[tuple[str, float]], bool]:
    """The components that are shown, the largest first, and whether there are others."""
    # Below half a hundredth, they are zero to the digits shown.
    seen = [(name, component) for name, component in components.items() if abs(component) >= 5e-3]
    seen.sort(key=lambda each: -abs(each[1]))
    return seen[:MOST_COMPONENTS], len(seen) > MOST_COMPONENTS


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
