"""The sensors of a test on a finite-element model: by coordinates, and beside the nominal modes.

By coordinates, a sensor is at the nearest node that moves in its direction. Whether axes and units
of a test are those of the model is judged by the modes of the nominal model.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import read_table
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.finite_elements.matrix_structure import MatrixStructure
from bayes_ssi.structures.geometry import Point, checked_point
from bayes_ssi.structures.modal import mac, seen_shapes
from bayes_ssi.structures.solver_files.exported_model import ExportedModel
from bayes_ssi.structures.solver_files.solver_text import TRANSLATIONS

COLUMNS = ("sensor", "x_coord", "y_coord", "z_coord", "direction")
# Factors between units of length: what they turn, and the factor.
SCALES = {"mm to m": 1e-3, "m to mm": 1e3, "ft to m": 0.3048, "in to m": 0.0254, "cm to m": 1e-2}
LEAST_MEAN_MAC = 0.5  # which nominal models exceed where sensors are at their places
# Nominal frequencies are not off by such a factor; in units that do not belong together they are
# off by √1000 = 32, or √9.81 = 3.1 (kgf) to √(1000/9.81) = 10.
GRAVITY = {9.80665: "m", 9806.65: "mm", 386.089: "in", 32.174: "ft"}
MOST_RATIO_OF_WEIGHTS = 2.0  # of a structure's mass to what frequencies say
MOST_RATIO_OF_FREQUENCIES = 3.0


@dataclass(frozen=True)
class SensorPoint:
    """Where a sensor is, and x, y or z, along which it measures."""

    name: str
    position: Point
    direction: str


def read_sensor_points(path: Path) -> tuple[SensorPoint, ...]:
    """Where sensors are, by a CSV file with :data:`COLUMNS`."""
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


def nearest_degrees_of_freedom(
    points: Sequence[SensorPoint], model: ExportedModel
) -> dict[str, tuple[str, float]]:
    """Sensor → the nearest degree of freedom that moves in its direction, and its distance."""
    nodes = {axis: _nodes(model, axis) for axis in {point.direction for point in points}}

    def nearest(factor: float = 1.0) -> dict[str, tuple[str, float]]:
        mapped = {}
        for point in points:
            names, positions = nodes[point.direction]
            distances = np.linalg.norm(positions - factor * np.array(point.position), axis=1)
            i = int(distances.argmin())
            mapped[point.name] = f"{names[i]} {point.direction}", float(distances[i])
        return mapped

    places = nearest()
    labels = Counter(label for label, _ in places.values())
    largest = max(distance for _, distance in places.values())
    for units, factor in SCALES.items():
        others, distances = zip(*nearest(factor).values(), strict=True)
        # Distances that fall to a tenth are no matter of where nodes are.
        if max(distances) < 0.1 * largest and len(set(others)) == len(points):
            raise ValueError(
                f"sensors are up to {largest:.4g} from their nodes, but {max(distances):.4g} with "
                f"coordinates times {factor:g} ({units}): give them in the model's unit"
            )
    twice = next((label for label, count in labels.items() if count > 1), None)
    if twice is not None:
        both = " and ".join(repr(name) for name, (label, _) in places.items() if label == twice)
        raise ValueError(f"sensors {both} are nearest to the same degree of freedom, {twice!r}")
    return places


def _nodes(model: ExportedModel, direction: str) -> tuple[list[str], FloatArray]:
    if model.geometry is None or model.labels is None:
        raise ValueError("sensors are given by coordinates, but the model's files state none")
    labels = set(model.labels)
    nodes = [node for node in model.geometry.nodes if f"{node} {direction}" in labels]
    if not nodes:
        raise ValueError(f"no node with coordinates moves along {direction}")
    return nodes, np.array([model.geometry.nodes[node] for node in nodes])


def compared_with_nominal(
    model: ExportedModel, modes: ModalData, places: Mapping[str, str]
) -> list[str]:
    """The nominal model against the identified modes, in sentences for the user.

    ``places`` are the labels of the sensors. Sentences that begin with (!) ask for a decision.
    """
    n = len(modes.modes)
    measured, known = [places[name] for name in modes.sensors], set(model.labels or ())
    # What a mode does in one direction is rounding beside what it does there in another.
    nodes = [label.rpartition(" ")[0] for label in measured]
    at_nodes = [f"{node} {axis}" for node in nodes for axis in TRANSLATIONS]
    seen = list(dict.fromkeys([*measured, *filter(known.__contains__, at_nodes)]))
    structure = MatrixStructure(
        model.stiffness,
        model.mass,
        labels=model.labels,
        sensors=seen or list(model.labels or ())[:1],
        # As many again as were identified, for those that were missed.
        n_modes=min(2 * n, int(np.count_nonzero(model.mass.diagonal()))),
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
    scored = [i for i, mode in enumerate(modes.modes) if mode.scored_shape is not None]
    if scored:
        # A motion that no nominal mode has at these sensors is like none.
        rows = shapes[[seen.index(label) for label in measured]]
        macs = np.nan_to_num(mac(modes.unit_shapes[:, scored], rows)).max(axis=1)
        said.append(
            f"{'(!) ' if macs.mean() < LEAST_MEAN_MAC else ''}Largest MACs of the identified "
            f"shapes with nominal ones: {', '.join(f'{each:.2f}' for each in macs)}"
            f"{': are axes and places the same?' if macs.mean() < LEAST_MEAN_MAC else '.'}"
        )
    return said
