"""Predictions from a result directory and the study file that made it.

The model classes of a stored result, built again from the study file.

The classes of a ranking are in the study file, with their pairings given or inferred. The classes
of a search are hypotheses on a class of the study file, from the places and settings of its record.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.posterior_draws import PREDICTION_SETTINGS, thinned_draws
from bayes_ssi.results.predictions.predictions import Predictions
from bayes_ssi.results.stored_result import StoredResult, load_result
from bayes_ssi.studies.ranking.study import Study, load_study

# Name of predictions that are averaged over model classes.
AVERAGE = "average"


def stored_classes(stored: StoredResult, study: Study, study_file: Path) -> dict[str, ModelClass]:
    """Name → model class, for all that were sampled, from the study of ``study_file``."""
    names = [posterior.name for posterior in stored.posteriors]
    search, stands_for = stored.search, stored.record.stands_for
    try:
        if search is not None:
            return {name: search.model_class(study, name) for name in names}
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


@dataclass(frozen=True, eq=False)
class StoredPredictions:
    """A stored result and its model classes.

    Attributes:
        stored: the result.
        model_classes: name → class.
        n_draws: number of posterior draws of every prediction.
        configuration: the state of the structure that is predicted.
    """

    stored: StoredResult
    model_classes: dict[str, ModelClass]
    n_draws: int
    configuration: str

    @property
    def data(self) -> ModalData:
        """The modes identified in the configuration."""
        return self.stored.tests[self.configuration]

    def of(self, name: str = AVERAGE) -> Predictions:
        """Predictions of the model class ``name``; for ``"average"``, averaged over all classes
        or hypotheses by their probabilities.

        A class gets its share of the draws, rounded; one whose share rounds to nothing gets none.

        Raises:
            ValueError: there is no class of that name, or it has changed since it was sampled.
        """
        shares = {name: 1.0}
        if name == AVERAGE:
            shares = {row.name: row.probability for row in self.stored.comparison.classes}
        counts = _shares(list(shares.values()), self.n_draws)
        classes = tuple(
            thinned_draws(
                self.stored.posterior(each), self.model_classes[each], count, self.configuration
            )
            for each, count in zip(shares, counts, strict=True)
            if count
        )
        return Predictions(name, classes)


def _shares(probabilities: Sequence[float], total: int) -> list[int]:
    """Whole numbers proportional to probabilities, rounded by the largest remainder."""
    exact = total * np.array(probabilities) / sum(probabilities)
    counts = np.floor(exact).astype(int)
    order = np.argsort(counts - exact, kind="stable")
    counts[order[: total - counts.sum()]] += 1
    return [int(count) for count in counts]


@checked
def load_predictions(
    directory: str | Path,
    study_file: str | Path | None = None,
    n_draws: int = PREDICTION_SETTINGS.n_draws,
    configuration: str | None = None,
) -> StoredPredictions:
    """What a stored result of a ranking or a search can predict.

    The draws come from the result directory, the structures from the study file; that they belong
    together is checked at stored draws.

    Args:
        directory: the result.
        study_file: the study; the file that the result names if None.
        n_draws: number of posterior draws of every prediction; at most those that are stored.
        configuration: the state of the structure that is predicted; not needed where there is
            only one.

    Raises:
        ValueError: the result is damaged or incomplete, the study file is missing, defines no
            study or other model classes, or the configuration is unknown or not given.
    """
    if n_draws < 1:
        raise ValueError(f"predictions: the number of draws must be at least 1, got {n_draws!r}")
    stored = load_result(directory)
    if study_file is None:
        path, study = _recorded_study(stored)
    else:
        path, study = Path(study_file), load_study(study_file)
    classes = stored_classes(stored, study, path)
    for each in classes.values():
        name = each.configuration(configuration).name
        require_known(f"{directory}: it has no configuration", [name], stored.tests)
    n_stored = max(len(posterior.values) for posterior in stored.posteriors)
    return StoredPredictions(stored, classes, min(n_draws, n_stored), name)


def _recorded_study(stored: StoredResult) -> tuple[Path, Study]:
    """The study file that a result names, and its study, whatever the working directory is now.

    A relative path started in a directory above the result, which was the working directory then;
    the study may read other files from there.
    """
    recorded = stored.record.study_file
    for start in (*stored.directory.absolute().parents, Path.cwd()):
        if recorded and (start / recorded).is_file():
            with contextlib.chdir(start):
                return start / recorded, load_study(recorded)
    raise ValueError(
        f"{stored.directory}: its study file {recorded!r} is not there; say where it is "
        "(--study FILE)"
    )
