"""``bayes-ssi import``: a study from exports of a finite-element program.

Its sensors are found by label, by the data's names, or by coordinates.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands.new import TEMPLATES, in_a_docstring, new_paths, next_commands
from bayes_ssi.commands.options import PATH, flag, named_values, path_option, range_option
from bayes_ssi.commands.terminal import command_line, say
from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.text_files import file_names

if TYPE_CHECKING:
    from bayes_ssi.measurements.modes.modal_data import ModalData
    from bayes_ssi.structures.solver_files.exported_model import ExportedModel
    from bayes_ssi.structures.solver_files.parameter_matrices import MatrixTerm, ParameterMatrices


@click.command("import")
@click.argument("name", type=PATH)
@click.option("--nominal", metavar="FILE[+MASS]",
              help="Export with nominal properties, in any format of bs.read_model; where each "
              "matrix has a file, that of the stiffness, + and that of the mass.")  # fmt: skip
@path_option("--runs", metavar="DIRECTORY",
             text="In place of exports: runs of a program that exports no matrices, a table of "
             "modes each, at the factors in design.csv.")  # fmt: skip
@click.option("--properties", metavar="NAME,…",
              help="Of --runs: those whose factors are altered; writes design.csv.")  # fmt: skip
@click.option("--design", type=click.IntRange(min=4), metavar="N",
              help="Runs in design.csv; 2, and 2 a property, if not given.")  # fmt: skip
@click.option("--changed", multiple=True, metavar="PROPERTY=FACTOR:FILE[+MASS]",
              help="Export with one property altered, as in columns=1.1:frame_columns.TXK; "
              "repeatable, also with other factors of a property.")  # fmt: skip
@click.option("--check", "checks", multiple=True, metavar="PROPERTY=FACTOR,…:FILE[+MASS]",
              help="Export with several properties altered, which must be predicted to 1e-8; "
              "repeatable.")  # fmt: skip
@click.option("--keys", metavar="STIFFNESS,MASS",
              help="Names of the two matrices in files that hold several.")  # fmt: skip
@path_option("--labels", metavar="FILE",
             text="Text file with a line such as '12 x' for every row, where the exports do not "
             "state which degree of freedom it is.")  # fmt: skip
@flag("--number-rows", text="Name rows without labels dof 1, dof 2, …")
@click.option("--data", "files", multiple=True, metavar="CSV",
              help="Identified modes; NAME.csv, to be written by you, if not given. Repeatable, "
              "with a name for each test, as in --data BC=bc.csv --data SC=sc.csv.")  # fmt: skip
@click.option("--sensor", "sensors", multiple=True, metavar="SENSOR=LABEL",
              help="Label of the degree of freedom that a sensor measures, as in 'roof=12 x', "
              "where the data do not name it so; repeatable.")  # fmt: skip
@path_option("--points", metavar="FILE",
             text="Where sensors are, of which the nearest nodes are taken: CSV with columns "
             "sensor, x_coord, y_coord, z_coord (as in the model after --units), direction.",
)  # fmt: skip
@range_option("--band", "Band of the search in Hz, where the data are a universal file.")
@click.option(
    "--units", metavar="UNITS", help="Units of the model, as in 'N, mm': turns it into N, m, kg."
)
def import_model(
    name: Path, nominal: str | None, runs: Path | None, properties: str | None,
    design: int | None, changed: tuple[str, ...], checks: tuple[str, ...], keys: str | None,
    labels: Path | None, number_rows: bool, files: tuple[str, ...], sensors: tuple[str, ...],
    points: Path | None, band: tuple[float, float] | None, units: str | None,
) -> None:  # fmt: skip
    """Write a study NAME.py and its matrices NAME_matrices/ from a program's exports.

    Stiffness and mass become sums of matrices times powers of factors of the altered properties,
    by differences of the exports; without --changed, the whole stiffness has one factor. Nothing is
    overwritten.
    """
    from bayes_ssi.measurements.modes.modal_files import read_modal_data
    from bayes_ssi.structures.solver_files.model_files import read_model
    from bayes_ssi.structures.solver_files.parameter_matrices import (
        AlteredModel,
        parameter_matrices,
    )

    study, folder = new_paths(name, ".py", "_matrices")  # refused before large files are read
    data = _data(files)
    if runs is not None:
        say(*_from_runs(study, runs, properties, design, data, band))
        return
    if nominal is None or properties or design:
        raise ValueError("give --nominal, an export, or --runs, where there are no matrices")
    tests = [read_modal_data(path, band_hz=band) for path in data.values()]
    of_sensors = named_values(
        "--sensor", sensors, "SENSOR=LABEL", r"([^=]*[^=\s])\s*=\s*(\S.*)", str
    )
    sensed = [name for modes in tests for name in modes.sensors] if tests else list(of_sensors)
    require_known("--sensor: the data have no sensor", of_sensors, sensed)
    names = None if keys is None else _keys(keys)

    def exported(text: str) -> ExportedModel:
        """The model of a file, or of that of its stiffness and, after a plus, that of its mass."""
        path, plus, mass = (text, "", "") if Path(text).exists() else text.partition("+")
        files = Path(path), Path(mass) if plus else None
        return read_model(*files, keys=names, labels=labels, units=units, numbered=number_rows)

    to_alter = [_factors_and_file(text, "--changed") for text in changed]
    to_check = [_factors_and_file(text, "--check") for text in checks]
    model = exported(nominal)
    wanted = dict.fromkeys(of_sensors.get(name, name) for name in sensed)
    tied = [label for label in wanted if label in model.dependent]
    spring = float(model.stiffness.diagonal().mean())
    model = model.with_rows(tied, spring)

    altered, checked = (
        [AlteredModel(f, factors, exported(f).with_rows(tied, spring)) for factors, f in given]
        for given in (to_alter, to_check)
    )
    if not altered:  # all of the stiffness has one factor
        doubled = replace(model, stiffness=2.0 * model.stiffness)
        altered = [AlteredModel(nominal, {"stiffness": 2.0}, doubled)]
    matrices = parameter_matrices(model, altered, checked)
    places, said = _sensors(model, tests, of_sensors, points)
    to_come = "" if data else f" Put the modes into {study.with_suffix('.csv')}."
    data = data or {"": study.with_suffix(".csv")}
    arguments = {test: _read(path, study, band) for test, path in data.items()}
    _write_study(study, folder, matrices, arguments, places)
    say(
        str(model),
        *_formulas(matrices),
        *said,
        f"Wrote {study} and its matrices.{to_come}",
        "Next:",
        *next_commands(study, *(data.values() if band is None else ())),
    )


def _from_runs(
    study: Path, runs: Path, properties: str | None, design: int | None, data: Mapping[str, Path],
    band: tuple[float, float] | None,
) -> list[str]:  # fmt: skip
    """Write the design of runs, or the study of those that were made; what is to be said."""
    from bayes_ssi.measurements.modes.run_tables import DESIGN, read_runs
    from bayes_ssi.results.result_files import write_csv
    from bayes_ssi.structures.emulation.emulated_runs import first_runs

    if properties is not None:
        names = [name.strip() for name in properties.split(",")]
        if (file := runs / DESIGN).exists():
            raise FileExistsError(f"{file}: exists already and is not overwritten")
        factors = first_runs(len(names), design).tolist()
        rows = [["run", *names], *([str(i), *map(repr, row)] for i, row in enumerate(factors, 1))]
        runs.mkdir(parents=True, exist_ok=True)
        write_csv(file, rows)
        return [
            *map(", ".join, rows),
            f"Wrote {file}. Run the program at these factors, and keep the modes of run 1 as "
            f"{runs / '1.csv'}, or as sheet 1 of a workbook there, and so on: a row for each mode, "
            "columns 'Frequency (Hz)' and the sensors. Then give --data in place of --properties.",
        ]
    if len(data) != 1:
        raise ValueError("--runs: give --properties to begin, or then --data with identified modes")
    made, (modes,) = read_runs(runs), data.values()
    text = _rendered(
        "runs.py.txt", properties=list(made["runs"]), data=_read(modes, study, band),
        runs=Path(os.path.relpath(runs, study.parent)).as_posix(),
    )  # fmt: skip
    with study.open("x", encoding="utf-8") as new:
        new.write(text)
    n, m = made["frequencies_hz"].shape
    return [
        f"{n} runs of {', '.join(made['runs'])}: {m} modes at {len(made['sensors'])} sensors.",
        f"Wrote {study}. Next:",
        *next_commands(study),
    ]


def _keys(text: str) -> tuple[str, str]:
    names = tuple(name.strip() for name in text.split(","))
    if len(names) != 2 or not all(names):
        raise ValueError(f"--keys: expected STIFFNESS,MASS, got {text!r}")
    return names[0], names[1]


def _data(files: tuple[str, ...]) -> dict[str, Path]:
    """Name of the test ("" where there is one without a name) → file of its modes."""
    data = named_values("--data", files, "[TEST=]CSV", r"(?:([^=]+)=)?([^=]+)", Path)
    if len(files) > 1 and "" in data:
        raise ValueError(f"--data: must be TEST=CSV where there are several, got {str(data[''])!r}")
    return data


def _factors_and_file(text: str, option: str) -> tuple[dict[str, float], str]:
    """Property → factor, and the file, of PROPERTY=FACTOR,PROPERTY=FACTOR:FILE."""
    pairs, colon, path = text.partition(":")
    try:
        factors = {}
        for pair in pairs.split(","):
            name, _, value = (each.strip() for each in pair.partition("="))
            if not name or name in factors:
                raise ValueError(name)
            factors[name] = float(value)
    except ValueError:
        colon = ""
    if not colon or not path:
        raise ValueError(f"{option}: expected PROPERTY=FACTOR:FILE, got {text!r}")
    return factors, path


def _formulas(matrices: ParameterMatrices) -> list[str]:
    """What stiffness and mass depend on, and how well checks are predicted."""
    lines = [
        f"{symbol} = " + " + ".join(_shown(symbol, term) for term in terms)
        for symbol, terms in (("K", matrices.stiffness), ("M", matrices.mass))
    ]
    lines += [f"{file}: predicted to {error:.1e}" for file, error in matrices.errors.items()]
    if not matrices.errors:
        lines.append("(!) No --check: that these are sums of powers of the factors is not checked.")
    return lines


def _shown(symbol: str, term: MatrixTerm) -> str:
    if not term.name:
        return f"{symbol}_0"
    power = "" if term.exponent == 1 else str(term.exponent)
    return f"{term.name}{'^' * bool(power)}{power} {symbol}_{term.name}{power}"


def _sensors(
    model: ExportedModel, tests: Sequence[ModalData], labels: Mapping[str, str],
    points_file: Path | None,
) -> tuple[dict[str, str], list[str]]:  # fmt: skip
    """Sensors of the data, or those given where there are no data yet.

    Sensor → label of the degree of freedom that it measures; and what is to be said of them.
    """
    from bayes_ssi.measurements.modes.sensors_on_model import (
        compared_with_nominal,
        nearest_degrees_of_freedom,
        read_sensor_points,
    )

    if model.labels is None:
        raise ValueError(
            "--nominal: this export has no labels, by which sensors are named: give them in a "
            "--labels file, with a line such as '12 x' for every row, or --number-rows for 'dof 1'"
        )
    measured = tuple(dict.fromkeys(name for modes in tests for name in modes.sensors))
    points = () if points_file is None else read_sensor_points(points_file)
    names = list(measured or dict.fromkeys([*(point.name for point in points), *labels]))

    nearest = nearest_degrees_of_freedom(points, model) if points else {}
    as_stated = {name: labels.get(name) or nearest.get(name, (name, 0.0))[0] for name in names}
    for name, label in as_stated.items():
        if label not in model.labels:
            raise ValueError(
                f"sensor {name!r}: no degree of freedom is labelled {label!r}; name it by --sensor "
                f"{name!r}=LABEL, with a label such as {model.labels[0]!r}"
            )
    lines = [
        f"{name}: {label}, {distance:.3g} away"
        for name, (label, distance) in nearest.items()
        if as_stated.get(name) == label
    ]
    for modes in tests:
        lines += compared_with_nominal(model, modes, as_stated)
    return as_stated, lines


LABELS = "labels.txt"


def _write_study(
    study: Path, folder: Path, matrices: ParameterMatrices, tests: Mapping[str, str],
    places: Mapping[str, str],
) -> None:  # fmt: skip
    """Write a study and a folder of its matrices; ``tests`` are how it reads the data of each."""
    import scipy.sparse as sp

    from bayes_ssi.results.result_files import new_directory, write_csv
    from bayes_ssi.structures.modal import BATCHED_UP_TO

    def name(symbol: str, term: MatrixTerm) -> str:
        power = [] if term.exponent in (0, 1) else [str(term.exponent)]
        return "_".join([symbol, *([term.name] if term.name else []), *power])

    terms = {name("K", term): term for term in matrices.stiffness}
    terms |= {name("M", term): term for term in matrices.mass}
    files = file_names(terms, "npz")
    model = matrices.nominal
    in_si = model.units == "N, m, kg"
    text = _rendered(
        "imported.py.txt",
        model=model,
        folder=folder.name,
        tests=tests,
        sensors={name: label for name, label in places.items() if name != label},
        properties=list(dict.fromkeys(term.name for term in terms.values() if term.name)),
        stiffness=[(term, files[name("K", term)]) for term in matrices.stiffness],
        mass=[(term, files[name("M", term)]) for term in matrices.mass],
        unit="m" if in_si else "",
        mass_unit="kg" if in_si else "",
        is_large=model.size > BATCHED_UP_TO,
    )
    with new_directory(folder, marker=LABELS) as partial:
        for one, term in terms.items():
            sp.save_npz(partial / files[one], term.matrix)
        (partial / LABELS).write_text("\n".join([*(model.labels or ()), ""]), encoding="utf-8")
        if (geometry := model.geometry) is not None:
            nodes = ([node, *map(repr, at)] for node, at in geometry.nodes.items())
            write_csv(partial / "nodes.csv", nodes)
            write_csv(partial / "lines.csv", geometry.lines)
            write_csv(partial / "faces.csv", geometry.faces)
        with study.open("x", encoding="utf-8") as file:
            file.write(text)


def _rendered(template: str, **values: Any) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {"quoted": _quoted, "docstring": in_a_docstring}
    return environment.get_template(template).render(command=command_line(), **values)


def _quoted(value: Any) -> str:
    """Text or a list of texts as Python writes it, in double quotes."""
    return json.dumps(value, ensure_ascii=False)


def _read(data: Path, study: Path, band_hz: tuple[float, float] | None) -> str:
    """The arguments by which the study reads its data, relative to it in the same folder."""
    path = f"Path({_quoted(str(data.resolve()))})"
    if data.resolve().parent == study.resolve().parent:
        path = f"here.with_name({_quoted(data.name)})"
    return path if band_hz is None else f"{path}, band_hz={band_hz}"
