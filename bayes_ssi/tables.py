"""Results as tables for a terminal, at most 80 columns wide."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from bayes_ssi.calibration import Calibration
from bayes_ssi.comparison import Comparison, probability_text
from bayes_ssi.configuration import label_in
from bayes_ssi.data import ModalData
from bayes_ssi.inferred_pairing import InferredPairing, PairingShare
from bayes_ssi.posterior import Posterior
from bayes_ssi.search import AppendageSearch

__all__ = [
    "averaged_table",
    "calibration_modes_table",
    "calibration_table",
    "comparison_notes",
    "evidence_table",
    "modes_table",
    "pairing_notes",
    "parameter_table",
    "ranking_table",
    "region_notes",
    "search_notes",
    "search_table",
]

# Hypotheses of a search, and places, that a table lists.
HYPOTHESES_SHOWN = 8
# Characters of a mode's label that stay on one line.
LABEL_WIDTH = 16
# More parameters than this are rows instead of columns; as many minima fit beside them.
PARAMETERS_ACROSS = 6
MINIMA_ACROSS = 4


def ranking_table(comparison: Comparison, title: str = "") -> Table:
    """Model classes ranked by log evidence, the best first."""
    table = _table(title)
    table.add_column("model class", overflow="fold")
    table.add_column("log evidence", justify="right", no_wrap=True)
    table.add_column("ln B", justify="right", no_wrap=True)
    table.add_column("probability", justify="right", no_wrap=True)
    table.add_column("against it", no_wrap=True)
    for row in comparison.classes:
        name = f"{row.name} (!)" if row.failed_checks else row.name
        _add_row(
            table,
            name,
            f"{row.log_evidence:.3f} ± {row.error:.3f}",
            f"{row.log_bayes_factor:.2f}",
            row.probability_text,
            row.against,
        )
    return table


def search_table(found: AppendageSearch) -> Table:
    """Hypotheses of a search by probability, with medians and 90 % intervals of appendages.

    The mass ratio is that of the mass that vibrates to the mean floor mass.
    """
    table = _table(found.ranking.study.name)
    table.add_column("hypothesis", overflow="fold", min_width=18)
    table.add_column("ln evidence", justify="right", no_wrap=True)
    table.add_column("probability", justify="right", no_wrap=True)
    table.add_column("mass ratio", justify="right", no_wrap=True)
    table.add_column("Hz", justify="right", no_wrap=True)
    rows = found.ranking.comparison.classes
    for rank, row in enumerate(rows):
        if rank >= HYPOTHESES_SHOWN and found.places[row.name]:
            continue
        appendages = found.appendages(row.name)
        lines = " +\n".join(each.place.name for each in appendages) or row.name
        _add_row(
            table,
            f"{lines} (!)" if row.failed_checks else lines,
            f"{row.log_evidence:.2f}",
            row.probability_text,
            "\n".join(_interval(each.mass_ratio) for each in appendages) or "-",
            "\n".join(_interval(each.frequency_hz) for each in appendages) or "-",
        )
    return table


def averaged_table(found: AppendageSearch) -> Table:
    """The baseline's parameters averaged over all hypotheses, beside the naive fit."""
    table = _table("Parameters, averaged over the hypotheses, and as if no appendage existed")
    table.add_column("parameter", overflow="fold")
    for heading in ("mean", "sd", "5 %", "95 %", "naive mean", "naive sd"):
        table.add_column(heading, justify="right")
    for row in found.averaged_parameters:
        numbers = (
            row.mean, row.sd, row.quantile_05, row.quantile_95, row.naive_mean, row.naive_sd
        )  # fmt: skip
        _add_row(table, row.name, *(f"{number:.4g}" for number in numbers))
    return table


def search_notes(found: AppendageSearch) -> list[str]:
    """The answer of a search in words."""
    notes = [
        "Probability that there is an appendage: "
        f"{probability_text(found.probability_of_any)}. By place:"
    ]
    by_probability = sorted(found.place_probabilities.items(), key=lambda item: -item[1])
    notes += [
        f"  {place.name}: {probability_text(probability)}"
        for place, probability in by_probability[:HYPOTHESES_SHOWN]
    ]
    rows = found.ranking.comparison.classes
    hidden = sum(bool(found.places[row.name]) for row in rows[HYPOTHESES_SHOWN:])
    if hidden > 0:
        notes.append(f"{hidden} less probable hypotheses are in the saved result.")
    return notes


def _interval(numbers: tuple[float, float, float]) -> str:
    low, middle, high = numbers
    return f"{middle:.2g} ({low:.2g}-{high:.2g})"


def evidence_table(posteriors: Sequence[Posterior]) -> Table:
    """What each log evidence is made of, and the estimates that check it, in nats."""
    table = _table("Log evidence = fit - information gained, and its checks (nats)")
    table.add_column("model class", overflow="fold")
    for heading in ("fit", "information", "bridge", "tempered", "Laplace"):
        table.add_column(heading, justify="right", no_wrap=True)
    for posterior in posteriors:
        evidence = posterior.evidence
        _add_row(
            table,
            posterior.name,
            f"{evidence.mean_log_likelihood:.2f}",
            f"{round(evidence.information_gained, 2) + 0.0:.2f}",  # not -0.00
            f"{evidence.bridge.log_evidence:.3f}",
            f"{evidence.tempered.log_evidence:.1f}",
            f"{evidence.laplace:.2f}",
        )
    return table


def comparison_notes(comparison: Comparison) -> list[str]:
    """What must be said beside a ranking: scale, classes not told apart, failed checks."""
    notes = [f"Words for Bayes factors: {comparison.scale}."]
    alike = comparison.not_distinguishable
    if alike:
        notes.append(
            f"The data do not tell {' or '.join(map(repr, alike))} from {comparison.best.name!r}."
        )
    if comparison.failed_checks:
        notes.append("Checks that failed; do not trust the ranking before they are understood:")
        notes.extend(f"  (!) {check}" for check in comparison.failed_checks)
    return notes


def parameter_table(posterior: Posterior) -> Table:
    """Posterior mean, standard deviation and 90 % interval of every parameter.

    The last column is the posterior's spread as a share of the prior's: 1 where the data say
    nothing.
    """
    table = _table(f"Parameters of {posterior.name!r}")
    table.add_column("parameter", overflow="fold")
    for heading in ("mean", "sd", "5 %", "median", "95 %", "of prior"):
        table.add_column(heading, justify="right")
    for row in posterior.summary:
        numbers = (row.mean, row.sd, row.quantile_05, row.median, row.quantile_95)
        cells = [f"{number:.4g}" for number in numbers]
        _add_row(table, row.name, *cells, f"{row.relative_spread:.2f}")
    return table


def pairing_notes(posterior: Posterior) -> list[str]:
    """Which identified mode is which model mode, where that was inferred."""
    notes = []
    for modes in posterior.configurations:
        if modes.inferred_pairing is not None:
            where = f" in configuration {modes.name!r}" if modes.name else ""
            notes.append(f"Modes of {posterior.name!r}{where}:")
            notes += _pairing_notes(modes.inferred_pairing)
    return notes


def _pairing_notes(inferred: InferredPairing) -> list[str]:
    notes = []
    for label, probabilities in inferred.of_modes.items():
        ways = sorted(probabilities.items(), key=lambda way: -way[1])
        told = ", ".join(
            f"{f'model mode {number}' if number else 'spurious'} with probability "
            f"{probability_text(probability)}"
            for number, probability in ways
            if probability >= 0.001
        )
        notes.append(f"  identified mode {label} is {told}")
    for share in inferred.pairings:
        if share.probability >= 0.001:
            notes.append(f"  {_pairing(share)}: probability {probability_text(share.probability)}")
    return notes


def _pairing(share: PairingShare) -> str:
    pairs = ", ".join(f"{label}-{number}" for label, number in share.pairing.items())
    return f"pairing {pairs}" if pairs else "every identified mode spurious"


def region_notes(posterior: Posterior) -> list[str]:
    """The separate regions of a posterior, where there are several: the fit is not unique."""
    if len(posterior.regions) < 2:
        return []
    notes = [f"The posterior of {posterior.name!r} has {len(posterior.regions)} separate regions:"]
    for region in posterior.regions:
        means = zip(posterior.parameter_names, region.mean, strict=True)
        values = ", ".join(f"{name} = {mean:.4g}" for name, mean in means)
        notes.append(f"  {100 * region.share:.1f} ± {100 * region.error:.1f} % around {values}")
    return notes


def calibration_table(calibration: Calibration) -> Table:
    """Every distinct minimum: parameter values, objective and distance.

    A model with many parameters has them below one another, and only the best minima.
    """
    if len(calibration.parameter_names) > PARAMETERS_ACROSS:
        return _tall_calibration_table(calibration)
    table = _table(f"Minima of {calibration.name!r}, λ = {calibration.shape_weight:g}")
    table.add_column("", justify="right")
    for name in calibration.parameter_names:
        table.add_column(Text(name), justify="right")
    table.add_column("f_ob (%)", justify="right")
    table.add_column("d (%)", justify="right")
    rows = [("before", calibration.before)]
    rows += [(str(i), fit) for i, fit in enumerate(calibration.minima, 1)]
    for label, fit in rows:
        values = (f"{value:.4g}" for value in fit.values)
        _add_row(table, label, *values, f"{100 * fit.objective:.3f}", f"{100 * fit.distance:.1f}")
    return table


def _tall_calibration_table(calibration: Calibration) -> Table:
    """A row a parameter, a column a minimum."""
    count = len(calibration.minima)
    title = f"Minima of {calibration.name!r}, λ = {calibration.shape_weight:g}"
    if count > MINIMA_ACROSS:
        title += f": the best {MINIMA_ACROSS} of {count}"
    table = _table(title)
    fits = (calibration.before, *calibration.minima[:MINIMA_ACROSS])
    longest = max(map(len, calibration.parameter_names))
    table.add_column("", overflow="fold", min_width=min(longest, LABEL_WIDTH))
    for heading in ("before", *range(1, len(fits))):
        table.add_column(str(heading), justify="right", no_wrap=True)
    for i, name in enumerate(calibration.parameter_names):
        _add_row(table, name, *(f"{fit.values[i]:.4g}" for fit in fits))
    _add_row(table, "f_ob (%)", *(f"{100 * fit.objective:.3f}" for fit in fits))
    _add_row(table, "d (%)", *(f"{100 * fit.distance:.1f}" for fit in fits))
    return table


def calibration_modes_table(calibration: Calibration) -> Table:
    """Frequencies and MAC before calibration and at the best minimum."""
    table = _table(f"Modes of {calibration.name!r}")
    labels = [label_in(mode.configuration, mode.label) for mode in calibration.best.modes]
    table.add_column("mode", justify="right", overflow="fold")
    for heading in (
        "model\nmode", "identified\nHz", "before\nHz", "after\nHz", "MAC\nbefore", "MAC\nafter"
    ):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    pairs = zip(calibration.before.modes, calibration.best.modes, strict=True)
    for label, (before, after) in zip(labels, pairs, strict=True):
        _add_row(
            table,
            label,
            str(before.model_mode),
            f"{before.identified_hz:.4g}",
            f"{before.model_hz:.4g}",
            f"{after.model_hz:.4g}",
            _number(before.mac, ".4f"),
            _number(after.mac, ".4f"),
        )
    return table


def modes_table(data: ModalData) -> Table:
    """The identified modes as they were read."""
    table = _table(data.source)
    for heading in ("mode", "frequency Hz", "c.o.v. %", "damping %", "shape at", "phases °"):
        table.add_column(heading, justify="right")
    for mode in data.modes:
        of_all = f"{mode.n_measured} of {len(data.sensors)}"
        _add_row(
            table,
            mode.label,
            f"{mode.frequency_hz:.5g}",
            _number(_percent(mode.frequency_cov), ".3g"),
            _number(_percent(mode.damping), ".3g"),
            of_all if mode.n_measured else "-",
            f"{mode.phase_scatter_deg:.1f}" if mode.n_measured else "-",
        )
    return table


def _percent(fraction: float | None) -> float:
    return math.nan if fraction is None else 100.0 * fraction


def _number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else format(value, form)


def _table(title: str) -> Table:
    return Table(
        title=Text(title) if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )


def _add_row(table: Table, *cells: str) -> None:
    """Add cells as they are: names may hold square brackets, which rich takes for markup."""
    table.add_row(*(Text(cell) for cell in cells))
