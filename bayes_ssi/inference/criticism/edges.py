"""Where a posterior lies at the edge of a setting: of a parameter's prior, or of the band.

There the result depends on the setting besides the data. By how much, only a ranking can say, in
which the setting is moved for all classes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.criticism.misfit import CRITICISM
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.resampling import evenly_spaced_indices


@dataclass(frozen=True)
class AtEdge:
    """Most of a posterior lies at the edge of a setting."""

    statement: str
    end: int
    parameter: str | None = None  # name of the parameter whose prior it is; None for the band
    configuration: str | None = None  # name of the configuration whose band it is; None for a prior


def edges(model_class: ModelClass, z: FloatArray, frequencies_hz: FloatArray) -> list[AtEdge]:
    """The edges at which a posterior lies.

    Args:
        z: draws from its posterior (n, d).
        frequencies_hz: model frequencies at the draws (n, n_modes), all configurations in turn.
    """
    return [*_prior_edges(model_class, z), *_band_edges(model_class, z, frequencies_hz)]


def _prior_edges(model_class: ModelClass, z: FloatArray) -> Iterator[AtEdge]:
    edge = CRITICISM.prior_edge
    for column, parameter in enumerate(model_class.parameters):
        for end, beyond in enumerate((z[:, column] < -edge, z[:, column] > edge)):
            if beyond.mean() > CRITICISM.edge_share:
                statement = (
                    f"parameter {parameter.name!r}: {100 * beyond.mean():.0f} % of the posterior "
                    f"lies at the {('lower', 'upper')[end]} edge of its prior, "
                    f"{parameter.prior!r}, where only one in a thousand prior draws lies"
                )
                yield AtEdge(statement, end, parameter=parameter.name)


def _band_edges(
    model_class: ModelClass, z: FloatArray, frequencies_hz: FloatArray
) -> Iterator[AtEdge]:
    # The standard error of a share estimated from a thousand draws is 0.016 at most.
    chosen = evenly_spaced_indices(len(z), 1000)
    different, first, times = np.unique(z[chosen], axis=0, return_index=True, return_counts=True)
    remaining = frequencies_hz[chosen[first]]
    for configuration, likelihood, values in model_class.parts(model_class.values(different)):
        band = configuration.data.band_hz
        where = f"configuration {configuration.name!r}: " if configuration.name else ""
        n_modes = configuration.structure.n_modes
        frequencies, remaining = remaining[:, :n_modes], remaining[:, n_modes:]
        shares = times @ likelihood.at_band_edge(values, frequencies) / len(chosen)
        for mode, share in enumerate(shares, start=1):
            if share > CRITICISM.edge_share:
                middle = float(np.median(frequencies[:, mode - 1]))
                statement = (
                    f"{where}model mode {mode} is paired with nothing and lies at the edge of the "
                    f"band {band[0]:g} to {band[1]:g} Hz in {100 * share:.0f} % of the posterior: "
                    "whether it counts as missed depends on where the band ends"
                )
                end = int(abs(middle - band[1]) < abs(middle - band[0]))
                yield AtEdge(statement, end, configuration=configuration.name)
