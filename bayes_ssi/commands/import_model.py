"""``bayes-ssi import``: a study from exports of a finite-element program."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bayes_ssi.commands.options import PATH, named_values, number_option, path_option, range_option
from bayes_ssi.commands.terminal import command_line, console, say

if TYPE_CHECKING:
    from bayes_ssi.structures.solver_files.exported_model import ExportedModel
    from bayes_ssi.structures.solver_files.parameter_matrices import (
        AlteredModel,
        ParameterMatrices,
        Powers,
    )


@click.command("import")
@click.argument("name", type=PATH)
@click.option("--nominal", required=True, metavar="FILE[+MASS]",
              help="Export with nominal properties, in any format of bs.read_model; where each "
              "matrix has a file, that of the stiffness, + and that of the mass.")  # fmt: skip
@click.option("--changed", multiple=True, metavar="PROPERTY=FACTOR:FILE[+MASS]",
              help="Export with one property altered, as in columns=1.1:frame_columns.TXK; "
              "repeatable, also with other factors of a property, and with two properties whose "
              "product matters, as in E=1.1,t=1.2:both.TXK.")  # fmt: skip
@click.option("--check", "checks", multiple=True, metavar="PROPERTY=FACTOR,…:FILE[+MASS]",
              help="Export with several properties altered, which must be predicted to 1e-8; "
              "repeatable.")  # fmt: skip
@click.option("--keys", metavar="STIFFNESS,MASS",
              help="Names of the two matrices in files that hold several.")  # fmt: skip
@path_option("--labels", metavar="FILE",
             text="Text file with a line such as '12 x' for every row, where the exports do not "
             "state which degree of freedom it is.")  # fmt: skip
@click.option("--data", "files", multiple=True, metavar="[TEST=]CSV",
              help="Identified modes; NAME.csv, to be written by you, if not given. Repeatable, "
              "with a name for each test, as in --data BC=bc.csv --data SC=sc.csv.")  # fmt: skip
@click.option("--sensor", "sensors", multiple=True, metavar="SENSOR=LABEL",
              help="Label of the degree of freedom that a sensor measures, as in 'roof=12 x', "
              "where the data do not name it so; repeatable.")  # fmt: skip
@path_option(
    "--points", metavar="FILE",
    text="Where sensors are, of which the nearest nodes are taken: CSV with columns sensor, "
    "x_coord, y_coord, z_coord, direction, or the universal file of the data.",
)  # fmt: skip
@click.option(
    "--points-scale", type=float, default=1.0, show_default=True, metavar="FACTOR",
    help="Factor of these coordinates, to those of the model after --units.",
)  # fmt: skip
@range_option("--band", "Band of the search in Hz, where the data are a universal file.")
@click.option(
    "--units", metavar="UNITS", help="Units of the model, as in 'N, mm': turns it into N, m, kg."
)
@number_option(
    "--mass-kg", "KG", "The structure's mass, known to a factor of 2: refuses other units."
)
def import_model(
    name: Path,
    nominal: str,
    changed: tuple[str, ...],
    checks: tuple[str, ...],
    keys: str | None,
    labels: Path | None,
    files: tuple[str, ...],
    sensors: tuple[str, ...],
    points: Path | None,
    points_scale: float,
    band: tuple[float, float] | None,
    units: str | None,
    mass_kg: float | None,
) -> None:
    """Write a study NAME.py and its matrices NAME_matrices/ from a program's exports.

    Stiffness and mass become sums of matrices times powers of factors of the altered properties,
    by differences of the exports. Nothing is overwritten.
    """
    from bayes_ssi.commands.imported_study import ENDINGS, imported_sensors, write_imported_study
    from bayes_ssi.commands.new import new_paths
    from bayes_ssi.measurements.modes.modal_files import read_modal_data
    from bayes_ssi.structures.solver_files.model_files import read_model
    from bayes_ssi.structures.solver_files.parameter_matrices import (
        AlteredModel,
        parameter_matrices,
    )

    new_paths(name, *ENDINGS)  # refused before large files are read
    data = _data(files)
    tests = [read_modal_data(path, band_hz=band) for path in data.values()]
    of_sensors = named_values(
        "--sensor", sensors, "SENSOR=LABEL", r"([^=]*[^=\s])\s*=\s*(\S.*)", str
    )
    if not changed:
        raise ValueError("--changed: give at least one export with an altered property")
    names = None if keys is None else _keys(keys)

    def exported(text: str, known_kg: float | None = None) -> ExportedModel:
        path, mass = _model_files(text)
        return read_model(path, mass, keys=names, labels=labels, units=units, mass_kg=known_kg)

    model = exported(nominal, mass_kg)
    measured = [name for modes in tests for name in modes.sensors] if tests else list(of_sensors)
    wanted = dict.fromkeys(of_sensors.get(name, name) for name in measured)
    tied = [label for label in wanted if label in model.dependent]
    spring = float(model.stiffness.diagonal().mean())
    model = model.with_rows(tied, spring)

    def read(text: str, option: str) -> AlteredModel:
        factors, file = _factors_and_file(text, option)
        return AlteredModel(file, factors, exported(file).with_rows(tied, spring))

    matrices = parameter_matrices(
        model,
        [read(text, "--changed") for text in changed],
        [read(text, "--check") for text in checks],
    )
    places, said = imported_sensors(model, tests, of_sensors, points, points_scale)
    study, modes_files = write_imported_study(name, matrices, data, band, places, command_line())
    to_come = "" if data else f" Put the modes into {modes_files[0]}."
    say(
        console(),
        str(model),
        *_formulas(matrices),
        *said,
        f"Wrote {study} and its matrices.{to_come}",
        "Next:",
        *(
            f"  {shlex.join(['bayes-ssi', 'check', str(file)])}"
            for file in modes_files
            if band is None
        ),
        f"  {shlex.join(['bayes-ssi', 'rank', str(study)])}",
    )


def _keys(text: str) -> tuple[str, str]:
    names = tuple(name.strip() for name in text.split(","))
    if len(names) != 2 or not all(names):
        raise ValueError(f"--keys: expected STIFFNESS,MASS, got {text!r}")
    return names[0], names[1]


def _model_files(text: str) -> tuple[Path, Path | None]:
    """The file of the model or of its stiffness, and that of its mass if it is named."""
    stiffness, plus, mass = text.partition("+")
    if not plus or Path(text).exists():
        return Path(text), None
    return Path(stiffness), Path(mass)


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
        f"{symbol} = " + " + ".join(_shown(symbol, term.powers) for term in terms)
        for symbol, terms in (("K", matrices.stiffness), ("M", matrices.mass))
    ]
    lines += [f"{file}: predicted to {error:.1e}" for file, error in matrices.errors.items()]
    if not matrices.errors:
        lines.append("(!) No --check: that these are sums of powers of the factors is not checked.")
    return lines


def _shown(symbol: str, powers: Powers) -> str:
    if not powers:
        return f"{symbol}_0"
    factors = " ".join(name if e == 1 else f"{name}^{e}" for name, e in powers)
    names = "_".join(name if e == 1 else f"{name}{e}" for name, e in powers)
    return f"{factors} {symbol}_{names}"
