"""Identified modes, the model modes paired with them, and the residuals between them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray, IntArray, row_sums
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData


@dataclass(frozen=True, eq=False)
class PairedModes:
    """Identified modes with the model mode that each is paired with, as arrays.

    P pairs, of which S have a shape that is scored; s sensors.
    """

    modes: tuple[IdentifiedMode, ...]
    model_modes: IntArray  # (P,), counted from 0
    frequencies_hz: FloatArray  # (P,)
    frequency_var: FloatArray  # (P,), identification error squared, as a fraction; 0 if not given
    with_shape: IntArray  # (S,), which pairs
    unit_shapes: FloatArray  # (s, S), 0 where not measured
    measured: FloatArray  # (s, S), 1 where measured and 0 elsewhere
    n_measured: tuple[int, ...]  # (S,)
    shape_var: FloatArray  # (S,), identification error squared; 0 if not given

    @classmethod
    def of(
        cls,
        data: ModalData,
        pairs: Iterable[tuple[str, int]],
        shape_variances: Mapping[int, float] | None = None,
    ) -> "PairedModes":
        """Pairs of a label of an identified mode and a number of a model mode, from 1.

        ``shape_variances`` are those that model modes have of their own, by numbers from 0.
        """
        own, pairs = shape_variances or {}, tuple(pairs)
        further = [own.get(number - 1, 0.0) for _, number in pairs]
        modes = tuple(data.mode(label) for label, _ in pairs)
        sds = [mode.shape_sd or 0.0 for mode in modes]
        with_shape = [i for i, mode in enumerate(modes) if mode.scored_shape is not None]
        shapes = data.unit_shapes[:, [data.labels.index(modes[i].label) for i in with_shape]]
        return cls(
            modes=modes,
            model_modes=np.array([number - 1 for _, number in pairs], dtype=np.intp),
            frequencies_hz=np.array([mode.frequency_hz for mode in modes]),
            frequency_var=np.array([mode.frequency_cov or 0.0 for mode in modes]) ** 2,
            with_shape=np.array(with_shape, dtype=np.intp),
            unit_shapes=np.nan_to_num(shapes),
            measured=np.isfinite(shapes).astype(float),
            n_measured=tuple(modes[i].n_measured for i in with_shape),
            shape_var=np.array([sds[i] * sds[i] + further[i] for i in with_shape]),
        )

    @classmethod
    def joined(
        cls, tests: "Sequence[PairedModes]", n: int, places: Sequence[IntArray]
    ) -> "PairedModes":
        """The pairs of several tests with n sensors, whose shapes are at ``places`` in (S n,)."""
        n_shapes = sum(len(test.with_shape) for test in tests)
        unit, measured = np.zeros((2, n_shapes * n))
        with_shape: list[int] = []
        first = 0
        for test, at in zip(tests, places, strict=True):
            unit[at], measured[at] = test.unit_shapes.T.ravel(), test.measured.T.ravel()
            with_shape += (first + test.with_shape).tolist()
            first += len(test.modes)
        return cls(
            modes=tuple(mode for test in tests for mode in test.modes),
            model_modes=np.concatenate([test.model_modes for test in tests]),
            frequencies_hz=np.concatenate([test.frequencies_hz for test in tests]),
            frequency_var=np.concatenate([test.frequency_var for test in tests]),
            with_shape=np.array(with_shape, dtype=np.intp),
            unit_shapes=unit.reshape(n_shapes, n).T,
            measured=measured.reshape(n_shapes, n).T,
            n_measured=tuple(d for test in tests for d in test.n_measured),
            shape_var=np.concatenate([test.shape_var for test in tests]),
        )

    def identification_covariance(self, data: ModalData) -> FloatArray:
        """Covariance (P + S s, P + S s) of identification errors of ln frequencies and shapes."""
        if data.covariance is None:
            of_shapes = self.shape_var.repeat(len(data.sensors))
            return np.diag(np.concatenate([self.frequency_var, of_shapes]))
        places = np.array([data.labels.index(mode.label) for mode in self.modes], dtype=np.intp)
        m, n = len(data.modes), len(data.sensors)
        shapes = m + n * places[self.with_shape, None] + np.arange(n)
        rows = np.concatenate([places, shapes.ravel()])
        covariance = data.covariance[np.ix_(rows, rows)]
        i = np.arange(len(places), len(rows))
        covariance[i, i] += self.model_shape_var.repeat(n)
        return covariance

    @property
    def model_shape_var(self) -> FloatArray:
        """Variances (S,) that the model modes' shapes have of their own; mostly zero."""
        sds = np.array([self.modes[i].shape_sd or 0.0 for i in self.with_shape])
        return self.shape_var - sds * sds

    def frequency_residuals(self, frequencies_hz: FloatArray) -> FloatArray:
        """r_f = f/f_e - 1, (B, P), for model frequencies (B, n_modes)."""
        return frequencies_hz[:, self.model_modes] / self.frequencies_hz - 1.0

    def shape_distances(self, shapes_at_sensors: FloatArray) -> FloatArray:
        """1 - |φ_e·φ| = ½ r_φ², (B, S), for model shapes (B, s, n_modes)."""
        shapes = shapes_at_sensors[:, :, self.model_modes[self.with_shape]]
        cosine = row_sums(shapes * self.unit_shapes)
        length_sq = row_sums(shapes * shapes * self.measured)
        # A model shape that vanishes at every sensor has no direction.
        with np.errstate(divide="ignore", invalid="ignore"):
            aligned = np.where(length_sq == 0.0, 0.0, np.abs(cosine) / np.sqrt(length_sq))
        return 1.0 - aligned

    def shape_differences(self, shapes_at_sensors: FloatArray) -> FloatArray:
        """φ - φ_e of unit shapes of matching sign, (B, s, S), whose norm over s is r_φ."""
        shapes = shapes_at_sensors[:, :, self.model_modes[self.with_shape]] * self.measured
        length = np.sqrt(row_sums(shapes * shapes))[:, None]
        sign = np.where(row_sums(shapes * self.unit_shapes) < 0, -1.0, 1.0)[:, None]
        return shapes * (sign / np.where(length == 0.0, 1.0, length)) - self.unit_shapes

    def unit_model_shapes(self, shapes_at_sensors: FloatArray) -> FloatArray:
        """Unit model shapes φ with the sign of φ_e, (B, S s), 0 where not measured."""
        shapes = self.shape_differences(shapes_at_sensors) + self.unit_shapes
        return shapes.transpose(0, 2, 1).reshape(len(shapes), self.unit_shapes.size)

    def unit_shapes_like(self, columns: IntArray, shapes: FloatArray) -> FloatArray:
        """Shapes (s, E) as :meth:`unit_model_shapes` has them, (E, s), beside one shape each."""
        seen = (shapes * self.measured[:, columns]).T
        length = np.sqrt(row_sums(seen * seen))[:, None]
        sign = np.where(row_sums(seen * self.unit_shapes.T[columns]) < 0, -1.0, 1.0)[:, None]
        return np.asarray(seen * (sign / np.where(length == 0.0, 1.0, length)))


def check_pairing(pairing: Mapping[str, int], data: ModalData, n_modes: int) -> None:
    """Refuse a pairing that is not one to one between modes that exist."""
    if not isinstance(pairing, Mapping):
        raise TypeError(
            "pairing must map labels of identified modes to numbers of model modes, or be "
            f"'any', got {pairing!r}"
        )
    first: dict[int, str] = {}
    require_known("pairing: no identified mode", pairing, data.labels)
    for label, number in pairing.items():
        whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
        if not whole or not 1 <= number <= n_modes:
            raise ValueError(
                f"pairing: identified mode {label!r} is paired with model mode {number!r}; "
                f"the structure has modes 1 to {n_modes}"
            )
        if first.setdefault(number, label) != label:
            raise ValueError(
                f"pairing: model mode {number} is paired with two identified modes, "
                f"{first[number]!r} and {label!r}"
            )
