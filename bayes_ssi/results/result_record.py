"""What ``result.json`` holds, and whether the other files of a result belong to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.model_class.class_record import ClassRecord
from bayes_ssi.model_class.configuration import joint_digest
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.comparison import Comparison
from bayes_ssi.sampling.settings import SamplingSettings

__all__ = ["FORMAT", "DataFile", "ResultRecord", "check_consistent"]

# Raised whenever the files of a result change.
FORMAT = 6


@dataclass(frozen=True)
class DataFile:
    """Where the identified modes of a configuration are stored, and where they come from."""

    configuration: str
    file: str
    source: str


@dataclass(frozen=True)
class ResultRecord:
    """Everything of a result but its draws and its data.

    Attributes:
        created: date and time.
        study: title of the study.
        description: what the study asks.
        study_file: the file that defines the study; empty where there is none.
        seed: of the sampling.
        settings: of the sampling.
        prior_weights: model class → prior weight; None where all are equal.
        data_digest: identifies the data that were ranked.
        versions: of what the result depends on.
        model_classes: the candidates.
        stands_for: as in :class:`~bayes_ssi.ranking.study.Study`.
        posteriors: records of the posteriors, without their draws.
        draws: model class → file of the draws, in the result's directory.
        data: the identified modes of every configuration.
        failed_checks_accepted: whether the user accepted failed checks.
        command: the command that gives the result again; empty where it was made from Python.
        format: of the files.
    """

    created: str
    study: str
    description: str
    study_file: str
    seed: int
    settings: SamplingSettings
    prior_weights: Mapping[str, float] | None
    data_digest: str
    versions: Mapping[str, str]
    model_classes: tuple[ClassRecord, ...]
    stands_for: Mapping[str, tuple[str, ...]]
    posteriors: tuple[Mapping[str, Any], ...]
    draws: Mapping[str, str]
    data: tuple[DataFile, ...]
    failed_checks_accepted: bool
    command: str
    format: int = FORMAT

    def model_class(self, name: str) -> ClassRecord:
        """The record of the model class ``name``; KeyError if there is none."""
        return {each.name: each for each in self.model_classes}[name]


def check_consistent(
    record: ResultRecord,
    tests: Mapping[str, ModalData],
    posteriors: Sequence[Posterior],
    comparison: Comparison,
) -> None:
    """Refuse files that are not of one result.

    Raises:
        ValueError: modes, draws or classes are not those of the record.
    """
    if joint_digest(tests) != record.data_digest:
        raise ValueError("the identified modes are not those that were ranked")
    names = [posterior.name for posterior in posteriors]
    for what, others in (
        ("comparison.json", [row.name for row in comparison.classes]),
        ("'model_classes'", [each.name for each in record.model_classes]),
    ):
        if not names or sorted(others) != sorted(names):
            raise ValueError(f"{what} and 'posteriors' are not of the same model classes")
    for posterior in posteriors:
        _check_draws(posterior)
        if set(posterior.configuration_names) != set(tests):
            raise ValueError(f"posterior of {posterior.name!r}: other configurations than the data")
        for modes in posterior.configurations:
            unknown = [label for label in modes.pairing if label not in tests[modes.name].labels]
            if unknown:
                raise ValueError(
                    f"posterior of {posterior.name!r}: pairs {unknown[0]!r}, which is not among "
                    "the identified modes"
                )


def _check_draws(posterior: Posterior) -> None:
    n_chains, n_steps, n_parameters = np.shape(posterior.draws)
    n_modes = sum(modes.n_modes for modes in posterior.configurations)
    for what, array, shape in (
        ("log-likelihoods", posterior.log_likelihoods, (n_chains, n_steps)),
        ("frequencies", posterior.frequencies_hz, (n_chains, n_steps, n_modes)),
        ("effective sample sizes", posterior.effective_sample_sizes, (n_parameters,)),
        ("relative spreads", posterior.relative_spreads, (n_parameters,)),
    ):
        if np.shape(array) != shape:
            raise ValueError(
                f"posterior of {posterior.name!r}: {what} of shape {np.shape(array)}, expected "
                f"{shape} from its draws"
            )
    if not posterior.draws.size or not np.isfinite(posterior.draws).all():
        raise ValueError(f"posterior of {posterior.name!r}: no draws, or draws that are not finite")
