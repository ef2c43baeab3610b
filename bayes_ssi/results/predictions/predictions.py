"""Predictions with their uncertainty, from posterior draws of one model class or of several.

Nothing is sampled here. Draws of a posterior, thinned evenly, go through the structure; those of
several classes are joined in the proportions of the classes' probabilities, so that every draw of
a prediction has the same weight and its quantiles are those of the average over classes.

The classes of a stored result are built again from the study file: those of a ranking are in it,
with their pairings given or inferred; those of a search are hypotheses on a class of it, from the
places and settings of the search's record.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.posterior_draws import (
    DRAWS_OF_A_PREDICTION,
    MOST_PLACES,
    Band,
    PosteriorDraws,
    Prediction,
    thinned_draws,
)
from bayes_ssi.results.stored_result import StoredResult, load_result
from bayes_ssi.structures.modal import scaled_shapes, shape_signs
from bayes_ssi.structures.response import (
    Damping,
    GroundMotion,
    Output,
    time_histories,
    transfer_functions,
)
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.ranking.study import Study, load_study

# Name of predictions that are averaged over model classes.
AVERAGE = "average"


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions of one model class, or of several in the proportions of their probabilities."""

    name: str  # for titles
    classes: tuple[PosteriorDraws, ...]

    @property
    def n_draws(self) -> int:
        return sum(len(draws.values) for draws in self.classes)

    @property
    def composition(self) -> str:
        """Sentence on the model classes whose draws make the predictions."""
        if self.name != AVERAGE:
            return f"{self.name}: one model class."
        by_share = sorted(self.classes, key=lambda each: -len(each.values))
        shares = [f"{len(each.values)} of {each.name!r}" for each in by_share[:4]]
        if len(by_share) > 4:
            shares.append(f"{sum(len(each.values) for each in by_share[4:])} of others")
        return f"{AVERAGE}: draws in proportion to probability, {', '.join(shares)}."

    def frequencies_hz(self, mode: str | int) -> Prediction:
        """The frequency of a mode in Hz, draws (n,).

        Args:
            mode: label of an identified mode; or, where there is one class only, number of a
                model mode, from 1.

        Raises:
            ValueError: there is no such mode.
        """
        return self._joined(
            [each.frequencies_hz[:, number - 1] for each, number in self._classes_with(mode)]
        )

    def shapes(self, mode: str | int, places: Sequence[str]) -> Prediction:
        """The shape of a mode at some degrees of freedom or sensors, draws (n, n_places).

        Each draw is scaled by :func:`~bayes_ssi.structures.modal.scaled_shapes`, and all are turned
        to the identified shape, if ``mode`` has one.

        Args:
            mode: as for :meth:`frequencies_hz`.
            places: labels of degrees of freedom or sensors.

        Raises:
            ValueError: there is no such mode, or a class has no such place.
        """
        wanted = places, self.main_places, self.classes[0].likelihood.data.sensors
        labels = [label for some in wanted for label in some]
        parts = []
        for each, number in self._classes_with(mode):
            with _named(each):
                parts.append(each.shapes(number, labels))
        joined = self._joined(parts)
        ends = np.cumsum([len(some) for some in wanted])[:2]
        shapes, main, at_sensors = np.split(joined.draws, ends, axis=1)
        signs = shape_signs(main, at_sensors, self._identified_shape(mode))
        return Prediction(scaled_shapes(shapes, main) * signs[:, None], joined.share)

    @property
    def main_places(self) -> tuple[str, ...]:
        """Degrees of freedom of the main structure that all classes have."""
        first, *others = (draws.main_places for draws in self.classes)
        return tuple(place for place in first if all(place in other for other in others))

    def transfer_functions(
        self,
        frequencies_hz: FloatArray,
        output: Output,
        damping: Damping,
        *,
        force_at: str | None = None,
    ) -> Prediction:
        """Amplitudes of transfer functions, draws (n, n_places, n_frequencies).

        Arguments, units and errors are as in
        :func:`~bayes_ssi.structures.response.transfer_functions`; errors name the class.
        """
        return self._responses(
            lambda structure, values: np.abs(
                transfer_functions(
                    structure, values, frequencies_hz, output, damping, force_at=force_at
                )
            ),
            size_per_mode=4 * np.size(frequencies_hz),  # complex numbers and their products
        )

    def time_histories(self, motion: GroundMotion, output: Output, damping: Damping) -> Prediction:
        """Time histories, draws (n, n_places, n_samples).

        Arguments, units and errors are as in :func:`~bayes_ssi.structures.response.time_histories`.
        """
        return self._responses(
            lambda structure, values: time_histories(structure, values, motion, output, damping)
        )

    def _responses(
        self, compute: Callable[[Structure, FloatArray], FloatArray], size_per_mode: int = 0
    ) -> Prediction:
        parts = []
        for each in self.classes:
            with _named(each):
                function = partial(compute, each.structure)
                size = size_per_mode * each.structure.n_modes
                parts.append(each.evaluate(function, each.values, size))
        return self._joined(parts)

    def _joined(self, parts: list[FloatArray]) -> Prediction:
        draws = np.concatenate(parts)
        return Prediction(draws, len(draws) / self.n_draws)

    def _identified_shape(self, mode: str | int) -> FloatArray | None:
        """The identified shape (n_sensors,) of a mode; None where there is none."""
        own = self.classes[0]
        for identified in own.likelihood.data.modes:
            if mode in (identified.label, own.pairing.get(identified.label)):
                return identified.unit_shape
        return None

    def _classes_with(self, mode: str | int) -> list[tuple[PosteriorDraws, int]]:
        if isinstance(mode, str):
            known = dict.fromkeys(label for each in self.classes for label in each.pairing)
            what = f"{self.name}: no model mode is paired with an identified mode"
            require_known(what, [mode], known)
            return [(each, each.pairing[mode]) for each in self.classes if mode in each.pairing]
        if len(self.classes) > 1:
            raise ValueError(
                f"{self.name}: mode {mode!r} differs between the model classes; give the "
                "label of an identified mode"
            )
        n_modes = self.classes[0].structure.n_modes
        if not 1 <= mode <= n_modes:
            raise ValueError(f"{self.name}: no mode {mode!r}; choose from 1 to {n_modes}")
        return [(self.classes[0], mode)]


@contextlib.contextmanager
def _named(each: PosteriorDraws) -> Iterator[None]:
    """Prefix error messages with the name of the model class."""
    try:
        yield
    except np.linalg.LinAlgError:  # a ValueError, but not of the input
        raise
    except (ValueError, TypeError) as error:
        raise type(error)(f"model class {each.name!r}: {error}") from None


class PredictedMode(NamedTuple):
    """The frequency of an identified mode, and the share of the draws that predict it."""

    label: str
    identified_hz: float
    before_hz: float
    after_hz: Band
    share: float


def predicted_modes(data: ModalData, predictions: Predictions) -> Iterator[PredictedMode]:
    """Frequencies of all identified modes that a prediction explains.

    Before updating, they are those at the prior medians of each draw's class, in the median.
    """
    for mode in data.modes:
        before = []
        for each in predictions.classes:
            if (number := each.pairing.get(mode.label)) is not None:
                at_medians = each.structure.modes(each.structure.prior_medians())
                before.append(np.full(len(each.values), at_medians.frequencies_hz[0, number - 1]))
        if before:
            after = predictions.frequencies_hz(mode.label)
            median = float(Prediction(np.concatenate(before)).band().median)
            yield PredictedMode(mode.label, mode.frequency_hz, median, after.band(), after.share)


def shown_places(predictions: Predictions, data: ModalData) -> tuple[str, ...]:
    """The main structure's places to show: all, or, where they are many, those with sensors."""
    places = predictions.main_places
    if len(places) <= MOST_PLACES:
        return places
    return tuple(place for place in places if place in data.sensors) or places[:MOST_PLACES]


def stored_classes(stored: StoredResult, study: Study, study_file: Path) -> dict[str, ModelClass]:
    """Name → model class, for all that were sampled, from the study of ``study_file``."""
    names = [posterior.name for posterior in stored.posteriors]
    search, stands_for = stored.search, stored.record.stands_for

    def rebuilt(name: str) -> ModelClass:
        if search is not None:
            return search.model_class(study, name)
        first, *_ = stands_for.get(name, [name])
        found = study.only([first]).model_classes[0]
        return found.with_any_pairing(name) if name in stands_for else found

    try:
        return {name: rebuilt(name) for name in names}
    except ValueError as error:
        raise ValueError(f"{study_file}: not the study of {stored.directory}: {error}") from error


@dataclass(frozen=True, eq=False)
class StoredPredictions:
    """A stored result and its model classes."""

    stored: StoredResult
    model_classes: dict[str, ModelClass]
    n_draws: int  # of every prediction
    configuration: str  # the state of the structure that is predicted

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
    n_draws: int = DRAWS_OF_A_PREDICTION,
    configuration: str | None = None,
) -> StoredPredictions:
    """What a stored result of a ranking or a search can predict.

    The draws come from the result directory, the structures from the study file; that they belong
    together is checked at stored draws.

    Args:
        directory: the result.
        study_file: the study; the file that the result names if None.
        n_draws: number of posterior draws of every prediction; at most those that are stored.
        configuration: the state that is predicted; not needed where there is only one.

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
    for model_class in classes.values():
        name = model_class.configuration(configuration).name
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
        f"{stored.directory}: its study file {recorded!r} is not there; say where it is"
    )
