"""Nastran: matrices punched as DMIG entries of the bulk data.

MSC Nastran Quick Reference Guide, DMIG and GRID; ``PARAM, EXTOUT, DMIGPCH`` and ``EXTSEOUT (…,
DMIGPCH)`` punch them, as KAAX and MAAX. A header entry gives the form (1 square, 6 symmetric, of
which one triangle is stated) and the type (1 or 2, real); each column entry a point and a component
(1 to 6, 0 for scalar points), then point, component and value of each row. Fields are 8 or 16
characters wide, or separated by commas.

Restrained, dependent and condensed degrees of freedom have no rows in the analysis set.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from bayes_ssi.structures.geometry import Geometry, Point
from bayes_ssi.structures.solver_files.exported_model import Matrices, Source
from bayes_ssi.structures.solver_files.solver_text import (
    DIRECTIONS,
    label,
    matrix_of_entries,
    numbered_lines,
    require_whole_lines,
)

# An exponent without its letter, as in 2.5+10.
_BARE_EXPONENT = re.compile(r"(?<=[\d.])([+-]\d+)$")

Place = tuple[int, int]


@dataclass
class _Entries:
    form: int
    kind: int
    stated: list[tuple[Place, Place, float]] = field(default_factory=list)  # row, column, value


def read_punch(source: Source) -> Matrices:
    """Stiffness and mass among the matrices of one file, or of two."""
    matrices, nodes, notes = _entries(source.path)
    if source.mass is not None:
        others, more, _ = _entries(source.mass)
        repeated = matrices.keys() & others.keys()
        if repeated:
            raise ValueError(f"{source.mass}: {min(repeated)} is in {source.path} as well")
        matrices, nodes = {**matrices, **others}, {**nodes, **more}
    names = tuple(matrices)
    pair = [names[i] for i in source.pair(names)]
    chosen = [matrices[name] for name in pair]
    where = [f"{source.path}: {name}" for name in pair]
    places = sorted({place for each in chosen for one in each.stated for place in one[:2]})
    position = {place: i for i, place in enumerate(places)}
    return Matrices(
        [_assembled(each, position, name) for each, name in zip(chosen, where, strict=True)],
        where,
        labels=[
            label(point, component) if 1 <= component <= len(DIRECTIONS) else str(point)
            for point, component in places
        ],
        geometry=Geometry(nodes) if nodes else None,
        notes=("restrained and condensed degrees of freedom have no rows", *notes),
    )


def _assembled(entries: _Entries, position: dict[Place, int], name: str) -> sp.csc_array:
    if entries.form not in (1, 6):
        raise ValueError(f"{name} must be symmetric (form 6) or square (1), got {entries.form}")
    if entries.kind not in (1, 2):
        raise ValueError(f"{name} must be real (type 1 or 2), got {entries.kind}")
    places = [[position[row], position[column]] for row, column, _ in entries.stated]
    rows = np.array(places, dtype=np.intp).reshape(-1, 2)
    values = np.array([value for *_, value in entries.stated])
    return matrix_of_entries(name, rows, values, len(position), is_whole=entries.form == 1)


def _entries(path: Path) -> tuple[dict[str, _Entries], dict[str, Point], tuple[str, ...]]:
    """Matrices by name, nodes with coordinates in the basic system, and notes."""
    require_whole_lines(path)
    matrices: dict[str, _Entries] = {}
    nodes: dict[str, Point] = {}
    turned: set[str] = set()
    for number, fields in _cards(path):
        try:
            if fields[0] == "DMIG":
                _add(matrices, fields)
            else:
                _add_node(nodes, turned, fields)
        except (ValueError, IndexError, KeyError):
            raise ValueError(
                f"{path}: line {number}: not a {fields[0]} entry: "
                f"{' '.join(' '.join(fields).split()):.60}"
            ) from None
    if not matrices:
        raise ValueError(f"{path}: no DMIG entry; was the punch of matrices requested?")
    note = (
        f"{len(turned)} points move in coordinate systems of their own, in which their directions "
        "are",
    )
    return matrices, nodes, note if turned else ()


def _cards(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and fields of each DMIG and GRID entry, with its continuations."""
    start = 0
    card: list[str] = []
    for number, line in numbered_lines(path):
        text = line.partition("$")[0].rstrip()
        if not text:
            continue
        fields = _fields(text)
        if fields[0] in ("", "*", "+"):
            if card:
                card += fields[1:]
            continue
        if card:
            yield start, card
        start, card = number, fields if fields[0] in ("DMIG", "GRID") else []
    if card:
        yield start, card


def _fields(text: str) -> list[str]:
    """The name of an entry and its fields: 4 of 16 characters after a name with a star, else 8."""
    if "," in text:
        name, *values = (each.strip() for each in text.split(","))
        return [name.rstrip("*").upper() or "*", *values]
    name = text[:8].strip().upper()
    count, width = (4, 16) if "*" in name else (8, 8)
    values = [text[8 + i * width : 8 + (i + 1) * width].strip() for i in range(count)]
    first = name.rstrip("*").strip()
    return ["*" if first[:1] in ("", "+", "*") else first, *values]


def _add(matrices: dict[str, _Entries], fields: list[str]) -> None:
    name = fields[1].upper()
    if fields[2] == "0":
        matrices[name] = _Entries(form=int(fields[3]), kind=int(fields[4]))
        return
    entries = matrices[name]
    column = (int(fields[2]), int(fields[3] or 0))
    for i in range(5, len(fields), 4):
        point, component, value = (*fields[i : i + 3], "", "")[:3]
        if point:
            entries.stated.append(((int(point), int(component or 0)), column, _real(value)))


def _add_node(nodes: dict[str, Point], turned: set[str], fields: list[str]) -> None:
    name, system, *values = (*fields[1:7], "", "", "", "", "")[:6]
    if values[3] not in ("", "0"):
        turned.add(name)
    if system in ("", "0"):
        x, y, z = (_real(each) if each else 0.0 for each in values[:3])
        nodes[name] = (x, y, z)


def _real(text: str) -> float:
    return float(_BARE_EXPONENT.sub(r"e\1", text.upper().replace("D", "E")))
