"""The answer of a comparison of two tests in sentences: did anything change, where, by how much?"""

from collections.abc import Iterator

from bayes_ssi.results.search_answer import unsampled
from bayes_ssi.results.wording import (
    likelihood_in_words,
    listed,
    probability_in_words,
    quantity,
    shortened,
)
from bayes_ssi.studies.changes.change_search import ChangeRecord, ChangeSummary, Quantiles
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
    shares = [
        (f"of {name.removeprefix('loss, ')} " if several else "") + _percent(share)
        for name, share in change.losses.items()
    ]
    return listed(shares)


def _percent(share: Quantiles) -> str:
    low, middle, high = (100.0 * each for each in share)
    return quantity(low, middle, high, "%")


def change_sentences(record: ChangeRecord) -> Iterator[str]:
    """Where it changed and by how much, what would have been seen, and what it rests on."""
    if record.probability_of_change >= RANKING.probable:
        yield from _places(record)
    yield from _visible(record)
    yield from _common(record)
    if record.shared is not None:
        yield (
            f"The tests share {_percent(record.shared)} of the "
            "errors of the model, which is wrong in the same way before and after: their "
            f"correlation is inferred, with the prior {record.settings.shared}."
        )
    yield from unsampled(record)


def _places(record: ChangeRecord) -> Iterator[str]:
    best = record.best_change
    if best is None:
        return
    items = []
    for change in (each for each in best.changes if not each.place.is_common):
        own = record.place(change.place.name)
        items.append(
            f"{change.place.name} (probability {probability_in_words(own.probability)}), which "
            f"lost {lost(own.change)}"
        )
    if record.probability_of_change >= 0.5:
        yield f"Most probably it is {listed(items)}: medians and 90 % intervals."
    else:
        yield f"If anything changed, it is most probably {listed(items)}."
    for change in best.changes:
        alike = record.place(change.place.name).alike
        if alike:
            yield (
                f"The data do not tell {change.place.name} from {listed(alike)}: the change may "
                f"be in {'any' if len(alike) > 1 else 'either'} of them."
            )
    others = [
        f"{each.place.name} ({probability_in_words(each.probability)})"
        for each in record.places_by_probability
        if each.probability >= RANKING.probable
        and not each.place.is_common
        and each.place not in [change.place for change in best.changes]
    ]
    if others:
        yield f"The other places that may have changed are {shortened(others)}."


def _common(record: ChangeRecord) -> Iterator[str]:
    """What a factor in common did, or that none was considered."""
    common = [each for each in record.places if each.place.is_common]
    for each in common:
        yield (
            "That all places lost a share in common, which counts as no change, has the "
            f"probability {probability_in_words(each.probability)}; the share is then "
            f"{lost(each.change)}."
        )
    if not common and record.probability_of_change >= 0.5:
        yield (
            "That all places lost a share in common, as by temperature or moisture, was not "
            "considered, and would be taken for a change; ask with --common."
        )


def _visible(record: ChangeRecord) -> Iterator[str]:
    """The smallest losses that the tests would have shown."""
    if not record.has_visible:
        return
    places = [each for each in record.places if each.is_observed and not each.place.is_common]
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
