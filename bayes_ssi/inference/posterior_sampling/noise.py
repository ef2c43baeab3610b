"""The noise of a model: how far its answers to one question differ when it is asked twice.

Random numbers, meshes made anew, iterations that end early or a state that is kept make a model
noisy. What it remembers does not show that, so the second question differs in the last digits.
"""

from dataclasses import dataclass, replace

import numpy as np

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.refinement import (
    RefinementSettings,
    evenly_spaced_draws,
)
from bayes_ssi.inference.workers.workers import Workers


@dataclass(frozen=True)
class NoiseSettings:
    every: int = 6  # one of so many draws at which approximate structures are confirmed: three
    nudge: float = 1e-13  # as a fraction of each parameter
    said: float = 1e-5  # nats, more than rounding
    # In nats. Noise of standard deviation s raises an evidence by s²/2, half of the wanted error.
    most: float = 0.1


NOISE = NoiseSettings()


def with_noise_said(
    posterior: Posterior, model_class: ModelClass, answered: ModelClass, workers: Workers | None
) -> Posterior:
    """The posterior with a remark, or a failed check, on the noise of the class's structures.

    ``answered`` is the class with structures that may remember their answers at the draws.
    """
    values = evenly_spaced_draws(posterior, RefinementSettings().n_confirmed)[:: NOISE.every]
    first = answered.modes_or_nan(values)
    nudged = values * (1.0 + NOISE.nudge)
    if workers is None:
        second = model_class.modes_or_nan(nudged)
    else:
        (second,) = workers.call_each(model_class.modes_or_nan, [nudged])
    heights = [model_class.log_density_of_modes(values, modes) for modes in (first, second)]
    nats = float(np.abs(heights[1] - heights[0]).max())
    if nats <= NOISE.said:
        return posterior
    pairs = zip(first, second, strict=True)
    hz = max(float(np.abs(b.frequencies_hz / a.frequencies_hz - 1.0).max()) for a, b in pairs)
    text = (
        f"asked twice at {len(values)} draws, the model answers differently: frequencies differ by "
        f"{hz:.1g} at most (as a fraction) and log-likelihoods by {nats:.1g} nats"
    )
    if nats <= NOISE.most:
        remark = f"{text}, little beside the errors"
        return replace(posterior, remarks=(*posterior.remarks, remark))
    return replace(posterior, failed_checks=(*posterior.failed_checks, text))
