"""Structures in three dimensions, in axes of one scale: at rest, and deformed by their modes."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import ArrayLike, NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.plots.figure_style import (
    GREY,
    MOST_VECTORS,
    SMALL_TEXT,
    figure_of,
    panels_across,
    title_of,
    width_of_panels,
)
from bayes_ssi.results.predictions.nodal_modes import NodalModes
from bayes_ssi.structures.geometry import Geometry

Corners = NDArray[np.intp]


def can_be_drawn(modes: NodalModes) -> bool:
    """Whether any displacement is at a node with coordinates."""
    return bool(modes.displacements[:, _located(modes), :3].any())


def _located(modes: NodalModes) -> NDArray[np.intp]:
    """The nodes with coordinates."""
    return np.flatnonzero(np.isfinite(modes.positions).all(axis=1))


def plot_modes_in_space(modes: NodalModes, pairing: Mapping[str, int]) -> Figure:
    """The structure deformed by each paired mode, in colour, and its outline at rest.

    Faces of shells and solids are drawn where the geometry has them, else lines, else nodes. The
    largest displacement of each mode is drawn with the same length.
    """
    if not pairing or not can_be_drawn(modes):
        raise ValueError("plot_modes_in_space: needs a mode, and coordinates of what moves")
    known, geometry = _located(modes), modes.geometry
    points, displacements = modes.positions[known], modes.displacements[:, known, :3]
    number = {modes.nodes[node]: i for i, node in enumerate(known.tolist())}
    lines, faces = _numbered(geometry, number)
    largest = np.abs(displacements).max(axis=(1, 2))
    # The largest displacement drawn, of the longest side.
    reach = 0.12 * longest_side(points)
    hz = modes.frequencies_hz
    titles = [f"mode {label}\n{hz[i - 1]:.4g} Hz" for label, i in pairing.items()]
    figure, panels = panels_in_space(titles, points, reach)
    for i, ax in zip(pairing.values(), panels, strict=True):
        shape = displacements[i - 1] / (largest[i - 1] or 1.0)
        _draw_deformed(ax, points, lines, faces, reach * shape)
    return figure


def _numbered(
    geometry: Geometry | None, number: Mapping[str, int]
) -> tuple[Corners, list[list[int]]]:
    """Lines (n, 2) and faces by the numbers of their nodes."""
    lines, faces = (geometry.lines, geometry.faces) if geometry else ((), ())
    ends = np.array([[number[end] for end in line] for line in lines], dtype=np.intp)
    return ends.reshape(-1, 2), [[number[corner] for corner in face] for face in faces]


def _draw_deformed(
    ax: Any, points: FloatArray, lines: Corners, faces: Sequence[Sequence[int]], moved: FloatArray
) -> None:

    scale = colormaps["viridis"]
    size = np.linalg.norm(moved, axis=1)
    size = size / (size.max() or 1.0)
    borders = outline(points, faces)
    _draw_lines(ax, points[np.concatenate([borders, lines])], GREY, 0.5)
    deformed = points + moved
    if not len(lines) and not faces:
        ax.scatter(*points.T, s=0.6, color=GREY, depthshade=False, rasterized=True)
        ax.scatter(*deformed.T, s=1.5, c=scale(size), depthshade=False, rasterized=True)
    draw_faces(ax, deformed, faces, 0.9, lambda corners: scale(size[corners].mean(axis=1)))
    _draw_lines(ax, deformed[borders], "black", 0.4)
    _draw_lines(ax, deformed[lines], scale(size[lines].mean(axis=1)), 1.2)


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
    """The axes given, or those of a new figure, around ``points``, with the structure if known.

    ``reach`` and ``below`` are as in :func:`panels_in_space`.
    """
    if ax is None:
        _, (ax,) = panels_in_space([title], points, reach, below=below)
    else:
        frame_in_space(ax, title, points, reach)
    if geometry is not None:
        draw_structure(ax, geometry)
    return ax


def panels_in_space(
    titles: Sequence[str],
    points: FloatArray,
    reach: float,
    figure: Figure | None = None,
    below: float = 0.0,
) -> tuple[Figure, list[Any]]:
    """A figure with a panel in three dimensions for each title, all of one view.

    All ``points`` (n, 3) fit in every panel, with room of ``reach`` around them, and of ``below``
    inches below all panels.
    """
    panel, above = 2.9, 0.4  # inches: height of a panel, and of the title above it
    across = panels_across(len(titles))
    down = -(-len(titles) // across)
    height = down * panel + below
    figure = figure_of(figure, (width_of_panels(across), height))
    # Without the layout of other figures, in which axes in three dimensions are too small.
    figure.set_layout_engine("none")
    panels: list[Any] = []
    for i, title in enumerate(titles):
        row, column = divmod(i, across)
        corner = column / across, 1.0 - (row + 1.0) * panel / height
        size = 1.0 / across, (panel - above) / height
        ax: Any = figure.add_axes((*corner, *size), projection="3d")
        frame_in_space(ax, title, points, reach)
        panels.append(ax)
    return figure, panels


def frame_in_space(ax: Any, title: str, points: FloatArray, reach: float) -> None:
    """Axes of one scale without ticks, and arrows that name them at the lowest corner."""
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
        ax.plot(*np.stack([low, low + along]).T, color=GREY, linewidth=0.8,
                clip_on=False)  # fmt: skip
        ax.text(
            *(low + 1.25 * along), name, fontsize=SMALL_TEXT, color=GREY, ha="center", va="center"
        )
    title_of(ax, title)


def draw_structure(ax: Any, geometry: Geometry) -> None:
    """The faces and lines of a structure, or its nodes where neither are known."""
    nodes = np.array(list(geometry.nodes.values()))
    if not geometry.lines and not geometry.faces:
        ax.scatter(*nodes.T, s=0.6, color=GREY, depthshade=False, rasterized=True)
        return
    number = {node: i for i, node in enumerate(geometry.nodes)}
    lines, faces = _numbered(geometry, number)
    draw_faces(ax, nodes, faces, 0.08, GREY)
    pairs = np.concatenate([outline(nodes, faces), lines])
    _draw_lines(ax, nodes[pairs], GREY, 0.5, alpha=0.5, rasterized=len(pairs) > MOST_VECTORS)


def _draw_lines(
    ax: Any, ends: FloatArray, colours: Any, width: float, *, alpha: float | None = None,
    rasterized: bool = True,
) -> None:  # fmt: skip
    """Lines between pairs of points (n, 2, 3)."""

    if len(ends):
        ax.add_collection3d(
            Line3DCollection(
                ends, colors=colours, linewidths=width, alpha=alpha, rasterized=rasterized
            )
        )


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


def draw_faces(
    ax: Any, points: FloatArray, faces: Sequence[Sequence[int]], alpha: float, colours: Any
) -> None:
    """Faces between ``points`` (n_points, 3), as one picture within a drawing."""

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
