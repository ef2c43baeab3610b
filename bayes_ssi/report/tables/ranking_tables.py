"""Ranked model classes: evidences, parameters, and what other settings change."""

from collections.abc import Iterator, Sequence

from rich.table import Table

from bayes_ssi.foundations.displayed import columns
from bayes_ssi.inference.criticism.adequacy import misfit_text
from bayes_ssi.inference.criticism.misfit import INADEQUATE_SDS
from bayes_ssi.inference.likelihood.pairings import InferredPairing
from bayes_ssi.inference.posterior.posterior import Posterior, check_names
from bayes_ssi.report.tables.layout import digits, interval, marked, new_table, number
from bayes_ssi.results.stored_result import StoredResult
from bayes_ssi.studies.ranking.changed_settings import ChangedClass, WhatIf
from bayes_ssi.studies.ranking.comparison import (
    SCALE_NAME,
    Comparison,
    RankedClass,
    probability_text,
)
from bayes_ssi.studies.ranking.study import AveragedParameter, averaged_parameters

# A heading and the items of the list below it.
Note = tuple[str, list[str]]


def ranked(result: StoredResult) -> Iterator[Table]:
    """The model classes of a ranking."""
    yield ranking_table(result.comparison, result.record.study)


def further_tables(result: StoredResult) -> Iterator[Table]:
    """The other tables of a ranking, in the order in which they are read."""
    yield evidence_table(result.ranked_posteriors)
    yield parameter_table(result.ranked_posteriors[0])
    if averages := averaged_parameters(result.posteriors, result.comparison):
        yield averages_table(averages)


def ranking_table(comparison: Comparison, title: str = "") -> Table:
    """Model classes by probability; prior probabilities have a column unless they are equal."""
    priors_differ = not comparison.has_equal_priors
    numbers = ["log evidence", "ln B", *["prior"] * priors_differ, "probability"]
    rows = [
        (
            marked(row.name, row.failed_checks),
            f"{row.log_evidence:.3f} ± {row.error:.3f}",
            f"{row.log_bayes_factor:.2f}",
            *[probability_text(row.prior_probability)] * priors_differ,
            # Alone, a class has no probability.
            row.probability_text if len(comparison.classes) > 1 else "-",
            explains(row),
        )
        for row in comparison.classes
    ]
    return new_table(title, ["model class"], numbers, rows, last=["explains the data"])


def explains(row: RankedClass) -> str:
    """Whether a class explains the data, and its misfit; a dash where that is not known."""
    if row.misfit_sds is None:
        return "-"
    explained = row.misfit_sds <= INADEQUATE_SDS and not row.misfit and not row.is_rough
    return f"{'yes' if explained else 'no'} ({misfit_text(row.misfit_sds)})"


def evidence_table(posteriors: Sequence[Posterior]) -> Table:
    """What each log evidence is made of, and the estimates that check it, in nats."""
    methods = check_names(posteriors)
    rows = [
        (
            posterior.name,
            f"{posterior.evidence.mean_log_likelihood:.2f}",
            number(posterior.evidence.information_gained, ".2f"),
            *(str(posterior.evidence.check(method) or "") for method in methods),
        )
        for posterior in posteriors
    ]
    title = "Log evidence = fit - information gained, and its checks (nats)"
    return new_table(title, ["model class"], ["fit", "information", *methods], rows)


def comparison_notes(comparison: Comparison, with_scales: bool = True) -> list[str]:
    """Notes on the table of a ranking: the scales of its columns, and the mark of failed checks."""
    scales = [
        "Explains the data: how far they are from what the class itself expects, in standard "
        "deviations of a normal variable; one right class in a hundred is beyond "
        f"{INADEQUATE_SDS:.1f} sd.",
        f"Words for evidence: scale of {SCALE_NAME}.",
    ]
    notes = scales if with_scales else []
    notes += [comparison.unseen] if comparison.unseen else []
    if any(row.failed_checks for row in comparison.classes):
        notes.append("(!): a check failed, as said above.")
    if comparison.remarks:
        notes.append("What does not change the answer:")
        notes.extend(f"  {remark}" for remark in comparison.remarks)
    return notes


def parameter_table(posterior: Posterior) -> Table:
    """Posterior mean, standard deviation and 90 % interval of every parameter."""
    headings = ["mean", "sd", "5 %", "median", "95 %", "post./ prior sd"]
    fields = ("mean", "sd", "quantile_05", "median", "quantile_95")
    rows = [
        [row.name, *digits(*columns(row, fields).values()), f"{row.relative_spread:.2f}"]
        for row in posterior.summary
    ]
    return new_table(f"Parameters of {posterior.name!r}", ["parameter"], headings, rows)


def averages_table(averaged: Sequence[AveragedParameter]) -> Table:
    """Parameters that several classes infer, averaged over these, with their total probability."""
    fields = ("mean", "sd", "quantile_05", "quantile_95")
    rows = [
        [row.name, probability_text(row.probability), *digits(*columns(row, fields).values())]
        for row in averaged
    ]
    title = "Parameters averaged over the model classes that infer them"
    return new_table(title, ["parameter"], ["probability", "mean", "sd", "5 %", "95 %"], rows)


def pairing_notes(posterior: Posterior) -> list[Note]:
    """Which identified mode is which model mode, where that was inferred."""
    notes = []
    for modes in posterior.configurations:
        if modes.inferred_pairing is not None:
            where = f" in configuration {modes.name!r}" if modes.name else ""
            items = list(_mode_probabilities(modes.inferred_pairing))
            notes.append((f"Modes of {posterior.name!r}{where}:", items))
    return notes


def _mode_probabilities(inferred: InferredPairing) -> Iterator[str]:
    """The probabilities of modes, then of whole pairings, leaving out those that round to 0.000."""
    for label, probabilities in inferred.of_modes.items():
        by_probability = sorted(probabilities.items(), key=lambda item: -item[1])
        alternatives = ", ".join(
            f"{f'model mode {number}' if number else 'spurious'} with probability "
            f"{probability_text(probability)}"
            for number, probability in by_probability
            if probability >= 0.001
        )
        yield f"identified mode {label} is {alternatives}"
    for share in inferred.pairings:
        if share.probability >= 0.001:
            pairs = ", ".join(f"{label}-{number}" for label, number in share.pairing.items())
            pairing = f"pairing {pairs}" if pairs else "every identified mode spurious"
            yield f"{pairing}: probability {probability_text(share.probability)}"


def region_notes(posterior: Posterior) -> list[Note]:
    """The separate regions of a posterior, where there are several and the fit is not unique."""
    if len(posterior.regions) < 2:
        return []
    items = []
    for region in posterior.regions:
        means = zip(posterior.parameter_names, region.mean, strict=True)
        values = ", ".join(f"{name} = {mean:.4g}" for name, mean in means)
        items.append(f"{100 * region.share:.1f} ± {100 * region.error:.1f} % around {values}")
    return [(f"The posterior of {posterior.name!r} has {len(items)} separate regions:", items)]


def what_if_table(answer: WhatIf) -> Table:
    """Log evidences and probabilities before and after, and how well the draws cover the change."""
    failed = {row.name for row in answer.classes if row.problem}
    if answer.best_after and answer.misfit:
        failed.add(answer.best_after.name)
    rows = []
    for row in answer.classes:
        after = row.log_evidence_after
        rows.append((
            marked(row.name, row.name in failed),
            f"{row.log_evidence_before.log_evidence:.2f}",
            "-" if after is None else f"{after.log_evidence:.2f} ± {after.error:.2f}",
            probability_text(row.probability_before),
            "-" if row.probability_after is None else probability_text(row.probability_after),
            misfit_text(None if row.misfit_before is None else row.misfit_before.sds),
            misfit_text(None if row.misfit_after is None else row.misfit_after.sds),
            number(row.pareto_k, ".2f"),
        ))  # fmt: skip
    numbers = ["log evidence", "after", "probability", "after", "misfit", "after", "Pareto k"]
    return new_table("Before and after", ["model class"], numbers, rows)


def changed_parameters_table(row: ChangedClass) -> Table:
    """Means and 90 % intervals of a class's parameters, and the shift in standard deviations."""
    rows = []
    for parameter in row.parameters:
        old, new = parameter.before, parameter.after
        rows.append((
            old.name,
            f"{old.mean:.4g}",
            number(new and new.mean),
            interval(old.quantile_05, old.quantile_95, ".3g"),
            "-" if new is None else interval(new.quantile_05, new.quantile_95, ".3g"),
            "-" if new is None or not old.sd else f"{(new.mean - old.mean) / old.sd:+.2f}",
        ))  # fmt: skip
    numbers = ["mean", "after", "5 to 95 %", "after", "shift/sd"]
    title = f"Parameters of {row.name!r}: mean, and 5 to 95 %"
    return new_table(title, ["parameter"], numbers, rows)


def what_if_notes(answer: WhatIf, again: str) -> Sequence[str]:
    """What the change does to the ranking, and what the draws do not say."""
    notes = [f"Changed: {phrase}." for phrase in answer.changes]
    before, after = answer.best_before, answer.best_after
    if after is None:
        notes.append("Probabilities after the change are not known, because of these classes:")
        notes += [f"  (!) {problem}" for problem in answer.problems]
        notes.append(again)
    elif after is before:
        notes.append(f"{before.name!r} is the most probable class before and after.")
    else:
        notes.append(f"The most probable class is {after.name!r}; before, it was {before.name!r}.")
    if answer.remarks:
        notes.append("The draws of these classes do not say, which are too improbable to matter:")
        notes += [f"  {remark}" for remark in answer.remarks]
    return notes
