"""The sensors of an imported study: by label, by the data's names, or by coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bayes_ssi.foundations.choices import require_known

if TYPE_CHECKING:
    from bayes_ssi.measurements.modes.modal_data import ModalData
    from bayes_ssi.structures.solver_files.exported_model import ExportedModel
    from bayes_ssi.structures.solver_files.sensor_points import SensorPoint


def imported_sensors(
    model: ExportedModel,
    tests: Sequence[ModalData],
    labels: Mapping[str, str],
    points_file: Path | None,
    scale: float | None,
) -> tuple[dict[str, str], list[str]]:
    """Sensors of the data, or those given where there are no data yet.

    Args:
        points_file: coordinates of sensors, or None.
        scale: factor of these coordinates; None for 1, or what the units of the file give.

    Returns:
        Sensor → label of the degree of freedom that it measures; and what is to be said of them.
    """
    from bayes_ssi.measurements.modes.nominal_comparison import compared_with_nominal
    from bayes_ssi.structures.solver_files.sensor_points import (
        exchanged,
        nearest_degrees_of_freedom,
    )

    if model.labels is None:
        raise ValueError("the nominal export has no labels, by which sensors are named")
    known = set(model.labels)
    measured = tuple(dict.fromkeys(name for modes in tests for name in modes.sensors))
    points: Sequence[SensorPoint] = ()
    metres = None
    if points_file is not None:
        points, metres = _stated(points_file, measured)
    said = []
    if scale is None and metres is not None and model.units == "N, m, kg":
        scale = metres
        said = [f"{points_file}: its coordinates are in units of {scale:g} m"]
    scale = 1.0 if scale is None else scale
    mapped = nearest_degrees_of_freedom(points, model, scale) if points else ()
    by_point = {each.name: each.label for each in mapped}
    names = list(measured or {**by_point, **labels})
    require_known("--sensor: the data have no sensor", labels, names)
    places = {name: labels.get(name, by_point.get(name, name)) for name in names}
    for name, label in places.items():
        if label not in known:
            raise ValueError(
                f"sensor {name!r}: no degree of freedom is labelled {label!r}; name it by --sensor "
                f"{name!r}=LABEL, with a label such as {model.labels[0]!r}"
            )
    distances = {each.name: f", {each.distance:.3g} away" for each in mapped}
    lines = [
        *said,
        *(
            f"{name}: {label}{distances.get(name, '')}"
            for name, label in by_point.items()
            if places.get(name) == label
        ),
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

    for modes in tests:
        lines += compared_with_nominal(model, modes, with_axes)[0]
    return places, lines


def _stated(path: Path, measured: tuple[str, ...]) -> tuple[Sequence[SensorPoint], float | None]:
    """Coordinates of sensors in a file, and its unit in metres, if it states one."""
    from bayes_ssi.foundations.text_files import first_bytes
    from bayes_ssi.foundations.universal_files import begins_universal
    from bayes_ssi.structures.solver_files.sensor_points import (
        metres_of_universal_file,
        points_of_universal_file,
        read_sensor_points,
    )

    if begins_universal(first_bytes(path)):
        sensors = measured or _sensors_of_universal_file(path)
        return points_of_universal_file(path, sensors), metres_of_universal_file(path)
    return read_sensor_points(path), None


def _sensors_of_universal_file(path: Path) -> tuple[str, ...]:
    """Sensors "node direction" of its time responses (data sets 58), else of its modes (55)."""
    from bayes_ssi.foundations.universal_files import read_data_sets, response_direction
    from bayes_ssi.measurements.modes.modal_tools import moving_sensors

    measured = [(one, response_direction(one)) for one in read_data_sets(path, 58)]
    names = tuple(
        dict.fromkeys(f"{int(one['rsp_node'])} {along[0]}" for one, along in measured if along)
    )
    names = names or tuple(moving_sensors(read_data_sets(path, 55)))
    if not names:
        raise ValueError(f"{path}: no data sets 55 or 58, which name sensors; give --data as well")
    return names
