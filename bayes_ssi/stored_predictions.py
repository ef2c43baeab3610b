"""Predictions from a result directory and the study file that made it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bayes_ssi.class_draws import DRAWS
from bayes_ssi.model_class import ModelClass
from bayes_ssi.predictions import Predictions, predict_average, predict_class
from bayes_ssi.results import StoredResult, load_result
from bayes_ssi.study import load_study

__all__ = ["StoredPredictions", "load_predictions"]


@dataclass(frozen=True, eq=False)
class StoredPredictions:
    """A stored result with the model classes that it is of.

    Attributes:
        stored: the result.
        model_classes: name → class.
        n_draws: of every prediction.
    """

    stored: StoredResult
    model_classes: dict[str, ModelClass]
    n_draws: int

    def of_class(self, name: str) -> Predictions:
        """Predictions of one model class.

        Raises:
            ValueError: there is none of that name, or it has changed since it was sampled.
        """
        posterior = self.stored.posterior(name)
        return predict_class(posterior, self.model_classes[name], self.n_draws)

    def average(self) -> Predictions:
        """Predictions averaged over all classes by their probabilities.

        Raises:
            ValueError: a class has changed since it was sampled.
        """
        return predict_average(
            self.stored.comparison, self.stored.posteriors, self.model_classes, self.n_draws
        )


def load_predictions(
    directory: str | Path, study_file: str | Path | None = None, n_draws: int = DRAWS
) -> StoredPredictions:
    """What a stored result can predict.

    The draws come from the result directory, the structures from the study file; whether they
    belong together is checked at stored draws.

    Args:
        directory: the result.
        study_file: of the study; where the result says if None.
        n_draws: of every prediction.

    Raises:
        ValueError: the result is none or incomplete, or the study file is not there, is no
            study, or defines other model classes.
    """
    stored = load_result(directory)
    recorded = stored.record.get("study_file")
    if study_file is None and (not recorded or not Path(recorded).is_file()):
        raise ValueError(f"{directory}: its study file {recorded!r} is not there; say where it is")
    path = Path(study_file or str(recorded))
    study = load_study(path)
    classes = {each.name: each for each in study.model_classes}
    classes |= {each.name: each for each in study.with_any_pairing().model_classes}
    wanted = [posterior.name for posterior in stored.posteriors]
    for name in wanted:
        if name in classes:
            continue
        if (stored.directory / "search.json").is_file():
            raise ValueError(
                f"{directory}: the result of a search; its hypothesis {name!r} is in no study "
                "file, so its structure cannot be had back"
            )
        raise ValueError(
            f"{path}: defines no model class {name!r}, which {directory} is of; it defines "
            f"{', '.join(map(repr, study.names))}"
        )
    return StoredPredictions(stored, {name: classes[name] for name in wanted}, n_draws)
