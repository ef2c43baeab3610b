"""Loading the study that a Python file defines; errors name the file and the line."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.error_places import own_lines
from bayes_ssi.inference.workers.remote import STUDY_MODULE
from bayes_ssi.studies.ranking.study import Study

# Packages that studies import, and the extras of this one that install them.
EXTRAS = {"openseespy": "opensees", "skfem": "fem"}


@checked
def load_study(path: str | Path) -> Study:
    """The one :class:`Study` that a Python file defines.

    Raises:
        ValueError: there is no such file, it is not Python, it raises an error, or it defines no
            study or several; the message gives the file, and the line where there is one.
    """
    path = Path(path)
    if not path.is_file():
        what = "a directory, not a study file" if path.is_dir() else "no such file"
        raise ValueError(f"{path}: {what}")
    spec = importlib.util.spec_from_file_location(f"{STUDY_MODULE}{path.stem}", path)
    if path.suffix != ".py" or spec is None:
        raise ValueError(f"{path}: a study is a Python file, its name ending in .py")
    try:
        names = _run(spec)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever a user's file may raise
        raise ValueError(f"{path}: {_explained(error, str(spec.origin))}") from error
    # A study may have several names.
    studies: dict[int, tuple[str, Study]] = {}
    for name, value in names.items():
        if isinstance(value, Study):
            studies.setdefault(id(value), (name, value))
    if not studies:
        raise ValueError(
            f"{path}: defines no study; end it with a line such as "
            'study = bayes_ssi.Study("title", [model_class, ...])'
        )
    if len(studies) > 1:
        names_of_studies = ", ".join(name for name, _ in studies.values())
        raise ValueError(f"{path}: defines several studies, {names_of_studies}; keep one in a file")
    ((_, study),) = studies.values()
    return study


def _run(spec: ModuleSpec) -> Mapping[str, Any]:
    module = importlib.util.module_from_spec(spec)
    # Dataclasses and pickles defined in a study look their module up by name.
    sys.modules[spec.name] = module
    # No cached bytecode: the file may have changed since, and nothing is written next to it.
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        assert spec.loader is not None
        spec.loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = writes
    return vars(module)


def _explained(error: BaseException, study: str) -> str:
    """What a study's file raised, and on which line of it, in one line.

    An error raised in a module that the study calls has the file and line in it, too.
    """
    lines = own_lines(error)
    of_study = [line for file, line in lines if file == study]
    if not of_study:  # it never ran
        line = getattr(error, "lineno", None)
        where = f"line {line}: " if line else ""
        return f"{where}not Python: {_one_line(getattr(error, 'msg', error))}"
    where = f"line {of_study[-1]}: "
    file, line = lines[-1]
    if file != study:
        where += f"{Path(file).name}, line {line}: "
    return f"{where}{type(error).__name__}: {_one_line(error)}{_remedy(error)}"


def _remedy(error: BaseException) -> str:
    """Advice on installing a finite-element program that a study imports."""
    package = (error.name or "").partition(".")[0] if isinstance(error, ImportError) else ""
    return f'; pip install "bayes_ssi[{EXTRAS[package]}]"' if package in EXTRAS else ""


def _one_line(message: object) -> str:
    return " ".join(str(message).split())
