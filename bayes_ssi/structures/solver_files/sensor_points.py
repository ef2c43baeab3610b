"""Sensors by coordinates: the nearest nodes of a model that move in their directions."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import first_bytes, read_table
from bayes_ssi.foundations.universal_files import begins_universal, read_data_sets
from bayes_ssi.structures.geometry import Point, checked_point
from bayes_ssi.structures.solver_files.exported_model import ExportedModel
from bayes_ssi.structures.solver_files.solver_text import TRANSLATIONS

COLUMNS = ("sensor", "x_coord", "y_coord", "z_coord", "direction")
# Factors between units of length: what they turn, and the factor.
SCALES = {"mm to m": 1e-3, "m to mm": 1e3, "ft to m": 0.3048, "in to m": 0.0254, "cm to m": 1e-2}


@dataclass(frozen=True)
class SensorPoint:
    """Where a sensor is, and x, y or z, along which it measures."""

    name: str
    position: Point
    direction: str


@dataclass(frozen=True)
class MappedSensor:
    """A sensor, the degree of freedom that is taken for it, and how far away its node is."""

    name: str
    label: str
    distance: float


def read_sensor_points(path: Path, sensors: Sequence[str]) -> tuple[SensorPoint, ...]:
    """Where sensors are: by a table, or by the nodes of the test's own universal file.

    Args:
        path: a CSV file with :data:`COLUMNS`, or a universal file that states nodes.
        sensors: names "node direction" of those at the nodes of a universal file.
    """
    if begins_universal(first_bytes(path)):
        return _at_nodes(path, sensors)
    names, rows = read_table(path)
    if sorted(names) != sorted(COLUMNS) or not rows:
        raise ValueError(f"{path}: must have the columns {', '.join(COLUMNS)}, and rows")
    points = []
    for where, row in rows:
        if len(row) != len(names) or not all(row):
            raise ValueError(f"{where}: must have a cell in each of the {len(names)} columns")
        cells = dict(zip(names, row, strict=True))
        if cells["direction"] not in TRANSLATIONS:
            raise ValueError(
                f"{where}: direction must be x, y or z, got {cells['direction']!r}; where a sensor "
                "points the other way, change the sign of its column in the data"
            )
        at = checked_point([cells[name] for name in COLUMNS[1:4]], where)
        points.append(SensorPoint(cells["sensor"], at, cells["direction"]))
    return tuple(points)


def _at_nodes(path: Path, sensors: Sequence[str]) -> tuple[SensorPoint, ...]:
    if not sensors:
        raise ValueError(f"{path}: its nodes do not say which sensors there are; give --data")
    nodes: dict[str, Point] = {}
    for one in read_data_sets(path, 15, 2411):
        for number, *at in zip(one["node_nums"], one["x"], one["y"], one["z"], strict=True):
            nodes[str(int(number))] = checked_point(at, f"{path}: node {int(number)}")
    points = []
    for name in sensors:
        node, _, direction = name.rpartition(" ")
        if node not in nodes or direction not in TRANSLATIONS:
            raise ValueError(
                f"{path}: sensor {name!r} is at none of its {len(nodes)} nodes; name it 'node "
                "direction', such as '12 x'"
            )
        points.append(SensorPoint(name, nodes[node], direction))
    return tuple(points)


def exchanged(points: Sequence[SensorPoint], axes: Mapping[str, str]) -> tuple[SensorPoint, ...]:
    """The sensors with each axis of the test, a key, taken for an axis of the model."""
    order = [list(axes.values()).index(axis) for axis in TRANSLATIONS]
    return tuple(
        SensorPoint(
            each.name,
            (each.position[order[0]], each.position[order[1]], each.position[order[2]]),
            axes[each.direction],
        )
        for each in points
    )


def nearest_degrees_of_freedom(
    points: Sequence[SensorPoint], model: ExportedModel, scale: float = 1.0
) -> tuple[MappedSensor, ...]:
    """The nearest node of each sensor that moves in its direction."""
    mapped = _mapped(points, model, scale)
    labels = Counter(each.label for each in mapped)
    largest = max(each.distance for each in mapped)
    for units, factor in SCALES.items():
        other = _mapped(points, model, factor)
        nearer = max(each.distance for each in other)
        # Distances that fall to a tenth are no matter of where nodes are.
        if nearer < 0.1 * largest and len({each.label for each in other}) == len(points):
            raise ValueError(
                f"sensors are up to {largest:.4g} from their nodes, but {nearer:.4g} with "
                f"coordinates times {factor:g} ({units}): state the factor by --points-scale"
            )
    twice = next((label for label, count in labels.items() if count > 1), None)
    if twice is not None:
        both = " and ".join(repr(each.name) for each in mapped if each.label == twice)
        raise ValueError(f"sensors {both} are nearest to the same degree of freedom, {twice!r}")
    return mapped


def _mapped(
    points: Sequence[SensorPoint], model: ExportedModel, scale: float
) -> tuple[MappedSensor, ...]:
    places = {direction: _nodes(model, direction) for direction in {p.direction for p in points}}
    mapped = []
    for point in points:
        nodes, positions = places[point.direction]
        distances = np.linalg.norm(positions - scale * np.array(point.position), axis=1)
        i = int(distances.argmin())
        label = f"{nodes[i]} {point.direction}"
        mapped.append(MappedSensor(point.name, label, float(distances[i])))
    return tuple(mapped)


def _nodes(model: ExportedModel, direction: str) -> tuple[list[str], FloatArray]:
    if model.geometry is None or model.labels is None:
        raise ValueError("sensors are given by coordinates, but the model's files state none")
    labels = set(model.labels)
    nodes = [node for node in model.geometry.nodes if f"{node} {direction}" in labels]
    if not nodes:
        raise ValueError(f"no node with coordinates moves along {direction}")
    return nodes, np.array([model.geometry.nodes[node] for node in nodes])
