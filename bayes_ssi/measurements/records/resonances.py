"""Modes without errors, and how they respond over the blocks of a band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.spectra import LocalSpectra


class Resonances(NamedTuple):
    """m modes without errors in r directions or n channels."""

    frequencies_hz: FloatArray  # (m,)
    dampings: FloatArray  # (m,), fractions of critical damping
    shapes: NDArray[Any]  # (r, m), complex or real, at unit length

    @classmethod
    def none(cls, n: int) -> Resonances:
        """No modes of n channels."""
        return cls(np.empty(0), np.empty(0), np.empty((n, 0), dtype=complex))

    @property
    def n_modes(self) -> int:
        """m"""
        return len(self.frequencies_hz)

    def at(self, places: Sequence[int]) -> Resonances:
        """Some of the modes."""
        chosen = list(places)
        return Resonances(
            self.frequencies_hz[chosen], self.dampings[chosen], self.shapes[:, chosen]
        )

    def without(self, *places: int) -> Resonances:
        """The other modes."""
        return self.at([i for i in range(self.n_modes) if i not in places])

    def joined(self, others: Resonances) -> Resonances:
        """These modes and others, in ascending order."""
        both = self.beside(others)
        return both.at(np.argsort(both.frequencies_hz, kind="stable").tolist())

    def beside(self, others: Resonances) -> Resonances:
        """These modes, and then the others."""
        return Resonances(*(
            np.concatenate([a, b], axis=-1) for a, b in zip(self, others, strict=True)
        ))  # fmt: skip

    @property
    def half_widths_hz(self) -> FloatArray:
        """Half of the half-power bandwidths, ζ f (m,)."""
        return self.dampings * self.frequencies_hz

    def in_directions(self, data: LocalSpectra) -> Resonances:
        """Modes of all channels in the directions of a band, at unit length, turned."""
        shapes = data.from_channels @ self.shapes
        lengths = np.maximum(np.linalg.norm(shapes, axis=0), np.finfo(float).tiny)
        return self._replace(shapes=turned(shapes / lengths))

    def responses(self, data: LocalSpectra) -> ComplexArray:
        """Means of h = 1 / (1 - β² - 2i ζ β) over the blocks (K, m), β the mode's f over f."""
        return self.response_slopes(data)[0]

    def response_slopes(
        self, data: LocalSpectra
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Means of h over the blocks, and their derivatives by ln f and ln ζ, (K, m) each."""
        f, zeta = self.frequencies_hz, self.dampings.clip(1e-6, 0.99)
        root = np.sqrt(1.0 - zeta**2)
        p, conjugate = f * (1j * zeta + root), f * (1j * zeta - root)
        # h = f² / ((f - p)(f - p')) = 1 + [p² / (f - p) - p'² / (f - p')] / (p - p')
        centres, halves = data.frequencies_hz[:, None], 0.5 * data.widths_hz[:, None]

        def term(pole: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
            """p² times the mean of 1 / (f - p), and its derivative by p."""
            low, high = centres - halves - pole, centres + halves - pole
            mean = np.log(high / low) / (2.0 * halves)
            return pole**2 * mean, 2.0 * pole * mean + pole**2 / (low * high)

        (a, a_slope), (b, b_slope) = term(p), term(conjugate)
        apart = p - conjugate
        h = 1.0 + (a - b) / apart

        def slope(of_p: ComplexArray, of_conjugate: ComplexArray) -> ComplexArray:
            change = a_slope * of_p - b_slope * of_conjugate
            return (change - (h - 1.0) * (of_p - of_conjugate)) / apart

        by_zeta = zeta * f
        return (
            h,
            slope(p, conjugate),
            slope(by_zeta * (1j - zeta / root), by_zeta * (1j + zeta / root)),
        )


def block_hankel(blocks: NDArray[Any], n: int) -> NDArray[Any]:
    """The matrix (n r, n r) whose block in row i and column j is i + j of blocks (..., r, r)."""
    r = blocks.shape[1]
    at = np.arange(n)[:, None] + np.arange(n)
    return blocks[at].transpose(0, 2, 1, 3).reshape(n * r, n * r)


def turned(shapes: ComplexArray) -> ComplexArray:
    """Shapes (n,) or (n, m) at the phase at which their real parts are longest."""
    return np.asarray(shapes * np.exp(-0.5j * np.angle((shapes**2).sum(0))))


def real_shapes(shapes: NDArray[Any]) -> FloatArray:
    """The real parts of turned shapes (n, m), at unit length, the largest component positive."""
    real = turned(shapes).real
    return with_positive_largest(real / np.sqrt((real**2).sum(0)))[0]


def with_positive_largest(shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shapes (n, m) with the largest component positive, and the signs (m,) that they took."""
    largest = np.abs(shapes).argmax(0)
    signs = np.sign(shapes[largest, np.arange(shapes.shape[1])])
    return shapes * signs, signs
