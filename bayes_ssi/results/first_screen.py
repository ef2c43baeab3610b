"""A result in words, as the command line prints it first."""

from __future__ import annotations

from pathlib import Path

from bayes_ssi.results.answer import answer
from bayes_ssi.results.load import StoredResult
from bayes_ssi.results.save import result_record
from bayes_ssi.studies.appendages.search_result import AppendageSearch
from bayes_ssi.studies.ranking.study import Ranking


def first_screen(result: StoredResult | Ranking | AppendageSearch) -> str:
    """Warnings, then the answer, a paragraph each."""
    words = answer(result if isinstance(result, StoredResult) else _as_if_stored(result))
    warnings = ["\n".join([f"(!) {text}", *items]) for text, items in words.warnings]
    return "\n\n".join([*warnings, *words.paragraphs])


def _as_if_stored(result: Ranking | AppendageSearch) -> StoredResult:
    ranking = result.ranking if isinstance(result, AppendageSearch) else result
    tests = {test.name: test.data for test in ranking.study.model_classes[0].configurations}
    record = result_record(ranking, {}, {}, "", "", accept_failed_checks=False)
    made = StoredResult(Path(), record, tests, ranking.posteriors, ranking.comparison)
    vars(made)["search"] = result.record if isinstance(result, AppendageSearch) else None
    return made
