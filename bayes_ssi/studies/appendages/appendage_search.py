"""The search for hidden appendages: is there one, where, how heavy, and at which frequency?

On each of several baseline classes it builds hypotheses: no appendage; one appendage of each kind
at each of its places; then one more, as long as the evidence grows. No pairing of modes is assumed:
every hypothesis is scored over all pairings. All are screened, which gives approximate evidences;
those on which the answer rests are sampled.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.studies.appendages.baselines import Baselines, choose_baselines
from bayes_ssi.studies.appendages.found_appendages import (
    DrawsOfAll,
    appendage_draws,
    matched_appendages,
    place_records,
)
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.search_result import (
    AppendageSearch,
    AppendagesRecord,
    BaselineRecord,
    SearchRecord,
)
from bayes_ssi.studies.appendages.search_settings import SearchSettings
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.approximate_evidence import Screened, ToScreen, screen_all
from bayes_ssi.studies.search.family_search import FamilySearch, search_family
from bayes_ssi.studies.search.search_record import of_every_search, records_by_probability


@checked
def search(
    baseline: ModelClass | Study,
    search_settings: SearchSettings | None = None,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
    *,
    baselines: Sequence[str] | None = None,
    candidates: Sequence[Candidate] | None = None,
    present_in: Sequence[str] | None = None,
) -> AppendageSearch:
    """Search for hidden appendages on a baseline structure, or on each of several.

    Args:
        baseline: a class; its pairing is not used. Of a study, all classes are baselines on which
            appendages can be hung, with its prior weights, but for those that carry an appendage
            of their own where others do not.
        search_settings: what an appendage may be.
        seed: a hypothesis's result follows from it and the hypothesis's name.
        settings: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; the result does not depend on
            them.
        baselines: names of the study's classes that appendages are hung on; the others are
            compared without any.
        candidates: where appendages may hang; floors and storeys where a structure has them, else
            all sensors, if None.
        present_in: names of the configurations that have the appendages; if None, all whose
            structures have the candidates' places.

    Raises:
        ValueError: appendages cannot be hung on any structure, a candidate is not on it or is
            given twice, there is no class or configuration of such a name, or a hypothesis cannot
            be sampled.
    """
    settings = settings or SamplingSettings()
    if isinstance(baseline, ModelClass):
        baseline = Study(baseline.name, [baseline])
    chosen = choose_baselines(baseline, baselines, candidates, present_in, search_settings)
    hidden_in = chosen.classes[0].name if len(chosen.classes) == 1 else baseline.name
    run = run or Run()
    with run.working():
        found = search_family(chosen, f"Appendages hidden in {hidden_in!r}", seed, settings, run)
        rivals = screen_all([ToScreen(rival, None) for rival in chosen.rivals], seed, run)
    return AppendageSearch(found.ranking, _record(chosen, rivals, found))


def _record(
    baselines: Baselines, rivals: Sequence[Screened], found: FamilySearch[AppendagePlace]
) -> SearchRecord:
    draws = {
        each.model_class.name: appendage_draws(
            each,
            found.posteriors.get(each.model_class.name),
            baselines.scales[each.key.baseline].mass,
        )
        for each in found.hypotheses
    }
    rows = hypothesis_records(found, draws)
    return SearchRecord(
        baselines=(
            *sorted(_searched(baselines, rows), key=lambda record: -record.probability),
            *(
                BaselineRecord(rival.name, (), screened.log_evidence, 0.0, 0.0, None)
                for rival, screened in zip(baselines.rivals, rivals, strict=True)
            ),
        ),
        left_out=dict(baselines.left_out),
        present_in=baselines.present_in,
        search_settings=baselines.options,
        probability_of_any=sum(each.probability for each in rows if each.appendages),
        places=place_records(draws, found.probabilities, baselines),
        geometry=baselines.geometry,
        hypotheses=rows,
        matched=matched_appendages(draws, rows, baselines, found.hypotheses),
        mass_unit=baselines.study.mass_unit,
        **of_every_search(found),
    )


def hypothesis_records(
    found: FamilySearch[AppendagePlace], draws: DrawsOfAll
) -> tuple[AppendagesRecord, ...]:
    """All hypotheses with their appendages, the most probable first."""

    def record(name: str, **fields: Any) -> AppendagesRecord:
        appendages = tuple(own.summary(place) for place, own in draws[name].items())
        return AppendagesRecord(name=name, appendages=appendages, **fields)

    return records_by_probability(found, record)


def _searched(baselines: Baselines, rows: Sequence[AppendagesRecord]) -> Iterator[BaselineRecord]:
    """The baselines that appendages were hung on."""
    for name in baselines.study.names:
        on_it = [row for row in rows if row.baseline == name]
        (without,) = [row for row in on_it if not row.appendages]
        yield BaselineRecord(
            name=name,
            classes=baselines.study.stands_for[name],
            log_evidence=without.log_evidence,
            prior_probability=sum(row.prior_probability for row in on_it),
            probability=sum(row.probability for row in on_it),
            mass_scale=baselines.scales[name],
        )
