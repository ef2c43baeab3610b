"""Modes of a structure in three dimensions, deformed, with the structure at rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.plots.figure_style import (
    GREY,
    SMALL,
    figure_of,
    panels_across,
    title_of,
    width_of_panels,
)
from bayes_ssi.plots.space_axes import Corners, draw_faces, outline
from bayes_ssi.results.predictions.nodal_modes import NodalModes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The largest displacement, and the length of the arrows of axes, of the longest side.
LARGEST, ARROW = 0.12, 0.16
# Inches: the height of a panel, and of the title above it.
HEIGHT, TITLE = 2.9, 0.4


class DrawnMode(NamedTuple):
    """A mode of a figure: its title, and its number in the modes, from 0."""

    title: str
    number: int


class _Skeleton(NamedTuple):
    """What is drawn of a structure: points (n, 3), and by their numbers lines and faces."""

    points: FloatArray
    lines: Corners
    faces: Sequence[Sequence[int]]


def can_be_drawn(modes: NodalModes) -> bool:
    """Whether any displacement is at a node with coordinates."""
    known = np.isfinite(modes.positions).all(axis=1)
    return bool(modes.displacements[:, known, :3].any())


def plot_modes_in_space(
    modes: NodalModes, shown: Sequence[DrawnMode], figure: Figure | None = None
) -> Figure:
    """The structure deformed by each mode, its displacements in colour, and its outline at rest.

    Faces of shells and solids are drawn where the geometry has them, else lines, else nodes. The
    largest displacement of each mode is drawn with the same length.

    Args:
        figure: to draw on; a new one if None.
    """
    if not shown or not can_be_drawn(modes):
        raise ValueError("plot_modes_in_space: needs a mode, and coordinates of what moves")
    skeleton, displacements = _skeleton(modes)
    largest = np.abs(displacements).max(axis=(1, 2))
    reach = LARGEST * (float(np.ptp(skeleton.points, axis=0).max()) or 1.0)
    titles = [mode.title for mode in shown]
    figure, panels = panels_in_space(titles, skeleton.points, reach, figure)
    for mode, ax in zip(shown, panels, strict=True):
        shape = displacements[mode.number] / (largest[mode.number] or 1.0)
        _draw(ax, skeleton, reach * shape)
    return figure


def panels_in_space(
    titles: Sequence[str], points: FloatArray, reach: float, figure: Figure | None = None
) -> tuple[Figure, list[Any]]:
    """A figure with a panel in three dimensions for each title, all of one view.

    Args:
        points: (n, 3), to be drawn in every panel.
        figure: to draw on; a new one if None.
    """
    across = panels_across(len(titles))
    down = -(-len(titles) // across)
    figure = figure_of(figure, (width_of_panels(across), down * HEIGHT))
    # Without the layout of other figures, in which axes in three dimensions are too small.
    figure.set_layout_engine("none")
    panels: list[Any] = []
    for i, title in enumerate(titles):
        row, column = divmod(i, across)
        corner = column / across, 1.0 - (row + 1.0) / down
        size = 1.0 / across, (1.0 - TITLE / HEIGHT) / down
        ax: Any = figure.add_axes((*corner, *size), projection="3d")
        ax.computed_zorder = False  # what is drawn later is above
        _frame(ax, points, reach)
        title_of(ax, title)
        panels.append(ax)
    return figure, panels


def _skeleton(modes: NodalModes) -> tuple[_Skeleton, FloatArray]:
    """Nodes with coordinates and what joins them; displacements (n_modes, n_points, 3)."""
    known = np.flatnonzero(np.isfinite(modes.positions).all(axis=1))
    geometry = modes.geometry
    number = {modes.nodes[node]: i for i, node in enumerate(known.tolist())}
    lines = [[number[end] for end in line] for line in geometry.lines] if geometry else []
    faces = [[number[corner] for corner in face] for face in geometry.faces] if geometry else []
    at_rest = np.array(lines, dtype=np.intp).reshape(-1, 2)
    points = modes.positions[known]
    return _Skeleton(points, at_rest, faces), modes.displacements[:, known, :3]


def _draw(ax: Any, skeleton: _Skeleton, moved: FloatArray) -> None:
    from matplotlib import colormaps

    points, lines, faces = skeleton
    scale = colormaps["viridis"]
    size = np.linalg.norm(moved, axis=1)
    size = size / (size.max() or 1.0)
    borders = outline(points, faces)
    _draw_pairs(ax, points[np.concatenate([borders, lines])], GREY, 0.5)
    deformed = points + moved
    if not len(lines) and not faces:
        ax.scatter(*points.T, s=0.6, color=GREY, depthshade=False, rasterized=True)
        ax.scatter(*deformed.T, s=1.5, c=scale(size), depthshade=False, rasterized=True)
    draw_faces(ax, deformed, faces, 0.9, lambda corners: scale(size[corners].mean(axis=1)))
    _draw_pairs(ax, deformed[borders], "black", 0.4)
    _draw_pairs(ax, deformed[lines], scale(size[lines].mean(axis=1)), 1.2)


def _draw_pairs(ax: Any, ends: FloatArray, colours: Any, width: float) -> None:
    """Lines between pairs of points (n, 2, 3)."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    if len(ends):
        ax.add_collection3d(
            Line3DCollection(ends, colors=colours, linewidths=width, rasterized=True)
        )


def _frame(ax: Any, points: FloatArray, reach: float) -> None:
    """Axes of one scale without ticks, and arrows that name them at the lowest corner."""
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    ax.set_proj_type("ortho")
    ax.set_axis_off()
    for name, least, most in zip("xyz", low, high, strict=True):
        getattr(ax, f"set_{name}lim")(least, most)
    ax.set_box_aspect(tuple(high - low), zoom=1.08)
    length = ARROW * float((high - low).max())
    for name, along in zip("xyz", length * np.eye(3), strict=True):
        ax.plot(*np.stack([low, low + along]).T, color=GREY, linewidth=0.8,
                clip_on=False)  # fmt: skip
        ax.text(*(low + 1.25 * along), name, fontsize=SMALL, color=GREY, ha="center", va="center")
