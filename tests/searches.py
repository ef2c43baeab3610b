"""For tests of searches: places, settings, and evidences that were not sampled."""

import bayes_ssi as bs
from bayes_ssi.appendages.hypotheses import SearchSettings
from bayes_ssi.appendages.places import InfillPlace, PendulumPlace

COARSE = bs.SamplingSettings(log_evidence_error=1.0, particles=40, searches=1, max_steps=10)
ONE = SearchSettings(number_weights=(1.0, 1.0))
PENDULUM_1, PENDULUM_3 = PendulumPlace(1), PendulumPlace(3)
INFILL_12, INFILL_01 = InfillPlace((1, 2)), InfillPlace((0, 1))


def by_count(*log_evidences):
    """Log evidence of a class by its number of appendages, and a little by its name."""
    return lambda model_class: (
        log_evidences[len(model_class.structure.appendages)]
        + 0.01 * sum(model_class.name.encode()) / 1000
    )
