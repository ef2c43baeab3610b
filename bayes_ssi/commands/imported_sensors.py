"""The sensors of an imported study: by label, by the data's names, or by coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bayes_ssi.data.modal_data import ModalData
    from bayes_ssi.solver_files.exported_model import ExportedModel
    from bayes_ssi.solver_files.sensor_points import SensorPoint


@dataclass(frozen=True)
class ImportedSensors:
    """Where sensors are on the model, and what is to be said of it.

    Attributes:
        places: sensor → label of a degree of freedom.
        lines: distances to nodes, and how the nominal model compares with the data.
    """

    places: Mapping[str, str]
    lines: tuple[str, ...]


def imported_sensors(
    model: ExportedModel,
    modes: ModalData | None,
    labels: Mapping[str, str],
    points_file: Path | None,
    scale: float,
) -> ImportedSensors:
    """Sensors of the data, or those given where there are no data yet.

    Args:
        model: the nominal model.
        modes: the identified modes, if there are any.
        labels: sensor → label, as the user gave them.
        points_file: coordinates of sensors, or None.
        scale: factor of these coordinates.

    Raises:
        ValueError: the model has no labels, or a sensor is at none of them.
    """
    from bayes_ssi.data.nominal_comparison import compared_with_nominal
    from bayes_ssi.solver_files.sensor_points import exchanged, nearest_degrees_of_freedom

    if model.labels is None:
        raise ValueError("the nominal export has no labels, by which sensors are named")
    known = set(model.labels)
    points = _points(points_file, modes)
    mapped = nearest_degrees_of_freedom(points, model, scale) if points else ()
    by_point = {each.name: each.label for each in mapped}
    names = list(modes.sensors) if modes is not None else list({**by_point, **labels})
    unknown = [name for name in labels if name not in names]
    if unknown:
        raise ValueError(f"--sensor: the data have no sensor {unknown[0]!r}; they have {names}")
    places = {name: labels.get(name, by_point.get(name, name)) for name in names}
    for name, label in places.items():
        if label not in known:
            raise ValueError(_not_a_label(model, name, label))
    lines = [
        f"{each.name}: {each.label}, {each.distance:.3g} away"
        for each in mapped
        if places.get(each.name) == each.label
    ]

    def with_axes(axes: Mapping[str, str]) -> Mapping[str, str] | None:
        moved = {}
        if points:
            try:
                moved = {
                    each.name: each.label
                    for each in nearest_degrees_of_freedom(exchanged(points, axes), model, scale)
                }
            except ValueError:
                return None
        turned = {}
        for name, label in places.items():
            node, _, direction = label.rpartition(" ")
            turned[name] = moved.get(name, f"{node} {axes.get(direction, direction)}")
        return turned if known >= set(turned.values()) else None

    if modes is not None:
        lines += compared_with_nominal(model, modes, with_axes).lines
    return ImportedSensors(places, tuple(lines))


def _points(path: Path | None, modes: ModalData | None) -> Sequence[SensorPoint]:
    from bayes_ssi.solver_files.sensor_points import points_of_universal_file, read_sensor_points
    from bayes_ssi.universal_files import is_universal_file

    if path is None:
        return ()
    if not is_universal_file(path):
        return read_sensor_points(path)
    if modes is None:
        raise ValueError(f"{path}: a universal file states nodes, not sensors; give --data as well")
    return points_of_universal_file(path, modes.sensors)


def _not_a_label(model: ExportedModel, name: str, label: str) -> str:
    return (
        f"sensor {name!r}: no degree of freedom is labelled {label!r}; name it by --sensor "
        f"{name!r}=LABEL, with a label such as {next(iter(model.labels or ()))!r}"
    )
