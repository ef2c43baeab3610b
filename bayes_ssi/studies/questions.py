"""What a study is asked: which of its classes holds, what hides in the data, what changed.

Every answer is made in one way: hypotheses, as much effort for each as it takes, their comparison,
checks of it, and what follows.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.studies.appendages.appendage_search import SearchRecord, appendage_findings
from bayes_ssi.studies.appendages.baselines import choose_baselines
from bayes_ssi.studies.appendages.candidates import SearchSettings
from bayes_ssi.studies.appendages.unmodelled import appendage_checks
from bayes_ssi.studies.changes.change_search import ChangeRecord, change_findings
from bayes_ssi.studies.changes.changes_family import ChangeSettings, choose_changes
from bayes_ssi.studies.ranking.checks import ranked
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.study import Ranking, Study
from bayes_ssi.studies.search.family import Family
from bayes_ssi.studies.search.family_search import FamilySearch, search_family
from bayes_ssi.studies.search.findings import Record, SearchResult

AnyFamily = TypeVar("AnyFamily", bound=Family[Any])


@checked
def rank(
    study: Study, seed: int = 0, settings: SamplingSettings | None = None, run: Run | None = None
) -> Ranking:
    """Sample every model class of a study and rank them by evidence.

    Args:
        study: the candidates.
        seed: a class's result follows from it and the class's name, regardless of other classes.
        settings: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; no result depends on them.

    Raises:
        ValueError: the classes explain different data, a class's likelihood is zero everywhere,
            the model cannot be evaluated by the workers, or the checkpoint is in use or damaged.

    >>> frame = bs.ShearBuilding((1.0, 1.0), 2 * (bs.Parameter("k", bs.LogNormal(40.0, 0.3)),))
    >>> modes = bs.ModalData((bs.IdentifiedMode("1", 0.622),), band_hz=(0.0, 1.0))
    >>> error = bs.ErrorModel(frequency_cov=0.01)
    >>> one = bs.ModelClass("first mode", frame, modes, error, pairing={"1": 1})
    >>> none = bs.ModelClass("no mode", frame, modes, error, pairing={})
    >>> bs.rank(bs.Study("Is it a mode?", [one, none])).comparison.best.name
    'first mode'
    """
    study.require_same_data()
    settings, run = settings or SamplingSettings(), run or Run()
    with run.working():
        posteriors = sample_all(study.model_classes, seed, settings, run)
        ranking = ranked(study, posteriors, seed, settings, run)
        further = ranking.comparison.with_further([*appendage_checks(ranking, run)])
        return replace(ranking, comparison=further)


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
) -> SearchResult[SearchRecord]:
    """Search for hidden appendages on a baseline structure, or on each of several.

    Args:
        baseline: a class; its pairing is not used. Of a study, all classes are baselines on which
            appendages can be hung, with its prior weights, but for those that carry an appendage
            of their own where others do not.
        search_settings: what an appendage may be.
        seed: a hypothesis's result follows from it and the hypothesis's name.
        settings: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; no result depends on them.
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
    study = _study(baseline)
    family = choose_baselines(study, baselines, candidates, present_in, search_settings)
    return searched(family, appendage_findings, seed, settings or SamplingSettings(), run or Run())


@checked
def changes(
    study: ModelClass | Study,
    before: Sequence[str],
    after: Sequence[str],
    change_settings: ChangeSettings | None = None,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
    *,
    joined: Mapping[str, Sequence[str]] | None = None,
    places: Mapping[str, Sequence[str]] | None = None,
    left_out: Sequence[str] = (),
    visible: bool = True,
) -> SearchResult[ChangeRecord]:
    """What changed between two tests of a structure, or between two groups of tests.

    Args:
        study: a class with these tests, or several, over which answers are averaged.
        before: names of configurations, and ``after``.
        change_settings: what a change may be.
        seed: a hypothesis's result follows from it and the hypothesis's name.
        settings: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; no result depends on them.
        joined: name of a place → parameters that lose one share. Every parameter of the structure
            that is neither here nor in ``places`` is a place of its own.
        places: name of a place → parameters of which each loses a share of its own.
        left_out: parameters that do not change.
        visible: whether to compute the smallest losses that the tests would have shown; not where
            they show a change.

    Raises:
        ValueError: a configuration or parameter is unknown or named twice, no mode is paired both
            before and after, or a hypothesis cannot be sampled.
    """
    study = _study(study)
    family = choose_changes(
        study, before, after, change_settings, joined=joined, places=places, left_out=left_out
    )
    # A probability to a twentieth of its odds is as much as anyone asks.
    settings = settings or SamplingSettings(log_evidence_error=0.05)
    to_record = partial(change_findings, visible=visible)
    return searched(family, to_record, seed, settings, run or Run())


def searched(
    family: AnyFamily,
    findings: Callable[[AnyFamily, FamilySearch[Any], int, Run], Record],
    seed: int,
    settings: SamplingSettings,
    run: Run,
) -> SearchResult[Record]:
    """The hypotheses of a family, screened, sampled where the answer rests on them, and ranked."""
    family = family.in_reduced_bases()
    with run.working():
        family_search = search_family(family, seed, settings, run)
        return SearchResult(family_search.ranking, findings(family, family_search, seed, run))


def _study(study: ModelClass | Study) -> Study:
    return Study(study.name, [study]) if isinstance(study, ModelClass) else study
