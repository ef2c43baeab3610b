"""The sensors of an imported study: by label, by the data's names, or by coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bayes_ssi.foundations.choices import require_known

if TYPE_CHECKING:
    from bayes_ssi.measurements.modes.modal_data import ModalData
    from bayes_ssi.structures.solver_files.exported_model import ExportedModel


def imported_sensors(
    model: ExportedModel,
    tests: Sequence[ModalData],
    labels: Mapping[str, str],
    points_file: Path | None,
    scale: float,
) -> tuple[dict[str, str], list[str]]:
    """Sensors of the data, or those given where there are no data yet.

    Args:
        points_file: coordinates of sensors, or None.
        scale: factor of these coordinates.

    Returns:
        Sensor → label of the degree of freedom that it measures; and what is to be said of them.
    """
    from bayes_ssi.measurements.modes.nominal_comparison import compared_with_nominal
    from bayes_ssi.structures.solver_files.sensor_points import (
        exchanged,
        nearest_degrees_of_freedom,
        read_sensor_points,
    )

    if model.labels is None:
        raise ValueError("the nominal export has no labels, by which sensors are named")
    known = set(model.labels)
    measured = tuple(dict.fromkeys(name for modes in tests for name in modes.sensors))
    points = () if points_file is None else read_sensor_points(points_file, measured)
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

    for modes in tests:
        lines += compared_with_nominal(model, modes, with_axes)[0]
    return places, lines
