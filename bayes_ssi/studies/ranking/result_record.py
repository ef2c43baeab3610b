"""The record of a ranking: what its result directory holds, but for draws and data."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bayes_ssi.inference.model_class.class_record import ClassRecord
from bayes_ssi.inference.sampling.settings import SamplingSettings

IN_THE_FILE_OF_DRAWS = (
    "draws", "log_likelihoods", "frequencies_hz", "sensor_shapes", "datum_terms", "prior_draws",
)  # fmt: skip


@dataclass(frozen=True)
class ResultRecord:
    """Everything in a result but its draws and its data."""

    created: str
    study: str
    description: str
    seed: int
    settings: SamplingSettings
    # Model class → prior weight; None where all are equal.
    prior_weights: Mapping[str, float] | None
    data_digest: str
    versions: Mapping[str, str]
    model_classes: tuple[ClassRecord, ...]
    stands_for: Mapping[str, tuple[str, ...]]
    posteriors: tuple[Mapping[str, Any], ...]
    draws: Mapping[str, str] = field(default_factory=dict)
    data: Mapping[str, str] = field(default_factory=dict)
    failed_checks_accepted: bool = False
    study_file: str = ""  # the file that defines the study; empty where there is none
    command: str = ""  # the command that reproduces it; empty where it was made from Python
    mass_unit: str = ""  # of the structures; empty where the study states none
    format: int = 23  # increased whenever the format of a result's files changes

    def model_class(self, name: str) -> ClassRecord:
        """The record of the model class ``name``; KeyError if there is none."""
        return {each.name: each for each in self.model_classes}[name]
