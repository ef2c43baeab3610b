"""The model classes of a stored result, built again from the study file that it is of.

Those of a ranking are in the study file, as they are or with their pairings inferred. Those of a
search are hypotheses on a class of the study file, by the places and settings that the search put
on record.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from bayes_ssi.appendages.hypotheses import Place, SearchSettings, hypothesis
from bayes_ssi.codec import from_record
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.ranking.study import Study
from bayes_ssi.results.load import StoredResult

__all__ = ["stored_classes"]

SEARCH = "search.json"
OR = " or "


def stored_classes(stored: StoredResult, study: Study, study_file: Path) -> dict[str, ModelClass]:
    """Name → model class, of all that were sampled.

    Args:
        stored: the result.
        study: the study, from ``study_file``.
        study_file: for messages.

    Raises:
        ValueError: the study defines no such class, or the record of a search is damaged.
    """
    names = [posterior.name for posterior in stored.posteriors]
    search = stored.directory / SEARCH
    if search.is_file():
        return _of_search(names, search, study, study_file)
    known = {each.name: each for each in study.model_classes}
    for some in (study, *(_merged(name, study) for name in names)):
        known = {each.name: each for each in some.with_any_pairing().model_classes} | known
    for name in names:
        if name not in known:
            raise ValueError(
                f"{study_file}: defines no model class {name!r}, which {stored.directory} is of; "
                f"it defines {', '.join(map(repr, study.names))}"
            )
    return {name: known[name] for name in names}


def _merged(name: str, study: Study) -> Study:
    """The classes of a study that one of this name may have been merged from."""
    parts = [part for part in study.names if part in name.split(OR)]
    return study.only(parts) if parts else study


def _of_search(
    names: Sequence[str], file: Path, study: Study, study_file: Path
) -> dict[str, ModelClass]:
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        baseline = record["baseline"]
        settings = from_record(SearchSettings, record["search_settings"], "search_settings")
        places = {
            row["name"]: [
                Place(each["place"]["kind"], tuple(each["place"]["floors"]))
                for each in row["appendages"]
            ]
            for row in record["hypotheses"]
        }
        of_hypotheses = {name: places[name] for name in names}
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{file}: damaged, or of an older version: {error!r}") from None
    try:
        (on,) = study.only([baseline]).model_classes
    except ValueError as error:
        raise ValueError(
            f"{study_file}: lacks the model class that the search was built on: {error}"
        ) from None
    return {name: hypothesis(on, each, settings) for name, each in of_hypotheses.items()}
