"""The model at one point in the space of parameters, compared with the identified modes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.structures.modal import Modes, mac


@dataclass(frozen=True)
class ModeFit:
    """One identified mode and the model mode paired with it.

    Attributes:
        configuration: the test in which it was identified; empty where there is only one.
        label: label of the identified mode.
        model_mode: number of the model mode, from 1.
        identified_hz: identified frequency.
        model_hz: model frequency.
        mac: MAC between the two shapes; NaN where none was identified.
    """

    configuration: str
    label: str
    model_mode: int
    identified_hz: float
    model_hz: float
    mac: float


@dataclass(frozen=True)
class Fit:
    """The model at one point in the space of parameters.

    Attributes:
        values: parameter values, in the order of the calibration's ``parameter_names``.
        objective: f_ob, a fraction.
        distance: RMS distance d from the prior medians, by which every parameter is divided.
        modes: the paired modes.
    """

    values: tuple[float, ...]
    objective: float
    distance: float
    modes: tuple[ModeFit, ...]


@checked
def rms_distance(values: Mapping[str, float], reference: Mapping[str, float]) -> float:
    """RMS difference of normalised parameters, the d of the paper's Table 1 and section 4.5.

    Args:
        values: parameter name → value divided by its nominal value.
        reference: normalised values from which the distance is measured; the mean is over its
            parameters, including those that were not updated and are 1 in both.

    Raises:
        ValueError: there is no parameter in ``reference``, or one is missing in ``values``.
    """
    missing = [name for name in reference if name not in values]
    if missing:
        raise ValueError(f"rms_distance: no value of parameter {missing[0]!r}")
    if not reference:
        raise ValueError("rms_distance: the reference has no parameter")
    squares = [(values[name] - number) ** 2 for name, number in reference.items()]
    return math.sqrt(sum(squares) / len(squares))


def mode_fits(
    configuration: Configuration, likelihood: ModalLikelihood, modes: Modes
) -> list[ModeFit]:
    """The paired modes of one configuration, identified and of the model at one point."""
    data = configuration.data
    criteria = mac(data.unit_shapes, likelihood.shapes_at_sensors(modes)[0])
    return [
        ModeFit(
            configuration=configuration.name,
            label=label,
            model_mode=number,
            identified_hz=data.mode(label).frequency_hz,
            model_hz=float(modes.frequencies_hz[0, number - 1]),
            mac=float(criteria[data.labels.index(label), number - 1])
            if data.mode(label).scored_shape is not None
            else math.nan,
        )
        for label, number in likelihood.pairing.items()
    ]
