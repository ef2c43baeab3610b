"""For tests of searches: places, settings, and evidences that were not sampled."""

import numpy as np

import bayes_ssi as bs
from bayes_ssi.appendages.hypotheses import SearchSettings
from bayes_ssi.appendages.places import InfillPlace, PendulumPlace
from bayes_ssi.appendages.screening import Screened

COARSE = bs.SamplingSettings(log_evidence_error=1.0, particles=40, searches=1, max_steps=10)
# One appendage at most; all sampled.
ONE = SearchSettings(number_weights=(1.0, 1.0), most_unsampled=0.0)
ALL = SearchSettings(most_unsampled=0.0)
PENDULUM_1, PENDULUM_3 = PendulumPlace(1), PendulumPlace(3)
INFILL_12, INFILL_01 = InfillPlace((1, 2)), InfillPlace((0, 1))


def by_count(*log_evidences):
    """Log evidence of a class by its number of appendages, and a little by its name."""
    return lambda model_class: (
        log_evidences[len(model_class.structure.appendages)]
        + 0.01 * sum(model_class.name.encode()) / 1000
    )


def screened(model_class, log_evidence, error=0.0):
    """A hypothesis with this approximate evidence, and draws of its prior."""
    names = model_class.parameter_names
    z = np.random.default_rng(0).standard_normal((100, len(names)))
    return Screened(names, log_evidence, error, log_evidence, 1, z, np.full(100, 0.01), None)
