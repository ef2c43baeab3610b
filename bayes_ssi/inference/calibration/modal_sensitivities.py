"""Sensitivities of modes to parameters, and which parameters the data can tell apart.

The paper's section 4.5 chooses updating parameters by sensitivities (its Figure 7). A proposal here
follows from the residuals' Jacobian J over their standard errors, in prior standard deviations: one
by one the parameter is taken whose column is the longest once those already taken are projected out
(QR with pivoting; Golub, Klema and Stewart 1976). Its length is the signal over the noise that is
left of it; below 1 the prior knows more.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.inference.calibration.least_squares import (
    DIFFERENCE_STEP,
    CalibrationProblem,
    difference_quotients,
)
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.model_class.model_class import ModelClass


@dataclass(frozen=True, eq=False, repr=False)
class ModalSensitivities(Displayed):
    """How much the paired modes of a class change with its parameters, at one point.

    Attributes:
        name: of the model class.
        modes: (m,) labels of the paired modes, with their configurations.
        parameters: (p,) names.
        of_frequencies: (m, p) percent by which a frequency rises where a parameter does by one.
        of_shapes: (m, p) length in percent of the change of a unit shape at the sensors, likewise.
        signals: (p,) over the noise, each beside those taken before it, the largest first.
        order: (p,) the parameters in that order.
    """

    name: str
    modes: tuple[str, ...]
    parameters: tuple[str, ...]
    of_frequencies: FloatArray
    of_shapes: FloatArray
    signals: tuple[float, ...]
    order: tuple[str, ...]

    @property
    def proposed(self) -> tuple[str, ...]:
        """The parameters that the data know better than the prior, beside one another."""
        return tuple(
            name for name, signal in zip(self.order, self.signals, strict=True) if signal > 1.0
        )

    def _line(self) -> str:
        modes = counted(len(self.modes), "mode")
        return f"of {self.name!r}: {modes}, {counted(len(self.parameters), 'parameter')}"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"mode": mode} | dict(zip(self.parameters, row.tolist(), strict=True))
            for mode, row in zip(self.modes, self.of_frequencies, strict=True)
        ]


@checked
def modal_sensitivities(model_class: ModelClass) -> ModalSensitivities:
    """Sensitivities of the paired modes to the structures' parameters, at the prior medians.

    Args:
        model_class: its pairing must be given; those of all configurations count. Its error model
            gives the weight of shapes in the proposal, and other ``priors`` another point.

    Raises:
        NothingToCalibrateError: no mode is paired, a pairing is inferred, or the structures have no
            parameter.
        ValueError: a prior median is zero.

    >>> frame = bs.ShearBuilding((1.0, 1.0), 2 * (bs.Parameter("k", bs.LogNormal(40.0, 0.3)),))
    >>> modes = bs.ModalData((bs.IdentifiedMode("1", 0.622),), band_hz=(0.0, 1.0))
    >>> found = bs.modal_sensitivities(bs.ModelClass("frame", frame, modes, pairing={"1": 1}))
    >>> found.of_frequencies.round(3)
    array([[0.5]])
    """
    problem = CalibrationProblem(model_class, model_class.error.shape_weight)
    values = problem.prior_medians
    zero = [name for name, value in zip(problem.names, values, strict=True) if value == 0.0]
    if zero:
        raise ValueError(
            f"modal_sensitivities: the prior median of {zero[0]!r} is zero, and relative changes "
            "of it are not defined"
        )

    labels: list[str] = []
    frequencies, changes = [], []
    steps = DIFFERENCE_STEP * np.eye(len(values))  # of ln θ
    for configuration, likelihood, modes in problem.modes(
        values * np.exp(np.concatenate([steps, -steps]))
    ):
        pairs = likelihood.pairs
        labels += [label_in(configuration.name, mode.label) for mode in pairs.modes]
        slopes = difference_quotients(np.log(modes.frequencies_hz[:, pairs.model_modes]))
        frequencies.append(slopes.T)
        shapes = likelihood.shapes_at_sensors(modes)[:, :, pairs.model_modes]
        lengths = np.linalg.norm(shapes, axis=1, keepdims=True)
        # A shape's sign is nobody's; that of the first row goes for all.
        signs = np.where((shapes * shapes[:1]).sum(1, keepdims=True) < 0.0, -1.0, 1.0)
        shapes = shapes * signs / np.maximum(lengths, np.finfo(float).tiny)
        changes.append(np.linalg.norm(difference_quotients(shapes), axis=1).T)
    # In prior standard deviations, at the prior medians, too.
    jacobian = problem.sensitivities(np.zeros(len(values)))
    triangle, order = scipy.linalg.qr(jacobian, mode="r", pivoting=True)
    signals = np.zeros(len(values))
    signals[: min(triangle.shape)] = np.abs(triangle.diagonal())
    return ModalSensitivities(
        model_class.name,
        tuple(labels),
        problem.names,
        np.concatenate(frequencies),
        np.concatenate(changes),
        tuple(signals.tolist()),
        tuple(problem.names[i] for i in order),
    )
