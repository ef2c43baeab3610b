"""The study that ``bayes-ssi import`` writes, and the matrices that it reads."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bayes_ssi.commands.new import TEMPLATES, in_a_docstring, new_paths
from bayes_ssi.foundations.text_files import file_names

if TYPE_CHECKING:
    from bayes_ssi.structures.solver_files.parameter_matrices import ParameterMatrices, Term

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
    """The text of the study."""
    from bayes_ssi.structures.modal import SOLVER

    properties = list(
        dict.fromkeys(n for t in (*matrices.stiffness, *matrices.mass) for n, _ in t.powers)
    )
    model = matrices.nominal
    text = (TEMPLATES / "imported.py.txt").read_text("utf-8")
    for mark, value in {
        "PROGRAM": f"{model.program}, {model.size} degrees of freedom, {model.units}",
        "COMMAND": command,
        "FOLDER": _quoted(folder.name),
        "TESTS": _mapping({test: f"bs.read_modal_data({read})" for test, read in tests.items()}),
        "ADDED": _mapping(dict.fromkeys(tests, "[]")),
        "PROPERTIES": _quoted(properties),
        "STIFFNESS": _terms("K", matrices.stiffness, files),
        "MASS": _terms("M", matrices.mass, files),
        "SENSORS": _mapping(
            {name: _quoted(label) for name, label in places.items() if name != label}
        ),
        "IMPORTS": "import csv\n" if model.geometry is not None else "",
        "GEOMETRY": GEOMETRY if model.geometry is not None else "geometry = None\n",
        "UNIT": _quoted("m" if model.units == "N, m, kg" else ""),
        "RETURNED": "model.reduced()" if model.size > SOLVER.batched_up_to else "model",
        "CLASSES": ONE_CLASS if len(properties) == 1 else TWO_CLASSES,
        "MASS_UNIT": _quoted("kg" if model.units == "N, m, kg" else ""),
    }.items():
        written = in_a_docstring(value) if mark in ("PROGRAM", "COMMAND") else value
        text = text.replace(f"{{{mark}}}", written)
    return text


GEOMETRY = """\
with (matrices / "nodes.csv").open(encoding="utf-8") as file:
    nodes = {node: tuple(map(float, at)) for node, *at in csv.reader(file)}
with (matrices / "lines.csv").open(encoding="utf-8") as file:
    lines = tuple(map(tuple, csv.reader(file)))
with (matrices / "faces.csv").open(encoding="utf-8") as file:
    geometry = bs.Geometry(nodes, lines, {UNIT}, tuple(map(tuple, csv.reader(file))))
"""
ONE_CLASS = """\
study = bs.Study(
    "How far are the properties from nominal?",
    [model_class("altered", own, "a factor each")],
    mass_unit={MASS_UNIT},  # of the model, such as "kg", for tables and reports
)
"""
TWO_CLASSES = """\
study = bs.Study(
    "One factor for all properties, or one for each?",
    [
        model_class("one factor", common, "the same factor for all properties"),
        model_class("each its own", own, "a factor for each property"),
    ],
    mass_unit={MASS_UNIT},  # of the model, such as "kg", for tables and reports
)
"""


def _quoted(value: Any) -> str:
    """Text, a list or a mapping of texts as Python writes it, in double quotes."""
    return json.dumps(value, ensure_ascii=False)


def _mapping(expressions: Mapping[str, str]) -> str:
    """A mapping of texts to expressions, as Python writes it."""
    lines = (f"    {_quoted(key)}: {value},\n" for key, value in expressions.items())
    return "{\n" + "".join(lines) + "}" if expressions else "{}"


def _read(data: Path, study: Path, band_hz: tuple[float, float] | None) -> str:
    """The arguments by which the study reads its data, relative to it in the same folder."""
    path = f"Path({_quoted(str(data.resolve()))})"
    if data.resolve().parent == study.resolve().parent:
        path = f"here.with_name({_quoted(data.name)})"
    return path if band_hz is None else f"{path}, band_hz={band_hz}"


def _terms(symbol: str, terms: Iterable[Term], files: Mapping[str, str]) -> str:
    lines = []
    for term in terms:
        read = f"read({_quoted(files[_name(symbol, term)])})"
        powers = " * ".join(
            f"factors[{_quoted(name)}]" + ("" if exponent == 1 else f"**{exponent}")
            for name, exponent in term.powers
        )
        lines.append(f"            ({powers}, {read})," if powers else f"            {read},")
    return "\n".join(lines)
