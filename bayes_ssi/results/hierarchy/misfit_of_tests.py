"""Tests that the model class does not explain: what they say of a population means nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bayes_ssi.inference.criticism.adequacy import LIMIT, Adequacy
from bayes_ssi.inference.criticism.misfit_in_words import (
    inadequacy_in_words,
    misfit_text,
    misfits_in_words,
)
from bayes_ssi.results.hierarchy.single_tests import SingleTest


def failed_tests(class_name: str, tests: Sequence[SingleTest]) -> Iterator[str]:
    """Tests that the class does not explain, a sentence each."""
    for test in tests:
        fit = test.adequacy
        if fit is not None and _fails(fit, len(tests)):
            yield f"test {test.name!r}, {class_name!r}: {inadequacy_in_words(fit)}"


def unusual_tests(class_name: str, tests: Sequence[SingleTest]) -> Iterator[str]:
    """Tests that would fail by themselves, but not among so many, a sentence each."""
    for test in tests:
        fit = test.adequacy
        if fit is not None and fit.overall.is_small and not _fails(fit, len(tests)):
            how_far = misfit_text(fit.overall.sds)
            yield (
                f"test {test.name!r}, {class_name!r}: the data are as unusual as in one right test "
                f"of {1.0 / LIMIT:.0f}, {how_far}: {'; '.join(misfits_in_words(fit))}"
            )


def _fails(fit: Adequacy, n_tests: int) -> bool:
    # Of many tests that a right class explains, the most unusual one is far out (Bonferroni).
    return n_tests * fit.overall.p_value < LIMIT or bool(fit.hints)
