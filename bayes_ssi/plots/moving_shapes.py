"""Mode shapes that move: the scenes that a page's script draws, and the page.

A scene is a record: nodes at rest, the lines and faces between them, and mode by mode how far
every node moves, with the model's and the measured motion at the sensors. The largest displacement
of the main structure is 1.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import ArrayLike, NDArray

from bayes_ssi.foundations.arrays import FloatArray, evenly_spaced_indices
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.model_at_draws import ConfigurationModes
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots import figure_style as look
from bayes_ssi.plots.shape_plots import half_widths
from bayes_ssi.results.stored_result import FIGURES, AnyResult, StoredResult
from bayes_ssi.structures.geometry import Drawing, Geometry, Location, drawn_at, stick
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.ranking.study import Ranking

Scene = dict[str, Any]
SAVED = "moving_shapes.json"
MOST_CLASSES = 8  # whose modes are kept, the most probable first
MOST_NODES = 2500  # that a script can move smoothly; of more, some are left out
FARTHEST_APPENDAGE = 3.0  # times as far as the main structure may an appendage be drawn
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
    title: str, points: FloatArray, reach: float, geometry: Geometry | None, below: float = 0.0
) -> Any:
    """Axes of one scale around ``points`` (n, 3), with the structure if it is known.

    They are those of a figure with ``below`` inches below them. All points fit, with room of
    ``reach`` around them; arrows at the lowest corner name the axes.
    """
    panel, above = 2.9, 0.4  # inches: height of the axes, and of the title above them
    height = panel + below
    figure = look.new_figure((look.FIGURE_WIDTH, height))
    # Without the layout of other figures, in which axes in three dimensions are too small.
    figure.set_layout_engine("none")
    at = (0.0, below / height, 1.0, (panel - above) / height)
    ax: Any = figure.add_axes(at, projection="3d")
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
        ax.plot(*np.stack([low, low + along]).T, color=look.GREY, linewidth=0.8, clip_on=False)
        end = low + 1.25 * along
        ax.text(*end, name, fontsize=look.SMALL_TEXT, color=look.GREY, ha="center", va="center")
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
        walls = Poly3DCollection(nodes[corners], facecolors=look.GREY, alpha=0.08, **flat)
        ax.add_collection3d(walls)
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


@dataclass(frozen=True)
class MovingShapes:
    """Mode shapes that move, which notebooks show: model class → a scene for each test."""

    scenes: Mapping[str, Sequence[Scene]] = field(repr=False)

    def page(self) -> str:
        """A whole page, which needs no other file."""
        boxes = (f"<h2>{escape(name)}</h2>{box(scenes)}" for name, scenes in self.scenes.items())
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
            f"<title>Mode shapes</title><style>{asset('css')}</style></head>\n"
            f'<body class="shapes">{"".join(boxes)}'
            f"<script>{asset('js')}</script></body></html>\n"
        )

    def save(self, path: str | Path) -> None:
        """Write the page to a file."""
        Path(path).write_text(self.page(), encoding="utf-8")

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.page())}" sandbox="allow-scripts" title="Mode shapes" '
            'style="width: 100%; height: 38rem; border: 0"></iframe>'
        )


def asset(kind: str) -> str:
    """The script ("js") or the style ("css") of moving shapes."""
    return (files("bayes_ssi") / f"plots/moving_shapes.{kind}").read_text("utf-8")


def box(scenes: Sequence[Scene]) -> str:
    """The element of a page in which the script shows scenes."""
    record = json.dumps(scenes, separators=(",", ":")).replace("</", "<\\/")
    return f'<div class="moving"><script type="application/json">{record}</script></div>'


def plot_moving_shapes(of: AnyResult | ModalData) -> MovingShapes:
    """Mode shapes that turn and move: of the most probable model classes, or identified ones.

    Model classes are at their most probable parameters, with the measured motion at the sensors.

    Raises:
        ValueError: the result was saved without figures.
    """
    if isinstance(of, ModalData):
        return MovingShapes({of.source or "identified modes": [_data_scene(of)]})
    if isinstance(of, Ranking):
        by_name = {each.name: each for each in of.study.model_classes}
        names = [row.name for row in of.comparison.classes[:MOST_CLASSES]]
        return MovingShapes(
            {name: list(class_scenes(by_name[name], of.posterior(name))) for name in names}
        )
    directory = of.directory if isinstance(of, StoredResult) else Path(of)
    if saved := saved_scenes(directory):
        return MovingShapes(saved)
    raise ValueError(f"{directory}: has no {FIGURES}/{SAVED}; it was saved without figures")


def saved_scenes(directory: Path) -> dict[str, list[Scene]]:
    """Model class → scenes, of a result's directory; none where they were not saved."""
    path = directory / FIGURES / SAVED
    return dict(json.loads(path.read_text("utf-8"))) if path.is_file() else {}


def save_scenes(ranking: Ranking, directory: Path) -> None:
    """Write the scenes of the most probable classes to the directory of a result's figures."""
    scenes = plot_moving_shapes(ranking).scenes
    (directory / SAVED).write_text(json.dumps(scenes, separators=(",", ":")), encoding="utf-8")


def class_scenes(model_class: ModelClass, posterior: Posterior) -> Iterator[Scene]:
    """A scene for each configuration, at the most probable parameters."""
    likeliest = dict(zip(posterior.parameter_names, posterior.maxima[0], strict=True))
    for test, known in zip(model_class.configurations, posterior.configurations, strict=True):
        values = np.array([likeliest[each.name] for each in test.structure.parameters])
        yield {"name": known.name, **_class_scene(test.structure, test.data, known, values)}


def _class_scene(
    structure: Structure, data: ModalData, known: ConfigurationModes, values: FloatArray
) -> Scene:
    """Paired modes, and the measured motion alone of identified ones that are not."""
    drawing, row = structure.drawing(), _motions(structure, known, values)
    moves, unknown = _moves(drawing, row, known.n_modes), np.full(known.n_modes, np.nan)
    motions = structure.sensor_motions(data.sensors)
    seen = [sum(share * row.get(label, unknown) for label, share in m.items()) for m in motions]
    at_sensors = np.array(seen).reshape(len(seen), known.n_modes)
    main = [node not in structure.appendages for node in drawing[0].nodes]
    updated = {mode.label: mode for mode in known.updated.modes}
    modes = []
    for k, label in enumerate(data.labels):
        if label not in updated:
            still, note = np.zeros(moves.shape[:2]), ", not explained by this model class"
            modes.append(_mode(data, k, note, still))
            continue
        own, i = updated[label], known.pairing[label] - 1
        lengths = np.linalg.norm(moves[:, :, i], axis=1)
        largest = max(lengths[main].max(), lengths.max() / FARTHEST_APPENDAGE) or 1.0
        note = f", model {own.after_hz[1]:.4g} Hz"
        note += f", MAC {own.mac_after[1]:.4f}" if own.mac_after else ""
        modes.append(_mode(data, k, note, moves[:, :, i] / largest, at_sensors[:, i] / largest))
    places = [structure.sensor_location(name) for name in data.sensors]
    return _scene(drawing, places, data.sensors, modes)


def _motions(
    structure: Structure, known: ConfigurationModes, values: FloatArray
) -> dict[str, FloatArray]:
    """Degree of freedom → its components (n_modes,), from what costs one solution at most."""
    if structure.geometry is not None:
        labels, _, shapes = structure.labelled_modes(values)
    elif structure.is_cheap:
        labels, shapes = structure.degrees_of_freedom, structure.modes(values[None]).shapes[0]
    else:  # posterior medians
        labels = known.updated.places
        shapes = np.zeros((len(labels), known.n_modes))
        for mode in known.updated.modes:
            shapes[:, known.pairing[mode.label] - 1] = mode.shape_after[1]
    return dict(zip(labels, shapes, strict=True))


def _data_scene(data: ModalData) -> Scene:
    """Identified modes alone, sensors one above the other."""
    drawing = stick(data.sensors)
    places = [drawn_at(drawing, ((sensor, 1.0),)) for sensor in data.sensors]
    shapes = np.nan_to_num(data.unit_shapes / np.nanmax(np.abs(data.unit_shapes), 0, initial=0.0))
    moves = _moves(drawing, dict(zip(data.sensors, shapes, strict=True)), len(data.modes))
    modes = [
        _mode(data, k, "", moves[:, :, k])
        for k, mode in enumerate(data.modes)
        if mode.unit_shape is not None
    ]
    return {"name": "", **_scene(drawing, places, data.sensors, modes)}


def _mode(
    data: ModalData, k: int, note: str, moves: FloatArray, model: FloatArray | None = None
) -> Scene:
    """Mode k of the data, in the scale of the model, or to a largest component of 1."""
    mode, measured = data.modes[k], data.unit_shapes[:, k]
    scale = 1.0 / (float(np.nanmax(np.abs(measured), initial=0.0)) or 1.0)
    if model is not None:
        common = np.isfinite(model) & np.isfinite(measured)
        square = measured[common] @ measured[common]
        scale = float(model[common] @ measured[common] / square) if square else 1.0
    return {
        "title": f"mode {mode.label}",
        "note": f"measured {mode.frequency_hz:.4g} Hz{note}",
        "moves": moves,
        "model": model,
        "measured": scale * measured,
        "half": abs(scale) * half_widths(data)[k],
    }


def _moves(drawing: Drawing, row: Mapping[str, FloatArray], n_modes: int) -> FloatArray:
    """Displacements (n_nodes, 3, n_modes) of the nodes of a drawing."""
    geometry, motions = drawing
    moves = np.zeros((len(geometry.nodes), 3, n_modes))
    for i, node in enumerate(geometry.nodes):
        for axis, motion in enumerate(motions.get(node, ())):
            for label, share in motion:
                moves[i, axis] += share * row.get(str(label), 0.0)
    return moves


def _scene(
    drawing: Drawing, places: Sequence[Location | None], sensors: Sequence[str], modes: list[Scene]
) -> Scene:
    """In numbers between about -1 and 1, from the middle of the nodes."""
    geometry = drawing[0]
    nodes = np.array(list(geometry.nodes.values()))
    lines, faces = numbered(geometry)
    lines = np.concatenate([outline(nodes, faces), lines])
    kept = np.arange(len(nodes))
    if len(nodes) > MOST_NODES:
        kept, faces = np.unique(lines) if len(lines) else kept, []
        kept = kept[evenly_spaced_indices(len(kept), MOST_NODES)]
    at = np.full(len(nodes), -1)
    at[kept] = np.arange(len(kept))
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    middle, size = (low + high) / 2.0, float((high - low).max() / 2.0) or 1.0
    known = {i: place for i, place in enumerate(places) if place and place.direction is not None}
    return {
        "nodes": _rounded((nodes[kept] - middle) / size),
        "lines": at[lines][(at[lines] >= 0).all(axis=1)].tolist(),
        "faces": [at[face].tolist() for face in faces],
        "sensors": [
            {"name": sensors[i], "at": _rounded((np.array(place.position) - middle) / size),
             "along": _rounded(np.array(place.direction))}
            for i, place in known.items()
        ],
        "modes": [
            {
                **mode,
                "moves": _rounded(mode["moves"][kept]),
                "model": None if mode["model"] is None else _known(mode["model"][list(known)]),
                "measured": _known(mode["measured"][list(known)]),
                "half": _known(mode["half"][list(known)]),
            }
            for mode in modes
        ],
    }  # fmt: skip


def _rounded(array: FloatArray) -> Any:
    return (np.round(array, 4) + 0.0).tolist()


def _known(components: FloatArray) -> list[float | None]:
    """None where they are not known: JSON has no NaN."""
    return [None if np.isnan(each) else each for each in _rounded(components)]
