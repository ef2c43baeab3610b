"""The model classes of a stored result, built again from the study file.

The classes of a ranking are in the study file, with their pairings given or inferred. The classes
of a search are hypotheses on a class of the study file, from the places and settings of its record.
"""

from __future__ import annotations

from pathlib import Path

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.results.load import SEARCH, StoredResult
from bayes_ssi.studies.appendages.hypotheses import hypothesis
from bayes_ssi.studies.ranking.study import Study


def stored_classes(stored: StoredResult, study: Study, study_file: Path) -> dict[str, ModelClass]:
    """Name → model class, for all that were sampled.

    Args:
        study: the study, from ``study_file``.
    """
    names = [posterior.name for posterior in stored.posteriors]
    search, stands_for = stored.search, stored.record.stands_for
    hypotheses = {each.name: each for each in search.hypotheses} if search else {}
    missing = [name for name in names if search and name not in hypotheses]
    if missing:
        raise ValueError(f"{stored.directory / SEARCH}: no hypothesis {missing[0]!r}")
    try:
        if search is not None:
            classes = {}
            baselines = {each.name: each for each in search.baselines}
            for name in names:
                row = hypotheses[name]
                if row.baseline not in baselines:
                    raise ValueError(f"{SEARCH}: no baseline {row.baseline!r}")
                original = baselines[row.baseline].classes[0]
                baseline = _only(study, original).with_any_pairing(row.baseline)
                places = [each.place for each in row.appendages]
                classes[name] = hypothesis(
                    baseline,
                    places,
                    search.search_settings,
                    name,
                    present_in=search.present_in,
                    scale=baselines[row.baseline].mass_scale,
                )
            return classes
        return {
            name: _only(study, stands_for[name][0]).with_any_pairing(name)
            if name in stands_for
            else _only(study, name)
            for name in names
        }
    except ValueError as error:
        raise ValueError(f"{study_file}: not the study of {stored.directory}: {error}") from error


def _only(study: Study, name: str) -> ModelClass:
    (model_class,) = study.only([name]).model_classes
    return model_class
