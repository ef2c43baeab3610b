"""Model classes ranked, their evidences and parameters, and what must be said of them."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from bayes_ssi.identification.inferred_pairing import InferredPairing, PairingShare
from bayes_ssi.posterior.posterior import Posterior, check_names
from bayes_ssi.ranking.averages import AveragedParameter
from bayes_ssi.ranking.comparison import Comparison, probability_text
from bayes_ssi.tables.layout import add_row, new_table

__all__ = [
    "averages_table",
    "comparison_notes",
    "evidence_table",
    "pairing_notes",
    "parameter_table",
    "ranking_table",
    "region_notes",
]


def ranking_table(comparison: Comparison, title: str = "") -> Table:
    """Model classes ranked by log evidence, the best first."""
    table = new_table(title)
    table.add_column("model class", overflow="fold")
    table.add_column("log evidence", justify="right", no_wrap=True)
    table.add_column("ln B", justify="right", no_wrap=True)
    table.add_column("probability", justify="right", no_wrap=True)
    table.add_column("against it", no_wrap=True)
    for row in comparison.classes:
        name = f"{row.name} (!)" if row.failed_checks else row.name
        add_row(
            table,
            name,
            f"{row.log_evidence:.3f} ± {row.error:.3f}",
            f"{row.log_bayes_factor:.2f}",
            row.probability_text,
            row.against,
        )
    return table


def evidence_table(posteriors: Sequence[Posterior]) -> Table:
    """What each log evidence is made of, and the estimates that check it, in nats."""
    table = new_table("Log evidence = fit - information gained, and its checks (nats)")
    table.add_column("model class", overflow="fold")
    methods = check_names(posteriors)
    for heading in ("fit", "information", *methods):
        table.add_column(heading.replace(" ", "\n"), justify="right", no_wrap=True)
    for posterior in posteriors:
        evidence = posterior.evidence
        add_row(
            table,
            posterior.name,
            f"{evidence.mean_log_likelihood:.2f}",
            f"{round(evidence.information_gained, 2) + 0.0:.2f}",  # not -0.00
            *("" if check is None else str(check) for check in map(evidence.check, methods)),
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
    table = new_table(f"Parameters of {posterior.name!r}")
    table.add_column("parameter", overflow="fold")
    for heading in ("mean", "sd", "5 %", "median", "95 %", "of\nprior"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in posterior.summary:
        numbers = (row.mean, row.sd, row.quantile_05, row.median, row.quantile_95)
        cells = [f"{number:.4g}" for number in numbers]
        add_row(table, row.name, *cells, f"{row.relative_spread:.2f}")
    return table


def averages_table(averaged: Sequence[AveragedParameter]) -> Table:
    """Parameters that several classes infer, averaged over these classes by their probability.

    StoredExtras each stands the probability of these classes together.
    """
    table = new_table("Parameters averaged over the model classes that infer them")
    table.add_column("parameter", overflow="fold")
    for heading in ("probability", "mean", "sd", "5 %", "95 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in averaged:
        numbers = (row.mean, row.sd, row.quantile_05, row.quantile_95)
        add_row(
            table,
            row.name,
            probability_text(row.probability),
            *(f"{number:.4g}" for number in numbers),
        )
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
