"""The answer of a search in sentences: what hides or changed, where, how much of it, how surely."""

from collections.abc import Iterator

from bayes_ssi.foundations.summaries import Quantiles
from bayes_ssi.results.wording import (
    MOST_LISTED,
    NEGLIGIBLE_UNSAMPLED,
    likelihood_in_words,
    listed,
    probability_in_words,
    quantity,
    shortened,
)
from bayes_ssi.studies.appendages.appendage_search import MatchedAppendage, SearchRecord
from bayes_ssi.studies.appendages.candidates import InfillPlace, PendulumPlace
from bayes_ssi.studies.changes.change_search import ChangeRecord
from bayes_ssi.studies.changes.changes_family import moved_alike
from bayes_ssi.studies.changes.kinds_of_change import ChangePlace, ElementPlace, SomethingElse
from bayes_ssi.studies.ranking.comparison import PROBABLE, Comparison
from bayes_ssi.studies.search.findings import FamilyRecord, Finding

SAID_OF_A_MOTION = 0.1  # least probability of one; tables have less probable ones
ORDINALS = ("first", "second", "third", *(f"{n}th" for n in range(4, 21)))


def hypothesis_in_words(search: FamilyRecord, name: str) -> str:
    places = [each.place.description for each in search.hypothesis(name).features]
    return listed(places) if places else name


def search_verdict(record: FamilyRecord) -> str:
    before = sum(each.prior_probability for each in record.hypotheses if each.claimed)
    after = record.probability_of_any
    return (
        f"That {record.claim(after >= 0.5)} {likelihood_in_words(max(after, 1.0 - after))}: the "
        f"probability of {record.at_least_one} is {probability_in_words(after)} among the "
        f"{len(record.hypotheses)} hypotheses considered, and was {probability_in_words(before)} "
        f"before the test{record.plural}."
    )


def search_sentences(record: FamilyRecord, comparison: Comparison) -> Iterator[str]:
    """Where the features are, and how much of each; what else follows from the hypotheses."""
    if isinstance(record, SearchRecord):
        return _appendage_sentences(record, comparison)
    return _change_sentences(record) if isinstance(record, ChangeRecord) else iter(())


def further_sentences(record: FamilyRecord) -> Iterator[str]:
    """What a report and all tables say besides: what was tried, and what else follows from it."""
    if isinstance(record, SearchRecord):
        return _of_appendages_besides(record)
    return _of_changes_besides(record) if isinstance(record, ChangeRecord) else iter(())


def beaten_baselines(search: SearchRecord) -> tuple[str, ...]:
    """Baselines of a part of the answer that another class beats without any appendage."""
    best = search.best_without_appendages
    return tuple(
        f"{each.name!r}, with probability {probability_in_words(each.probability)}: without any "
        f"appendage, {best.name!r} beats it by {best.log_evidence - each.log_evidence:.1f} nats"
        for each in search.beaten
        if each.probability >= PROBABLE
    )


def _appendage_sentences(search: SearchRecord, comparison: Comparison) -> Iterator[str]:
    """Where the appendages are, how heavy and at what frequency; the main structure with them."""
    if search.is_more_likely:
        yield from _appendages(search)
    yield from _motions(search)
    yield from unsampled(search)
    best = search.best_with_features
    alike = [
        f"{hypothesis_in_words(search, name)} ({name!r}, probability "
        f"{probability_in_words(search.hypothesis(name).probability)})"
        for name in comparison.not_distinguishable
        if best is None or name != best.name
    ]
    if alike:
        yield f"The data do not distinguish {comparison.best.name!r} from {shortened(alike)}."
    if averages := search.averaged_parameters:
        averaged = "; ".join(
            f"{row.name} = {quantity(row.quantile_05, row.median, row.quantile_95)}, without "
            f"appendages {row.naive_mean:.3g}"
            for row in averages[:MOST_LISTED]
        )
        more = " The others are in the tables." if len(averages) > MOST_LISTED else ""
        yield (
            "The main structure, averaged over sampled hypotheses (medians and 90 % intervals): "
            f"{averaged}.{more}"
        )


def _of_appendages_besides(search: SearchRecord) -> Iterator[str]:
    """The place of an improbable appendage; what was tried, and on which baselines."""
    if not search.is_more_likely:
        yield from _appendages(search)
    if search.present_in is not None:
        tests = "tests" if len(search.present_in) > 1 else "test"
        yield f"Appendages were tried in the {tests} {listed(map(repr, search.present_in))} only."
    best = search.best_with_features
    kinds = {type(each.place) for each in (best.features if best else ())}
    if PendulumPlace in kinds and search.probability_of_any >= PROBABLE:
        yield (
            "A pendulum's frequency is that on a foot that may turn but not move: a chimney's, "
            "calculated on a rigid foot, is higher."
        )
    if not any(isinstance(each.place, InfillPlace) for each in search.places):
        yield "Infills were not tried: they join two places, and every candidate is one."
    tried = [each for each in search.baselines if each.prior_probability > 0.0]
    if len(tried) > 1:
        shown = [
            f"{each.name!r} ({probability_in_words(each.probability)})"
            for each in tried[:MOST_LISTED]
        ]
        yield f"The probabilities of the {len(tried)} baselines are: {listed(shown)}."


def unsampled(record: FamilyRecord) -> Iterator[str]:
    """How much of the answer is approximate, if that is not negligible."""
    if record.most_probability_unsampled > NEGLIGIBLE_UNSAMPLED:
        most = probability_in_words(record.most_probability_unsampled)
        yield (
            f"Hypotheses that were not sampled, whose evidences are approximate, may have up to "
            f"{most} of the probability together."
        )


def _appendages(search: SearchRecord) -> Iterator[str]:
    """What the data determine of each appendage, then where it is and how much of it vibrates."""
    several = len(search.matched) > 1
    for ordinal, each in zip(ORDINALS, search.matched, strict=False):
        whose = f"the {ordinal}" if several else "the appendage"
        at = [(each.probability, each.frequency_hz), *each.other_frequencies_hz]
        shown = [quantity(*hz, unit="Hz") for _, hz in at]
        if len(at) > 1:
            shown = [
                f"{one} (probability {probability_in_words(share)})"
                for one, (share, _) in zip(shown, at, strict=True)
            ]
        if_any = "" if search.is_more_likely else "if there is any, "
        words = f"{if_any}{whose} vibrates at {' or '.join(shown)}"
        if each.effective_mass is not None and each.effective_ratio is not None:
            words += (
                f", {'at the first ' * (len(at) > 1)}with an effective mass of "
                f"{quantity(*each.effective_mass, unit=search.mass_unit)}, or "
                f"{_percent(each.effective_ratio)} of the modal mass, in mode {each.mode} of the "
                "main structure"
            )
            if ordinal == ORDINALS[0]:
                words += ": the vibrating mass times the squared motion of its place, over that of"
                words += " the sensor that moves most"
        yield f"{words[0].upper()}{words[1:]}."
        yield _where(search, each, whose)
    if search.matched:
        number = f"{len(search.matched)} appendages" if several else "one appendage"
        yield (
            f"This holds for the hypotheses with {number}, whose probability together is "
            f"{probability_in_words(search.probability_of_number)}: medians and 90 % intervals."
        )


def _where(search: SearchRecord, each: MatchedAppendage, whose: str) -> str:
    first, *others = each.places
    mass = quantity(*first.amounts["mass"], unit=search.mass_unit)
    share, already = first.amounts["in_model"], ""
    if share[0] < 1.0 and share[2] > 0.0:
        already = f", of which a share of {quantity(*share)} is in the model already"
    words = (
        f"It is most probably {first.place.description} (probability "
        f"{probability_in_words(first.probability)}), where {mass} vibrates{already}."
    )
    left = {place.place.name: place.by_data or 0.0 for place in each.places_by_data}
    if others and (len(left) > 1 or each.against_by_prior):
        shown = [f"{name} ({probability_in_words(p)})" for name, p in left.items()]
        words += (
            f" Of {len(each.places)} places for {whose}, the data alone leave {len(left)}, with a "
            f"prior that is uniform in the logarithm of mass: {shortened(shown)}."
        )
    if against := [place.place.name for place in each.against_by_prior]:
        words += f" Only the prior of the mass speaks against {shortened(against)}."
    return words


def _motions(search: SearchRecord) -> Iterator[str]:
    """Motions that the model does not have, in place of an appendage, and what would tell."""
    probable = [each for each in search.motions if each.probability >= SAID_OF_A_MOTION]
    for each in sorted(probable, key=lambda one: -one.probability):
        yield (
            f"A mode at {quantity(*each.amounts['frequency_hz'], unit='Hz')} is, with probability "
            f"{probability_in_words(each.probability)}, no appendage but {each.place.description}:"
            " torsion, the other direction, the ground or a neighbour, which changes no other mode."
        )
    if probable:
        yield (
            "A sensor at another edge of a floor, in the other direction or on the ground would "
            "tell it from an appendage."
        )


def lost(change: Finding) -> str:
    """What one place lost: medians and 90 % intervals."""
    several = len(change.amounts) > 1
    return listed(
        (f"of {name.removeprefix('loss, ')} " if several else "") + _percent(share)
        for name, share in change.amounts.items()
    )


def _percent(share: Quantiles) -> str:
    low, middle, high = (100.0 * each for each in share)
    return quantity(low, middle, high, "%")


def _change_sentences(record: ChangeRecord) -> Iterator[str]:
    """Where it changed and by how much, and what all frequencies did."""
    own = [each for each in record.places if not each.place.is_common]
    if record.probability_of_any >= PROBABLE:
        yield from _places(record)
    if not record.is_more_likely:
        yield from _visible(record)
    if moved_alike(record.risen):
        shares = sorted(abs(100.0 * each) for each in record.risen.values())
        moved = "rose" if min(record.risen.values()) > 0.0 else "fell"
        yield (
            f"All {len(shares)} frequencies that both sides have {moved} by {shares[0]:.2g} to "
            f"{shares[-1]:.2g} %, as they do where all places change alike."
        )
    for common in (each for each in record.places if each.place.is_common):
        yield (
            "That all places lost a share in common, which counts as no change, has the "
            f"probability {probability_in_words(common.probability)}; the share is then "
            f"{lost(common)}."
        )
    if len(own) == len(record.places) and record.is_more_likely:
        yield (
            "That all places lost a share in common, as by temperature or moisture, was not "
            "considered, and would be taken for a change."
        )
    yield from unsampled(record)


def _of_changes_besides(record: ChangeRecord) -> Iterator[str]:
    """The kinds of change; what would have been seen beside one; what was not considered."""
    if record.is_more_likely:
        if len(record.kinds) > 1:
            kinds = (f"{kind} {probability_in_words(p)}" for kind, p in record.kinds.items())
            yield f"The probabilities of the kinds of change are: {listed(kinds)}."
        yield from _visible(record)
    if "an appendage" not in record.kinds and not record.settings.losses_only:
        yield (
            "An appendage that came or went was not considered, because no mode of one side alone "
            "is unpaired."
            if record.mass_scale
            else "Masses and appendages that came or went were not considered, because the "
            "structure carries no elements, or no sensor says where."
        )
    if record.shared is not None:
        yield (
            f"The tests share {_percent(record.shared)} of the "
            "errors of the model, which is wrong in the same way before and after."
        )


def _changed(record: ChangeRecord, change: Finding) -> str:
    """One change, its probability, and how much of it there is."""
    place, probability = change.place, probability_in_words(change.probability)
    if isinstance(place, SomethingElse):
        return f"{place.name} (probability {probability}), which changed every frequency by itself"
    if isinstance(place, ElementPlace):
        return (
            f"{place.description} (probability {probability}), of {lost(change)} of the "
            f"{record.mass_scale}"
        )
    return f"{place.name} (probability {probability}), which lost {lost(change)}"


def _places(record: ChangeRecord) -> Iterator[str]:
    best = record.best_with_features
    if best is None:
        return
    changed = [record.place(each.place.name) for each in best.features]
    items = [_changed(record, each) for each in changed if not each.place.is_common]
    if record.is_more_likely:
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
        if each.probability >= PROBABLE and not each.place.is_common and each not in changed
    ]
    if others:
        yield f"The other places that may have changed are {shortened(others)}."


def _visible(record: ChangeRecord) -> Iterator[str]:
    if not record.has_visible:
        return
    observed = [each for each in record.places if each.is_observed and not each.place.is_common]
    places = [each for each in observed if isinstance(each.place, ChangePlace)]
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
