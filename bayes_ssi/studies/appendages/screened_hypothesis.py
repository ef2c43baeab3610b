"""A hypothesis of a search, with its approximate evidence."""

from __future__ import annotations

import math
from typing import NamedTuple

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.screening import Screened


class Key(NamedTuple):
    """What a hypothesis claims: the name of its baseline, and the places of its appendages."""

    baseline: str
    places: tuple[AppendagePlace, ...]


class ScreenedHypothesis(NamedTuple):
    """A hypothesis: its claim, its model class, its prior weight, and its approximate evidence."""

    key: Key
    model_class: ModelClass
    prior_weight: float
    screened: Screened

    @property
    def approximate_log_mass(self) -> Estimate:
        """Log of prior weight times approximate evidence."""
        weight = math.log(self.prior_weight)
        return Estimate(weight + self.screened.log_evidence, self.screened.error)

    def log_mass(self, posterior: Posterior) -> float:
        """Log of prior weight times the evidence that sampling gave."""
        return math.log(self.prior_weight) + posterior.evidence.log_evidence
