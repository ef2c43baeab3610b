"""The model classes on which appendages are hung: the baseline of a search is a question, too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bayes_ssi.appendages.hypotheses import places_of, structure_with_floors
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.ranking.class_sampling import is_cheap
from bayes_ssi.ranking.study import Study


@dataclass(frozen=True, eq=False)
class Baselines:
    """What a search hangs appendages on, and what it compares that with.

    Attributes:
        study: the baselines, any pairing; classes that differ in nothing else are one of them.
        rivals: further classes of the study, any pairing, which are compared without appendages.
        left_out: class of the study that no appendage can be hung on → why.
    """

    study: Study
    rivals: tuple[ModelClass, ...]
    left_out: Mapping[str, str]

    @property
    def classes(self) -> tuple[ModelClass, ...]:
        return tuple(self.study.model_classes)

    @property
    def n_hypotheses_of_one(self) -> int:
        """The number of hypotheses with at most one appendage."""
        return sum(1 + len(places_of(structure_with_floors(each))) for each in self.classes)

    def prior_probability(self, baseline: ModelClass) -> float:
        """That of one baseline among all, without regard to appendages."""
        weights = self.study.prior_weights or dict.fromkeys(self.study.names, 1.0)
        return weights[baseline.name] / sum(weights.values())

    def original_names(self, baseline: ModelClass) -> tuple[str, ...]:
        """The classes of the study that a baseline represents."""
        return self.study.stands_for[baseline.name]


def choose_baselines(study: Study, names: Sequence[str] | None = None) -> Baselines:
    """The baselines of a search.

    Args:
        study: the model classes.
        names: those to hang appendages on; all on which that can be done if None.

    Raises:
        ValueError: the study has no class of such a name, appendages cannot be hung on one of
            those named, or on any; or the classes explain different data.
    """
    left_out: dict[str, str] = {}
    chosen = study if names is None else study.only(names)
    for candidate in chosen.model_classes:
        try:
            structure_with_floors(candidate)
            candidate.with_any_pairing(candidate.name)
        except ValueError as error:
            if names is not None or len(study.model_classes) == 1:
                raise
            left_out[candidate.name] = str(error)
    if len(left_out) == len(chosen.model_classes):
        raise ValueError(next(iter(left_out.values())))
    chosen = chosen.only([name for name in chosen.names if name not in left_out])
    chosen.require_same_data()
    chosen = chosen.with_any_pairing()
    known = {name for own in chosen.stands_for.values() for name in own}
    return Baselines(chosen, _rivals(study, known, chosen.model_classes[0].data_digest), left_out)


def _rivals(study: Study, known: set[str], data_digest: str) -> tuple[ModelClass, ...]:
    """The other classes of the same data, where an evidence over all pairings takes seconds."""
    others = [
        each.name
        for each in study.model_classes
        if each.name not in known
        and each.data_digest == data_digest
        and is_cheap(each)
        and not each.error.is_correlated
    ]
    if not others:
        return ()
    return tuple(study.only(others).with_any_pairing().model_classes)
