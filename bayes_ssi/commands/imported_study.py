"""The study that ``bayes-ssi import`` writes: the matrices that it reads, and its sensors.

Sensors are found by label, by the data's names, or by coordinates.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bayes_ssi.commands.new import TEMPLATES, in_a_docstring, new_paths
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.text_files import file_names

if TYPE_CHECKING:
    from bayes_ssi.measurements.modes.modal_data import ModalData
    from bayes_ssi.structures.solver_files.exported_model import ExportedModel
    from bayes_ssi.structures.solver_files.parameter_matrices import ParameterMatrices, Term


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


# Of the study and of the folder of its matrices.
ENDINGS = (".py", "_matrices")
LABELS = "labels.txt"


def write_imported_study(
    name: Path,
    matrices: ParameterMatrices,
    data: Mapping[str, Path],
    band_hz: tuple[float, float] | None,
    places: Mapping[str, str],
    command: str,
) -> tuple[Path, list[Path]]:
    """Write a study and a folder of its matrices.

    Args:
        name: name of the study, with or without ``.py``; its directory must exist.
        data: file of the identified modes by test; of one, ``NAME.csv``, which need not exist, if
            empty.

    Returns:
        The path of the study and those of the data.
    """
    from bayes_ssi.results.result_files import new_directory

    study, folder = new_paths(name, *ENDINGS)
    data = data or {"": study.with_suffix(".csv")}
    tests = {test: _read(path, study, band_hz) for test, path in data.items()}
    files = file_names(_named(matrices), "npz")
    text = _study(folder, tests, matrices, files, places, command)
    with new_directory(folder, marker=LABELS) as partial:
        _write_matrices(partial, matrices, files)
        with study.open("x", encoding="utf-8") as file:
            file.write(text)
    return study, list(data.values())


def _named(matrices: ParameterMatrices) -> dict[str, Term]:
    """Every term of stiffness and mass by a name, from which that of its file is made."""
    terms = [("K", term) for term in matrices.stiffness] + [("M", term) for term in matrices.mass]
    return {_name(symbol, term): term for symbol, term in terms}


def _name(symbol: str, term: Term) -> str:
    parts = (name if exponent == 1 else f"{name}_{exponent}" for name, exponent in term.powers)
    return "_".join([symbol, *parts])


def _write_matrices(folder: Path, matrices: ParameterMatrices, files: Mapping[str, str]) -> None:
    import scipy.sparse as sp

    for name, term in _named(matrices).items():
        sp.save_npz(folder / files[name], term.matrix)
    model = matrices.nominal
    (folder / LABELS).write_text("\n".join([*(model.labels or ()), ""]), encoding="utf-8")
    if model.geometry is not None:
        nodes = ([node, *map(repr, at)] for node, at in model.geometry.nodes.items())
        _write_csv(folder / "nodes.csv", nodes)
        _write_csv(folder / "lines.csv", model.geometry.lines)
        _write_csv(folder / "faces.csv", model.geometry.faces)


def _write_csv(path: Path, rows: Iterable[Iterable[str]]) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    path.write_text(text.getvalue(), encoding="utf-8")


def _study(
    folder: Path,
    tests: Mapping[str, str],
    matrices: ParameterMatrices,
    files: Mapping[str, str],
    places: Mapping[str, str],
    command: str,
) -> str:
    import jinja2

    from bayes_ssi.structures.modal import SOLVER

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"quoted": _quoted, "docstring": in_a_docstring}
    terms = (*matrices.stiffness, *matrices.mass)
    model = matrices.nominal
    in_si = model.units == "N, m, kg"
    return environment.get_template("imported.py.txt").render(
        model=model,
        command=command,
        folder=folder.name,
        tests=tests,
        sensors={name: label for name, label in places.items() if name != label},
        properties=list(dict.fromkeys(name for term in terms for name, _ in term.powers)),
        stiffness=[(term.powers, files[_name("K", term)]) for term in matrices.stiffness],
        mass=[(term.powers, files[_name("M", term)]) for term in matrices.mass],
        unit="m" if in_si else "",
        mass_unit="kg" if in_si else "",
        is_large=model.size > SOLVER.batched_up_to,
    )


def _quoted(value: Any) -> str:
    """Text or a list of texts as Python writes it, in double quotes."""
    return json.dumps(value, ensure_ascii=False)


def _read(data: Path, study: Path, band_hz: tuple[float, float] | None) -> str:
    """The arguments by which the study reads its data, relative to it in the same folder."""
    path = f"Path({_quoted(str(data.resolve()))})"
    if data.resolve().parent == study.resolve().parent:
        path = f"here.with_name({_quoted(data.name)})"
    return path if band_hz is None else f"{path}, band_hz={band_hz}"
