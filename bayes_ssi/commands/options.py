"""Arguments and options that several commands have."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from bayes_ssi.studies.ranking.study import Study

T = TypeVar("T")

PATH = click.Path(path_type=Path)
Command = Callable[..., Any]
Decorator = Callable[[Command], Command]


def path_option(*names: str, text: str, **more: Any) -> Decorator:
    return click.option(*names, type=PATH, help=text, **more)


def default_option(name: str, default: Any, text: str, kind: Any = None) -> Decorator:
    return click.option(name, type=kind, default=default, show_default=True, help=text)


def number_option(name: str, metavar: str, text: str) -> Decorator:
    return click.option(name, type=float, metavar=metavar, help=text)


def range_option(name: str, text: str, **more: Any) -> Decorator:
    return click.option(name, type=(float, float), metavar="LOW HIGH", help=text, **more)


def flag(*names: str, text: str) -> Decorator:
    return click.option(*names, is_flag=True, help=text)


def repeated_option(name: str, argument: str, metavar: str, text: str) -> Decorator:
    return click.option(name, argument, metavar=metavar, multiple=True, help=text)


study_argument = click.argument("study", type=PATH)
result_argument = click.argument("result", type=PATH)
files_argument = click.argument("files", type=PATH, nargs=-1, required=True)
# Of a result, whose structures are those of the study file.
study_option = path_option(
    "--study", text="Study file, if it has moved since the result was saved."
)
configuration_option = click.option("--configuration", metavar="NAME",
    help="Configuration of the structure, if several were tested.")  # fmt: skip
modes_option = path_option("--out", text="CSV file for the modes, a new one.")


def renamed(old: str, new: str) -> Decorator:
    """An option that was called otherwise: one line says how it is called now."""

    def refuse(_: click.Context, __: click.Parameter, given: Sequence[str]) -> None:
        if given:
            raise click.UsageError(f"{old} is now {new}")

    own = f"was_{old.strip('-')}"  # no argument's name
    return click.option(
        old, own, multiple=True, hidden=True, expose_value=False, is_eager=True, callback=refuse
    )


def classes_option(text: str, old: str = "--only") -> Decorator:
    """Model classes of a study, by name; ``old`` is what the option was called."""
    option = click.option("--class", "names", metavar="NAME,…", multiple=True, help=text)
    return lambda command: applied(command, option, renamed(old, "--class"))


def seed_option(text: str) -> Decorator:
    return default_option("--seed", 0, text, click.IntRange(min=0))


def named_paths(paths: Sequence[Path]) -> dict[str, Path]:
    """Name → path of several results or files; names are whole paths where two are alike."""
    for i, path in enumerate(paths):
        if path in paths[:i]:
            raise ValueError(f"{path}: given twice")
    names = [path.name for path in paths]
    unique = len(set(names)) == len(names)
    return dict(zip(names if unique else map(str, paths), paths, strict=True))


def named_values(
    option: str, texts: Sequence[str], wanted: str, form: str, read: Callable[[str], T]
) -> dict[str, T]:
    """Name → value, from texts of an option, whose ``form`` is a regular expression."""
    items: dict[str, T] = {}
    for text in texts:
        match = re.fullmatch(form, text.strip())
        if match is None:
            raise ValueError(f"{option}: must be {wanted}, got {text!r}")
        name, value = (match[1] or "").strip(), match[2].strip()
        if name in items:
            raise ValueError(f"{option}: {name!r} is given twice")
        try:
            items[name] = read(value)
        except ValueError as error:
            raise ValueError(f"{option}: {error}") from None
    return items


def load(path: Path, names: Sequence[str] = ()) -> Study:
    """The study from a file, with all its model classes or only the listed ones."""
    from bayes_ssi.studies.ranking.study import load_study

    study = load_study(path)
    return study.only(listed_names(study, names)) if names else study


def listed_names(study: Study, texts: Sequence[str]) -> list[str]:
    """Names of model classes, one or several in each text."""
    # A name may itself hold commas.
    parts = [[text] if text in study.names else text.split(",") for text in texts]
    return [name.strip() for part in parts for name in part if name.strip()]


def read_covariate(path: Path) -> tuple[str, dict[str, float]]:
    """Name and values of a covariate: name of a test → value.

    The file has two columns, the tests and the covariate, and a heading for each; the second one
    names the covariate::

        test, temperature in °C
        2026-01-14, -3.5
        2026-04-02, 11
    """
    from bayes_ssi.foundations.text_files import read_table

    try:
        columns, rows = read_table(path)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    if len(columns) != 2 or not columns[1]:
        got = columns or "nothing"
        raise ValueError(f"{path}: the first line must be 'test, NAME OF THE COVARIATE', got {got}")
    name, values = columns[1], {}
    for where, row in rows:
        if len(row) != 2 or not row[0]:
            raise ValueError(f"{where}: expected a test and its {name}, got {','.join(row)!r}")
        if row[0] in values:
            raise ValueError(f"{where}: a second value for test {row[0]!r}")
        try:
            values[row[0]] = float(row[1])
        except ValueError:
            raise ValueError(f"{where}: {name} must be a number, got {row[1]!r}") from None
    return name, values


def applied(command: Command, *options: Decorator) -> Command:
    """The command with options, which the help lists in this order."""
    for option in reversed(options):
        command = option(command)
    return command


def gathered(
    command: Command, argument: str, made: Callable[..., Any], options: Mapping[str, Decorator]
) -> Command:
    """The command with options whose values, by their names, become one of its arguments."""

    @functools.wraps(command)
    def wrapped(**values: Any) -> None:
        own = {name: values.pop(name) for name in options}
        command(**{argument: made(**own)}, **values)

    return applied(wrapped, *options.values())


def record_options(command: Command) -> Command:
    """What the files of a vibration record do not state, as arguments of ``read_record``."""
    options: dict[str, Decorator] = {
        "rate_hz": click.option(
            "--rate", "rate_hz", type=float,
            help="Samples per second, if the files do not state it."),
        "quantity": click.option(
            "--quantity",
            help="acceleration, velocity or displacement, if not stated."),
        "unit": click.option("--unit", help="Unit of the samples, if not stated."),
        "sensors": repeated_option(
            "--sensor", "sensors", "NAME",
            "Name of a sensor, for all in their order, in place of the files' own names."),
        "keys": repeated_option(
            "--key", "keys", "NAME",
            "Array of a .mat (data.acc in a structure), .npz or HDF5 file, group of a TDMS file or "
            "sheet of a workbook; may be repeated."),
    }  # fmt: skip

    def stated(sensors: tuple[str, ...], **others: Any) -> dict[str, Any]:
        return {"sensors": sensors or None, **others}

    return gathered(command, "stated", stated, options)
