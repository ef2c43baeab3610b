"""The answer of a comparison of two tests in sentences: did anything change, where, by how much?"""

from collections.abc import Iterator, Sequence

from bayes_ssi.foundations.summaries import Quantiles
from bayes_ssi.results.search_answer import unsampled
from bayes_ssi.results.wording import (
    likelihood_in_words,
    listed,
    probability_in_words,
    quantity,
    shortened,
)
from bayes_ssi.studies.changes.change_search import (
    ChangeRecord,
    ChangesRecord,
    ChangeSummary,
    PlaceOfChange,
)
from bayes_ssi.studies.ranking.comparison import RANKING


def change_verdict(record: ChangeRecord) -> str:
    """Whether anything changed, and how sure that is."""
    probability = record.probability_of_change
    before = sum(each.prior_probability for each in record.hypotheses if each.claims_change)
    has_changed = probability >= 0.5
    sure = likelihood_in_words(probability if has_changed else 1.0 - probability)
    tests = f"between {listed(map(repr, record.before))} and {listed(map(repr, record.after))}"
    return (
        f"That {'something' if has_changed else 'nothing'} changed {tests} is {sure}: the "
        f"probability of a change is {probability_in_words(probability)} among the "
        f"{len(record.hypotheses)} hypotheses considered, and was {probability_in_words(before)} "
        "before the tests."
    )


def lost(change: ChangeSummary) -> str:
    """What one place lost: medians and 90 % intervals."""
    several = len(change.losses) > 1
    return listed(
        (f"of {name.removeprefix('loss, ')} " if several else "") + _percent(share)
        for name, share in change.losses.items()
    )


def _percent(share: Quantiles) -> str:
    low, middle, high = (100.0 * each for each in share)
    return quantity(low, middle, high, "%")


def change_sentences(record: ChangeRecord) -> Iterator[str]:
    """Where it changed and by how much, what would have been seen, and what it rests on."""
    own = [each for each in record.places if not each.place.is_common]
    if record.best_change is not None and record.probability_of_change >= RANKING.probable:
        yield from _places(record, record.best_change)
    if record.has_visible:
        yield from _visible([each for each in own if each.is_observed])
    for common in (each for each in record.places if each.place.is_common):
        yield (
            "That all places lost a share in common, which counts as no change, has the "
            f"probability {probability_in_words(common.probability)}; the share is then "
            f"{lost(common.change)}."
        )
    if len(own) == len(record.places) and record.probability_of_change >= 0.5:
        yield (
            "That all places lost a share in common, as by temperature or moisture, was not "
            "considered, and would be taken for a change; ask with --common."
        )
    if record.shared is not None:
        yield (
            f"The tests share {_percent(record.shared)} of the "
            "errors of the model, which is wrong in the same way before and after: their "
            f"correlation is inferred, with the prior {record.settings.shared}."
        )
    yield from unsampled(record)


def _places(record: ChangeRecord, best: ChangesRecord) -> Iterator[str]:
    changed = [record.place(change.place.name) for change in best.changes]
    items = [
        f"{each.place.name} (probability {probability_in_words(each.probability)}), which lost "
        f"{lost(each.change)}"
        for each in changed
        if not each.place.is_common
    ]
    if record.probability_of_change >= 0.5:
        yield f"Most probably it is {listed(items)}: medians and 90 % intervals."
    else:
        yield f"If anything changed, it is most probably {listed(items)}."
    for each in changed:
        if each.alike:
            yield (
                f"The data do not tell {each.place.name} from {listed(each.alike)}: the change may "
                f"be in {'any' if len(each.alike) > 1 else 'either'} of them."
            )
    others = [
        f"{each.place.name} ({probability_in_words(each.probability)})"
        for each in record.places_by_probability
        if each.probability >= RANKING.probable and not each.place.is_common and each not in changed
    ]
    if others:
        yield f"The other places that may have changed are {shortened(others)}."


def _visible(places: Sequence[PlaceOfChange]) -> Iterator[str]:
    """The smallest losses that the tests would have shown."""
    shown = [
        f"{100.0 * each.smallest_visible:.2g} % in {each.place.name}"
        for each in places
        if each.smallest_visible is not None
    ]
    if shown:
        yield (
            "Had nothing else changed, the smallest losses that these tests would have shown with "
            f"probability 0.9 are {shortened(shown)}; smaller ones may be there unseen."
        )
    if hidden := [each.place.name for each in places if each.smallest_visible is None]:
        yield f"No loss, however large, would have been shown so surely in {shortened(hidden)}."
