"""Axes in three dimensions of one scale, which a structure fills."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.plots.figure_style import GREY, SMALL, TEXT, WIDTH, figure_of, title_of, wrapped
from bayes_ssi.structures.geometry import Geometry

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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


# Inches: the greatest height of a structure, room for ticks and names of axes around it, and for
# a title above and a colour bar and a legend below.
TALLEST, AROUND, ABOVE, BELOW = 4.0, 0.5, 0.3, 1.0
# Above so many lines or markers, they are one picture within a drawing.
MOST_VECTORS = 300


def space_axes(points: FloatArray, unit: str, title: str, ax: Axes | None = None) -> Any:
    """Axes in which all points fit, with the same scale in x, y and z.

    Args:
        points: (n, 3).
        unit: of the coordinates, for the names of the axes; may be empty.
        ax: axes in three dimensions; those of a new figure, as high as it must be, if None.
    """
    own = ax is None
    if ax is None:
        # Without the layout of other figures, in which axes in three dimensions are too small.
        figure = figure_of(None, (WIDTH, WIDTH))
        figure.set_layout_engine("none")
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    drawn: Any = ax
    drawn.computed_zorder = False  # what is drawn later is above
    drawn.set_proj_type("ortho")
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max()) or 1.0
    # A line or a plane needs some depth for its axes.
    half = np.maximum(0.5 * (high - low), 0.1 * longest)
    middle = 0.5 * (low + high)
    drawn.set_box_aspect(tuple(half))
    for i, name in enumerate("xyz"):
        axis = getattr(drawn, f"{name}axis")
        getattr(drawn, f"set_{name}lim")(middle[i] - half[i], middle[i] + half[i])
        axis.set_major_locator(_ticks(name, float(half[i] / half.max()), bool(high[i] > low[i])))
        axis.set_tick_params(pad=-2.0, labelsize=SMALL)
        axis.pane.set_visible(False)
    drawn.grid(visible=False)
    _name_axes(drawn, middle, half, unit)
    if not own:
        title_of(drawn, title)
        return drawn
    text = wrapped(title, WIDTH)
    drawn.figure.suptitle(text, x=0.02, ha="left", fontsize=TEXT, parse_math=False)
    _fill(drawn, middle + half * np.array([*product((-1.0, 1.0), repeat=3)]))
    return drawn


def _name_axes(ax: Any, middle: FloatArray, half: FloatArray, unit: str) -> None:
    """Names next to the axes; matplotlib's own lie far from those of a flat box, or on ticks."""
    in_unit = f" ({unit})" if unit else ""
    for text, corner, ha, va in (
        (f"\n\nx{in_unit}       ", (0, -1, -1), "right", "top"),
        (f"\n     y{in_unit}", (1, 0, -1), "left", "top"),
        (f"z{in_unit}", (1, 1, 1), "center", "bottom"),
    ):
        ax.text(*(middle + half * corner), text, ha=ha, va=va, fontsize=SMALL)


def _ticks(name: str, share: float, has_extent: bool) -> Any:
    """Fewer ticks on a shorter axis, where their labels would overlap."""
    from matplotlib.ticker import MaxNLocator, NullLocator

    if not has_extent:
        return NullLocator()
    # The axis of z begins where that of y ends.
    return MaxNLocator(max(1, round(4 * share)), prune="lower" if name == "z" else None)


def _fill(ax: Any, corners: FloatArray) -> None:
    """Make the box as large as the figure is wide, and the figure as high as the box needs."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    x, y, _ = proj_transform(*corners.T, ax.get_proj())
    on_page = ax.transData.transform(np.column_stack([x, y])) / ax.figure.dpi
    across, up = np.ptp(on_page, axis=0)
    zoom = min((WIDTH - 2.0 * AROUND) / across, TALLEST / up)
    ax.set_box_aspect(tuple(np.ptp(corners, axis=0)), zoom=zoom)
    height = ABOVE + zoom * up + AROUND + BELOW
    ax.figure.set_size_inches(WIDTH, height)
    # The box is in the middle of its axes, a square as wide as the figure.
    bottom = BELOW + AROUND + 0.5 * zoom * up - 0.5 * WIDTH
    ax.set_position((0.0, bottom / height, 1.0, WIDTH / height))


def colour_bar_axes(ax: Any) -> Axes:
    """Axes for a colour bar in the room below those of :func:`space_axes` in their own figure."""
    height = ax.figure.get_figheight()
    bar: Axes = ax.figure.add_axes((0.2, 0.75 / height, 0.6, 0.12 / height))
    return bar


def draw_structure(ax: Any, geometry: Geometry) -> None:
    """The faces and lines of a structure, or its nodes where neither are known."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    nodes = np.array(list(geometry.nodes.values()))
    if not geometry.lines and not geometry.faces:
        ax.scatter(*nodes.T, s=0.6, color=GREY, depthshade=False, rasterized=True)
        return
    number = {node: i for i, node in enumerate(geometry.nodes)}
    faces = [[number[corner] for corner in face] for face in geometry.faces]
    draw_faces(ax, nodes, faces, 0.08, GREY)
    lines = np.array([[number[end] for end in line] for line in geometry.lines], dtype=np.intp)
    segments = nodes[np.concatenate([outline(nodes, faces), lines.reshape(-1, 2)])]
    many = len(segments) > MOST_VECTORS
    ax.add_collection3d(
        Line3DCollection(segments, colors=GREY, linewidths=0.5, alpha=0.5, rasterized=many)
    )
