"""What commands that sample show of a saved result: misfit and notes, and their record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bayes_ssi.commands.terminal import say_in_paragraphs

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_ssi.results.stored_result import StoredResult


def json_record(result: StoredResult, records: Mapping[str, Any]) -> dict[str, Any]:
    """The record that ``--json`` prints: ranking, numbers of posteriors, path of the result."""
    from bayes_ssi.results.answer import answer

    return {
        "directory": str(result.directory),
        "study": result.record.study,
        "answer": answer(result).paragraphs,
        **asdict(result.comparison),
        "failed_checks": list(result.comparison.failed_checks),
        "not_distinguishable": list(result.comparison.not_distinguishable),
        "parameters": {
            posterior.name: [asdict(row) for row in posterior.summary]
            for posterior in result.ranked_posteriors
        },
        "adequacy": {
            posterior.name: posterior.adequacy and asdict(posterior.adequacy)
            for posterior in result.ranked_posteriors
        },
        "pairings": {
            posterior.name: {modes.name: dict(modes.pairing) for modes in posterior.configurations}
            for posterior in result.ranked_posteriors
        },
        **{Path(file).stem: record for file, record in records.items()},
    }


def say_misfit(where: Console, result: StoredResult) -> None:
    """Say ahead of everything else that the best class misses an appendage, or the data."""
    for text in (result.comparison.unmodelled_appendage, result.comparison.misfit):
        if text:
            say_in_paragraphs(where, f"(!) {text[0].upper()}{text[1:]}.")


def notes_of(result: StoredResult, best_only: bool = False) -> list[str]:
    """Notes below the tables of a ranking."""
    from bayes_ssi.report.tables.ranking_tables import comparison_notes, pairing_notes, region_notes

    notes = comparison_notes(result.comparison, with_scales=result.search is None)
    for posterior in result.ranked_posteriors[: 1 if best_only else None]:
        for heading, items in (*pairing_notes(posterior), *region_notes(posterior)):
            notes += [heading, *(f"  {item}" for item in items)]
        notes += [f"{posterior.name!r}: {remark}." for remark in posterior.remarks]
    return notes
