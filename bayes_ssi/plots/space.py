"""Structures in three dimensions, in axes of one scale."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import ArrayLike, NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.plots import figure_style as look
from bayes_ssi.structures.geometry import Geometry

Corners = NDArray[np.intp]


def numbered(geometry: Geometry) -> tuple[Corners, list[list[int]]]:
    """Lines (n, 2) and faces by the numbers of their nodes."""
    number = {node: i for i, node in enumerate(geometry.nodes)}
    ends = np.array([[number[end] for end in line] for line in geometry.lines], dtype=np.intp)
    return ends.reshape(-1, 2), [[number[corner] for corner in face] for face in geometry.faces]


def longest_side(points: ArrayLike) -> float:
    """Of the box around points (n, 3); 1 where they are one point."""
    return float(np.ptp(points, axis=0).max()) or 1.0


def axes_in_space(
    ax: Any,
    title: str,
    points: FloatArray,
    reach: float,
    geometry: Geometry | None,
    below: float = 0.0,
) -> Any:
    """Axes of one scale around ``points`` (n, 3), with the structure if it is known.

    Those given, or those of a new figure with ``below`` inches below them. All points fit, with
    room of ``reach`` around them; arrows at the lowest corner name the axes.
    """
    if ax is None:
        panel, above = 2.9, 0.4  # inches: height of the axes, and of the title above them
        height = panel + below
        figure = look.figure_of(None, (look.FIGURE_WIDTH, height))
        # Without the layout of other figures, in which axes in three dimensions are too small.
        figure.set_layout_engine("none")
        ax = figure.add_axes((0.0, below / height, 1.0, (panel - above) / height), projection="3d")
    # Parallel lines stay parallel, and what is drawn later is above.
    ax.computed_zorder = False
    ax.set_proj_type("ortho")
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    ax.set_axis_off()
    for name, least, most in zip("xyz", low, high, strict=True):
        getattr(ax, f"set_{name}lim")(least, most)
    ax.set_box_aspect(tuple(high - low), zoom=1.08)
    length = 0.16 * float((high - low).max())
    for name, along in zip("xyz", length * np.eye(3), strict=True):
        ax.plot(*np.stack([low, low + along]).T, color=look.GREY, linewidth=0.8,
                clip_on=False)  # fmt: skip
        ax.text(
            *(low + 1.25 * along),
            name,
            fontsize=look.SMALL_TEXT,
            color=look.GREY,
            ha="center",
            va="center",
        )
    look.title_of(ax, title)
    if geometry is not None:
        _draw_structure(ax, geometry)
    return ax


def _draw_structure(ax: Any, geometry: Geometry) -> None:
    """The faces and lines of a structure, or its nodes where neither are known."""
    nodes = np.array(list(geometry.nodes.values()))
    if not geometry.lines and not geometry.faces:
        ax.scatter(*nodes.T, s=0.6, color=look.GREY, depthshade=False, rasterized=True)
        return
    lines, faces = numbered(geometry)
    flat = {"linewidths": 0.0, "edgecolors": "none", "antialiaseds": False, "rasterized": True}
    for corners in by_corners(faces):
        ax.add_collection3d(
            Poly3DCollection(nodes[corners], facecolors=look.GREY, alpha=0.08, **flat)
        )
    pairs = np.concatenate([outline(nodes, faces), lines])
    if len(pairs):
        drawn = Line3DCollection(nodes[pairs], colors=look.GREY, linewidths=0.5, alpha=0.5)
        drawn.set_rasterized(len(pairs) > look.MOST_VECTORS)
        ax.add_collection3d(drawn)


def by_corners(faces: Sequence[Sequence[int]]) -> Iterator[Corners]:
    """Faces with as many corners each, (n_faces, n_corners) numbers of points."""
    for count in sorted({len(face) for face in faces}):
        yield np.array([face for face in faces if len(face) == count], dtype=np.intp)


def outline(points: FloatArray, faces: Sequence[Sequence[int]]) -> Corners:
    """Sides of faces, pairs (n, 2) of ``points`` (n_points, 3), where a surface ends or bends."""
    sides, normals = [], []
    for corners in by_corners(faces):
        at, following = points[corners], np.roll(corners, -1, axis=1)
        normal = np.cross(at, points[following]).sum(axis=1)  # twice the area, for any polygon
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
        sides.append(np.sort(np.stack([corners, following], axis=2).reshape(-1, 2), axis=1))
        normals.append(np.repeat(normal, corners.shape[1], axis=0))
    if not sides:
        return np.empty((0, 2), dtype=np.intp)
    sides_once, which, count = np.unique(
        np.concatenate(sides), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(which.ravel(), kind="stable")
    of_sides = np.concatenate(normals)[order]
    first = np.cumsum(count) - count
    second = np.minimum(first + 1, len(order) - 1)
    # Elements of shells may be turned over: the sign of a normal means nothing.
    aligned = np.abs(np.einsum("ni,ni->n", of_sides[first], of_sides[second]))
    # Faces that meet at a larger angle have a line between them: those of a mesh on one wall do
    # not, nor do those around a column of twelve sides.
    return sides_once[(count != 2) | (aligned < math.cos(math.radians(35.0)))]
