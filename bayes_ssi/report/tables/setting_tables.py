"""A ranking before and after a change of settings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.table import Table

from bayes_ssi.inference.criticism.misfit_in_words import misfit_text
from bayes_ssi.report.tables.layout import add_row, interval, new_table
from bayes_ssi.studies.ranking.changed_settings import ChangedClass, WhatIf
from bayes_ssi.studies.ranking.comparison import probability_text
from bayes_ssi.studies.ranking.sensitivity import Sensitivity


def sensitivity_table(sensitivity: Sensitivity) -> Table:
    """Setting by setting, which class ranks first, and its lead in nats."""
    first = sensitivity.rows[0].best
    table = new_table(
        "Sensitivity to settings",
        ["setting", "most probable"],
        ["probability", "lead (nats)", f"probability of {first}"],
    )
    for row in sensitivity.rows:
        add_row(
            table,
            f"{row.name} (!)" if row.failed_checks else row.name,
            row.best,
            probability_text(row.probabilities[row.best]),
            "-" if math.isinf(row.lead) else f"{row.lead:.2f}",
            probability_text(row.probabilities[first]),
        )
    return table


def sensitivity_notes(sensitivity: Sensitivity) -> list[str]:
    """Whether the same class always ranks first, and which checks of resampled classes failed."""
    first = sensitivity.rows[0].best
    if sensitivity.turning:
        others = "; ".join(f"{row.best!r} does with {row.name}" for row in sensitivity.turning)
        notes = [f"{first!r} does not rank first under every setting: {others}."]
    else:
        notes = [f"{first!r} ranks first under every setting."]
    for row in sensitivity.rows:
        notes += [f"  (!) {row.name}: {check}" for check in row.failed_checks]
    return notes


def what_if_table(answer: WhatIf) -> Table:
    """Log evidences and probabilities before and after, and how well the draws cover the change."""
    table = new_table(
        "Before and after",
        ["model class"],
        ["log evidence", "after", "probability", "after", "misfit", "after", "Pareto k"],
    )
    failed = {row.name for row in answer.classes if row.problem}
    if answer.best_after and answer.misfit:
        failed.add(answer.best_after.name)
    for row in answer.classes:
        after = row.log_evidence_after
        add_row(
            table,
            f"{row.name} (!)" if row.name in failed else row.name,
            f"{row.log_evidence_before.log_evidence:.2f}",
            "-" if after is None else f"{after.log_evidence:.2f} ± {after.error:.2f}",
            probability_text(row.probability_before),
            "-" if row.probability_after is None else probability_text(row.probability_after),
            *(
                misfit_text(None if each is None else each.sds)
                for each in (row.misfit_before, row.misfit_after)
            ),
            f"{row.pareto_k:.2f}" if math.isfinite(row.pareto_k) else "-",
        )
    return table


def changed_parameters_table(row: ChangedClass) -> Table:
    """Means and 90 % intervals of a class's parameters, and the shift in standard deviations."""
    table = new_table(
        f"Parameters of {row.name!r}: mean, and 5 to 95 %",
        ["parameter"],
        ["mean", "after", "5 to 95 %", "after", "shift/sd"],
    )
    for each in row.parameters:
        old, new = each.before, each.after
        add_row(
            table,
            old.name,
            f"{old.mean:.4g}",
            "-" if new is None else f"{new.mean:.4g}",
            interval(old.quantile_05, old.quantile_95, ".3g"),
            "-" if new is None else interval(new.quantile_05, new.quantile_95, ".3g"),
            "-" if new is None or not old.sd else f"{(new.mean - old.mean) / old.sd:+.2f}",
        )
    return table


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
