"""Errors of unit shapes as vectors in the planes that touch their sphere."""

from __future__ import annotations

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray


def tangents(at: FloatArray, towards: FloatArray) -> FloatArray:
    """Vectors (..., n) at right angles to a unit shape, towards another and r_φ long.

    The shapes (..., n) have signs that match, r_φ is the distance between them.
    """
    cosine = (at * towards).sum(axis=-1, keepdims=True)
    # What is at right angles is sin t long, and r_φ is 2 sin(t/2).
    vectors: FloatArray = (towards - cosine * at) / np.sqrt(0.5 * (1.0 + cosine))
    return vectors


def turned(vectors: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Vectors (..., n) after the rotation that turns one unit shape into another.

    They are at right angles to ``start`` and come to be so to ``end``.
    """
    along = (vectors * end).sum(axis=-1, keepdims=True)
    cosine = (start * end).sum(axis=-1, keepdims=True)
    rotated: FloatArray = vectors - along / (1.0 + cosine) * (start + end)
    return rotated


def in_common_plane(vectors: FloatArray, shapes: FloatArray) -> FloatArray:
    """Vectors (..., m, n) in the planes at m unit shapes, turned into the one at their mean."""
    sign = np.where((shapes * shapes[..., :1, :]).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    shapes = shapes * sign
    mean = shapes.sum(axis=-2, keepdims=True)
    length = np.sqrt((mean * mean).sum(axis=-1, keepdims=True))
    mean /= np.where(length == 0.0, 1.0, length)  # no sensor sees the mode in any test
    return turned(vectors * sign, shapes, mean)
