"""``bayes-ssi new``: a small study to start from.

Example studies: a commented study and its identified modes, which run unchanged.

The modes are those of a shear building of three storeys with unit masses, its first frequency
1 Hz and its second storey 20 % softer, with identification errors of half a per cent.
"""

import shlex
from pathlib import Path

import click

from bayes_ssi.commands import options, terminal

KINDS = ("shear-building", "matrices", "function")
TEMPLATES = Path(__file__).with_name("templates")


def new_paths(name: Path, *endings: str) -> tuple[Path, ...]:
    """Paths of a study named with or without ``.py``, none of which exists."""
    name = name.with_suffix("") if name.suffix == ".py" else name
    if not name.name or not name.name.isprintable():
        raise ValueError(f"name of the study: {str(name)!r} is not a file name")
    paths = tuple(name.with_name(name.name + ending) for ending in endings)
    for path in paths:
        if path.exists():
            raise FileExistsError(f"{path}: exists already and is not overwritten")
    return paths


def next_commands(study: Path, *data: Path) -> list[str]:
    """To check files of modes, and to rank a study of them."""
    commands = [*(("check", file) for file in data), ("rank", study)]
    return [f"  {shlex.join(['bayes-ssi', what, str(path)])}" for what, path in commands]


def in_a_docstring(text: str) -> str:
    """The text as it is written there, in Python."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


@click.command()
@click.argument("name", type=options.PATH)
@options.default_option("--kind", KINDS[0], "Kind of structure: storeys and floors, matrices of a "
                "finite-element program, or a Python function (around OpenSees, for instance).",
                click.Choice(KINDS))  # fmt: skip
def new(name: Path, kind: str) -> None:
    """Write an example study NAME.py and its identified modes NAME.csv, to adapt to your own.

    The example runs unchanged: bayes-ssi rank NAME.py. Where NAME.csv has modes of yours, such as
    identify wrote, the study reads these. Existing files are not overwritten.
    """
    from bayes_ssi.measurements.modes.modal_files import read_modal_data

    (study,) = new_paths(name, ".py")
    data = study.with_suffix(".csv")
    template = (TEMPLATES / f"{kind}.py.txt").read_text("utf-8")
    for own in (study, data):
        template = template.replace(f"NAME{own.suffix}", in_a_docstring(shlex.quote(own.name)))
    files, said = {study: template}, f"Wrote {study} and {data}. Next:"
    if data.exists():
        sensors = ", ".join(map(repr, read_modal_data(data).sensors))
        said = (
            f"Wrote {study}, which reads {data}. Give it your structure, whose degrees of freedom "
            f"or sensors are named {sensors}, and say which mode is which. Next:"
        )
    else:
        files = {data: (TEMPLATES / "modes.csv").read_text("utf-8"), **files}
    for file, text in files.items():
        with file.open("x", encoding="utf-8") as written:
            written.write(text)
    terminal.say(said, *next_commands(study, data))
