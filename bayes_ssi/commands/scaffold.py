"""Example studies: a commented study and its identified modes, which run unchanged.

The modes are those of a shear building of three storeys with unit masses, its first frequency
1 Hz and its second storey 20 % softer, with identification errors of half a per cent.
"""

from __future__ import annotations

import shlex
from pathlib import Path

KINDS = ("shear-building", "matrices", "function")
TEMPLATES = Path(__file__).with_name("templates")


def write_study(name: str | Path, kind: str) -> tuple[Path, Path]:
    """Write a study and its data.

    Args:
        name: name of the files, with or without ``.py``; its directory must exist.
        kind: one of ``KINDS``.

    Returns:
        The paths of the study and of the data.
    """
    path = Path(name)
    path = path.with_suffix("") if path.suffix == ".py" else path
    if not path.name or not path.name.isprintable():
        raise ValueError(f"name of the study: {str(name)!r} is not a file name")
    study, data = (path.with_name(path.name + suffix) for suffix in (".py", ".csv"))
    for file in (study, data):
        if file.exists():
            raise FileExistsError(f"{file}: exists already and is not overwritten")
    template = (TEMPLATES / f"{kind}.py.txt").read_text("utf-8")
    for own in (study, data):
        template = template.replace(f"NAME{own.suffix}", _in_a_docstring(shlex.quote(own.name)))
    for file, text in (
        (data, (TEMPLATES / "modes.csv").read_text("utf-8")),
        (study, template),
    ):
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    return study, data


def _in_a_docstring(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')
