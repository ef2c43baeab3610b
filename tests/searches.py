"""Searches to be looked at: places, settings, and evidences that were not sampled."""

import bayes_ssi as bs
from bayes_ssi.appendages.hypotheses import Place, SearchSettings

COARSE = bs.SamplingSettings(log_evidence_error=1.0, particles=40, searches=1, max_steps=10)
ONE = SearchSettings(number_weights=(1.0, 1.0))
PENDULUM_1, PENDULUM_3 = Place("pendulum", (1,)), Place("pendulum", (3,))
INFILL_12, INFILL_01 = Place("infill", (1, 2)), Place("infill", (0, 1))


def by_count(*log_evidences):
    """Log evidence by the number of appendages; a little more for those named later."""
    return lambda name: (
        log_evidences[0 if name == "no appendage" else 1 + name.count(" + ")]
        + 0.01 * sum(name.encode()) / 1000
    )
