"""The sensors of a test on a finite-element model: by coordinates, and whether axes are right.

By coordinates, a sensor is at the nearest node that moves in its direction. Whether axes and units
of a test are those of the model is judged by the modes of the nominal model.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, permutations
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import first_bytes, read_table
from bayes_ssi.foundations.universal_files import begins_universal, read_data_sets
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.finite_elements.matrix_structure import MatrixStructure
from bayes_ssi.structures.geometry import Point, checked_point
from bayes_ssi.structures.modal import mac, seen_shapes
from bayes_ssi.structures.solver_files.exported_model import ExportedModel
from bayes_ssi.structures.solver_files.solver_text import TRANSLATIONS

COLUMNS = ("sensor", "x_coord", "y_coord", "z_coord", "direction")
# Factors between units of length: what they turn, and the factor.
SCALES = {"mm to m": 1e-3, "m to mm": 1e3, "ft to m": 0.3048, "in to m": 0.0254, "cm to m": 1e-2}
# Errors of identified shapes and of a nominal model take less from the mean MAC, and from its
# product with the ratio of frequencies.
LEAST_GAIN_OF_MAC = 0.2
# Nominal frequencies are not off by such a factor; in units that do not belong together they are
# off by √1000 = 32, or √9.81 = 3.1 (kgf) to √(1000/9.81) = 10.
GRAVITY = {9.80665: "m", 9806.65: "mm", 386.089: "in", 32.174: "ft"}
MOST_RATIO_OF_WEIGHTS = 2.0  # of a structure's mass to what frequencies say
MOST_RATIO_OF_FREQUENCIES = 3.0

# Axis of the test → axis of the model that it is taken for.
Axes = Mapping[str, str]
SAME_AXES: Axes = dict(zip(TRANSLATIONS, TRANSLATIONS, strict=True))


@dataclass(frozen=True)
class SensorPoint:
    """Where a sensor is, and x, y or z, along which it measures."""

    name: str
    position: Point
    direction: str


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
        raise ValueError(f"{path}: its nodes do not say which sensors there are; give the data")
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


def nearest_degrees_of_freedom(
    points: Sequence[SensorPoint], model: ExportedModel, scale: float = 1.0, axes: Axes = SAME_AXES
) -> dict[str, tuple[str, float]]:
    """Sensor → the nearest degree of freedom that moves in its direction, and its distance.

    ``scale`` turns the points' unit of length into the model's.
    """
    nodes = {axis: _nodes(model, axis) for axis in {axes[point.direction] for point in points}}

    def nearest(factor: float) -> dict[str, tuple[str, float]]:
        mapped = {}
        for point in points:
            of_axes = {axes[name]: x for name, x in zip(TRANSLATIONS, point.position, strict=True)}
            at = factor * np.array([of_axes[axis] for axis in TRANSLATIONS])
            names, positions = nodes[axes[point.direction]]
            distances = np.linalg.norm(positions - at, axis=1)
            i = int(distances.argmin())
            mapped[point.name] = f"{names[i]} {axes[point.direction]}", float(distances[i])
        return mapped

    found = nearest(scale)
    labels = Counter(label for label, _ in found.values())
    largest = max(distance for _, distance in found.values())
    for units, factor in SCALES.items():
        others, distances = zip(*nearest(factor).values(), strict=True)
        # Distances that fall to a tenth are no matter of where nodes are.
        if max(distances) < 0.1 * largest and len(set(others)) == len(points):
            raise ValueError(
                f"sensors are up to {largest:.4g} from their nodes, but {max(distances):.4g} with "
                f"coordinates times {factor:g} ({units}): state the factor"
            )
    twice = next((label for label, count in labels.items() if count > 1), None)
    if twice is not None:
        both = " and ".join(repr(name) for name, (label, _) in found.items() if label == twice)
        raise ValueError(f"sensors {both} are nearest to the same degree of freedom, {twice!r}")
    return found


def _nodes(model: ExportedModel, direction: str) -> tuple[list[str], FloatArray]:
    if model.geometry is None or model.labels is None:
        raise ValueError("sensors are given by coordinates, but the model's files state none")
    labels = set(model.labels)
    nodes = [node for node in model.geometry.nodes if f"{node} {direction}" in labels]
    if not nodes:
        raise ValueError(f"no node with coordinates moves along {direction}")
    return nodes, np.array([model.geometry.nodes[node] for node in nodes])


def compared_with_nominal(
    model: ExportedModel, modes: ModalData, places: Callable[[Axes], Mapping[str, str]]
) -> list[str]:
    """The nominal model against the identified modes, in sentences for the user.

    Those that begin with (!) ask for a decision. For axes of the test, ``places`` gives the label
    of every sensor; it raises ValueError where they have none.
    """
    mapped = {}
    for order in permutations(TRANSLATIONS):
        try:
            labels_of = places(dict(zip(TRANSLATIONS, order, strict=True)))
        except ValueError:
            continue
        if len(set(labels_of.values()).intersection(model.labels or ())) == len(labels_of):
            mapped[order] = [labels_of[name] for name in modes.sensors]
    labels = list(dict.fromkeys(chain(*mapped.values())))
    n = len(modes.modes)
    # As many again as were identified, for those that were missed.
    n_modes = min(2 * n, int(np.count_nonzero(model.mass.diagonal())))
    structure = MatrixStructure(
        model.stiffness,
        model.mass,
        labels=model.labels,
        sensors=labels or [model.labels[0] if model.labels else ""],
        n_modes=n_modes,
    )
    modes_of_model = structure.modes(np.empty((1, 0)))
    frequencies, shapes = modes_of_model.frequencies_hz[0], seen_shapes(modes_of_model.shapes)[0]
    nominal, identified = (
        ", ".join(f"{hz:.4g}" for hz in part) for part in (frequencies[:n], modes.frequencies_hz)
    )
    said = [f"Nominal frequencies: {nominal} Hz; identified: {identified} Hz."]
    ratio = frequencies[0] / modes.frequencies_hz[0]
    # Weights in place of masses make frequencies lower by the root of g.
    g, unit = min(GRAVITY.items(), key=lambda each: abs(np.log(ratio**2 * each[0])))
    if abs(np.log(ratio**2 * g)) < np.log(MOST_RATIO_OF_WEIGHTS):
        said.append(
            f"(!) The lowest nominal frequency is {ratio:.3g} times the identified one; with the "
            f"mass divided by g = {g:g} {unit}/s² it fits: are the masses weights?"
        )
    elif not 1.0 / MOST_RATIO_OF_FREQUENCIES < ratio < MOST_RATIO_OF_FREQUENCIES:
        said.append(
            f"(!) The lowest nominal frequency is {ratio:.3g} times the identified one: are the "
            "model's units of force, length and mass consistent?"
        )
    macs = {
        order: mac(modes.unit_shapes, shapes[[labels.index(label) for label in of_order]])
        for order, of_order in mapped.items()
    }
    # The ratio of frequencies tells a tower's alike modes in two directions apart.
    ratios = np.exp(-abs(np.log(modes.frequencies_hz[:, None] / frequencies)))
    with_ratios = {order: of_order * ratios for order, of_order in macs.items()}
    better = _much_better(macs, "MAC") or _much_better(
        with_ratios, "MAC times ratio of frequencies"
    )
    return said + ([better] if better else [])


def _much_better(likeness: Mapping[tuple[str, ...], FloatArray], measure: str) -> str | None:
    """Whether other axes than the stated ones have a much larger mean likeness, in a sentence."""
    means = {order: _mean_of_largest(of_order) for order, of_order in likeness.items()}
    best = max(means, key=lambda order: means[order], default=TRANSLATIONS)
    stated = means.get(TRANSLATIONS, np.inf)
    if best == TRANSLATIONS or means[best] < stated + LEAST_GAIN_OF_MAC:
        return None
    axes = zip(TRANSLATIONS, best, strict=True)
    pairs = ", ".join(f"{axis} of the test as {taken}" for axis, taken in axes if axis != taken)
    return (
        f"(!) with {pairs} the identified modes would be like the nominal model's (mean {measure} "
        f"{means[best]:.2f} instead of {stated:.2f}): are the axes the same?"
    )


def _mean_of_largest(macs: FloatArray) -> float:
    known = macs[~np.isnan(macs).all(axis=1)]
    return float(np.nanmax(known, axis=1).mean()) if len(known) else 0.0
