"""Surfaces in space: faces with light shades, and the lines at which they bend or end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray

# Faces that meet at a larger angle have a line between them: those of a mesh on one wall do not,
# nor do those around a column of twelve sides.
BEND = math.radians(35.0)

Corners = NDArray[np.intp]


def by_corners(faces: Sequence[Sequence[int]]) -> Iterator[Corners]:
    """Faces with as many corners each, (n_faces, n_corners) numbers of points."""
    for count in sorted({len(face) for face in faces}):
        yield np.array([face for face in faces if len(face) == count], dtype=np.intp)


def outline(points: FloatArray, faces: Sequence[Sequence[int]]) -> Corners:
    """Sides of faces, pairs (n, 2) of points, at which a surface ends or bends.

    Args:
        points: (n_points, 3).
    """
    sides, normals = [], []
    for corners in by_corners(faces):
        at, following = points[corners], np.roll(corners, -1, axis=1)
        normal = np.cross(at, points[following]).sum(axis=1)  # twice the area, for any polygon
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
        sides.append(np.sort(np.stack([corners, following], axis=2).reshape(-1, 2), axis=1))
        normals.append(np.repeat(normal, corners.shape[1], axis=0))
    if not sides:
        return np.empty((0, 2), dtype=np.intp)
    each, which, count = np.unique(
        np.concatenate(sides), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(which.ravel(), kind="stable")
    of_sides = np.concatenate(normals)[order]
    first = np.cumsum(count) - count
    second = np.minimum(first + 1, len(order) - 1)
    # Elements of shells may be turned over: the sign of a normal means nothing.
    aligned = np.abs(np.einsum("ni,ni->n", of_sides[first], of_sides[second]))
    kept: Corners = each[(count != 2) | (aligned < math.cos(BEND))]
    return kept


def draw_faces(
    ax: Any, points: FloatArray, faces: Sequence[Sequence[int]], alpha: float, colours: Any
) -> None:
    """Faces on axes in three dimensions, as one picture within a drawing.

    Args:
        points: (n_points, 3).
        alpha: from 0, transparent, to 1.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    for corners in by_corners(faces):
        ax.add_collection3d(
            Poly3DCollection(
                points[corners],
                facecolors=colours(corners) if callable(colours) else colours,
                edgecolors="none",
                linewidths=0.0,
                antialiaseds=False,
                alpha=alpha,
                rasterized=True,
            )
        )
