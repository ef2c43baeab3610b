"""What ``result.json`` holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bayes_ssi.inference.model_class.class_record import ClassRecord
from bayes_ssi.inference.sampling.settings import SamplingSettings

# Increased whenever the format of a result's files changes.
FORMAT = 18


@dataclass(frozen=True)
class ResultRecord:
    """Everything in a result but its draws and its data.

    Attributes:
        study_file: the file that defines the study; empty where there is none.
        prior_weights: model class → prior weight; None where all are equal.
        command: the command that reproduces the result; empty where it was made from Python.
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
    data: Mapping[str, str]
    failed_checks_accepted: bool
    command: str
    format: int = FORMAT

    def model_class(self, name: str) -> ClassRecord:
        """The record of the model class ``name``; KeyError if there is none."""
        return {each.name: each for each in self.model_classes}[name]
