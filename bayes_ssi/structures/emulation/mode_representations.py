"""Modes as smooth functions of the parameters, also where they cross or veer.

In ascending order, modes are not smooth: where two of them cross they change places, and where
they nearly do (veering) they exchange their shapes within a short distance. Two representations
are smooth there:

* the logarithm of the modal operator, H = C ln(Λ) C⁻¹, whose eigenvalues and eigenvectors are the
  modes. C = W Φ are coordinates of the shapes in the space of reference shapes, and Ψ = Φ C⁻¹ are
  the shapes that belong to them. Order, signs and scales of the modes cancel out, so crossings and
  veering are exact. It needs no fewer degrees of freedom than modes;
* modes tracked one by one by their shapes and frequencies, which is right at crossings.

Shapes are at unit length, so that each mode counts as much; of close modes that turn together, both
have about the same modal mass at it.

Either encodes the modes at points (N, d) as vectors (N, n_outputs), says how much each output
counts where the lowest ``n_needed`` modes are needed, and decodes vectors into modes in ascending
order, row by row.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.emulation.gaussian_process import trend_terms
from bayes_ssi.structures.modal import Modes, settle

# Coordinates of shapes are useless where their condition number is larger: shapes then hardly
# resemble the reference shapes.
WORST_CONDITION = 1e3
# Modes are told apart by 1 - MAC and by frequencies: a difference of this share counts like
# orthogonal shapes.
FREQUENCY_STEP = 0.1
# Shapes at unit length are usually known five times less precisely than frequencies.
SHAPE_WEIGHT = 0.2
# Weight of modes that are not needed, which should not decide how smooth the others are.
NOT_NEEDED = 0.01


@dataclass(frozen=True)
class ModalOperator:
    """ln of the modal operator in coordinates of the shapes at the first point.

    It does not suit fewer degrees of freedom than modes, or shapes unlike those of the first point.
    """

    n_dof: int
    n_modes: int

    def encoded(self, x: FloatArray, modes: Modes) -> FloatArray | None:  # noqa: ARG002
        if self.n_dof < self.n_modes:
            return None
        shapes = unit_shapes(modes.shapes)
        coordinates = np.einsum("md,ndk->nmk", np.linalg.pinv(shapes[0]), shapes)
        if not np.linalg.cond(coordinates).max() < WORST_CONDITION:
            return None
        inverse = np.linalg.inv(coordinates)
        operators = np.einsum("nij,nj,njk->nik", coordinates, np.log(modes.frequencies_hz), inverse)
        parts = (operators, shapes @ inverse)
        return np.hstack([part.reshape(len(shapes), -1) for part in parts])

    def weights(self, vectors: FloatArray, n_needed: int) -> FloatArray:  # noqa: ARG002
        return np.repeat([1.0, SHAPE_WEIGHT], [self.n_modes**2, self.n_dof * self.n_modes])

    def decoded(self, vectors: FloatArray) -> Modes:
        n, n_operator = self.n_modes, self.n_modes**2
        operators = vectors[:, :n_operator].reshape(-1, n, n)
        of_coordinates = vectors[:, n_operator:].reshape(len(vectors), self.n_dof, n)
        # Not symmetric, so errors can make a close pair complex; the real part of one and the
        # imaginary part of the other span its plane.
        logs, coordinates = np.linalg.eig(operators)
        second = np.imag(logs)[:, None] < 0.0
        coordinates = np.where(second, np.imag(coordinates), np.real(coordinates))
        shapes = np.einsum("bdm,bmk->bdk", of_coordinates, coordinates)
        return ascending(np.exp(np.real(logs)), shapes)


@dataclass(frozen=True)
class TrackedModes:
    """Logarithms of frequencies, and shapes at unit length, each mode followed across crossings."""

    n_dof: int
    n_modes: int

    def encoded(self, x: FloatArray, modes: Modes) -> FloatArray:
        logs, shapes = np.log(modes.frequencies_hz), unit_shapes(modes.shapes)
        order = np.argsort(((x - x[0]) ** 2).sum(axis=1), kind="stable")  # outwards
        for position, row in enumerate(order[1:], 1):
            known = order[:position]
            nearest = known[((x[known] - x[row]) ** 2).sum(axis=1).argmin()]
            # Without shapes, or with the same ones twice, frequencies keep their order.
            logs[row], shapes[row] = _matched(
                logs[row], shapes[row], logs[nearest], shapes[nearest]
            )
        q, _ = np.linalg.qr(trend_terms(x, len(x)))  # for fits of first or second degree
        for _ in range(3):  # again, by what the others expect; it settles in one or two
            of_others = q @ (q.T @ np.hstack([logs, shapes.reshape(len(x), -1)]))
            expected_shapes = of_others[:, self.n_modes :].reshape(shapes.shape)
            for row in range(len(x)):
                logs[row], shapes[row] = _matched(
                    logs[row], shapes[row], of_others[row, : self.n_modes], expected_shapes[row]
                )
        return np.hstack([logs, shapes.reshape(len(x), -1)])

    def weights(self, vectors: FloatArray, n_needed: int) -> FloatArray:
        # The last half are where the posterior lies, once there are any.
        rank = vectors[len(vectors) // 2 :, : self.n_modes].argsort(axis=1).argsort(axis=1)
        needed = (rank < n_needed).mean(axis=0) > 0.05
        of_modes = np.where(needed, 1.0, NOT_NEEDED)
        return np.concatenate([of_modes, SHAPE_WEIGHT * np.tile(of_modes, self.n_dof)])

    def decoded(self, vectors: FloatArray) -> Modes:
        shapes = vectors[:, self.n_modes :].reshape(len(vectors), self.n_dof, self.n_modes)
        return ascending(np.exp(vectors[:, : self.n_modes]), shapes)


def unit_shapes(shapes: FloatArray) -> FloatArray:
    """Shapes (N, n_dof, n_modes) at unit length; zero where a mode does not move."""
    lengths = np.sqrt((shapes**2).sum(axis=1, keepdims=True))
    return np.asarray(shapes / np.where(lengths > 0.0, lengths, 1.0))


def ascending(frequencies_hz: FloatArray, shapes: FloatArray) -> Modes:
    """Modes in ascending order of frequency, those of equal frequency as of a solved structure."""
    order = np.argsort(frequencies_hz, axis=1, kind="stable")
    modes = Modes(
        np.take_along_axis(frequencies_hz, order, axis=1),
        np.take_along_axis(shapes, order[:, None, :], axis=2),
    )
    settle(*modes)
    return modes


def _matched(
    logs: FloatArray, shapes: FloatArray, expected: FloatArray, expected_shapes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Modes in the order and with the signs of those that are expected."""
    products = expected_shapes.T @ shapes
    lengths = np.sqrt((expected_shapes**2).sum(axis=0))
    products = products / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    distance = (logs - expected[:, None]) / FREQUENCY_STEP
    _, order = linear_sum_assignment(1.0 - products**2 + distance**2)
    signs = np.sign(products[np.arange(len(order)), order])
    return logs[order], shapes[:, order] * np.where(signs == 0.0, 1.0, signs)


Representation = ModalOperator | TrackedModes
