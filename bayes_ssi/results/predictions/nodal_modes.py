"""Modes of a structure at all of its nodes, as other programs draw them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.results.result_files import write_csv
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.structures.solver_files.solver_text import DIRECTIONS, INTERNAL
from bayes_ssi.structures.structure import Structure


class NoNodesError(ValueError):
    """No degree of freedom is of a node."""


@dataclass(frozen=True, eq=False)
class NodalModes:
    nodes: tuple[str, ...]
    positions: FloatArray  # (n_nodes, 3), x, y and z; NaN where they are not known
    # The structure's, with lines and faces between some of the nodes; None if it has none.
    geometry: Geometry | None
    frequencies_hz: FloatArray  # (n_modes,)
    # (n_modes, n_nodes, 6), along x, y, z and about them, the largest displacement of a mode being
    # 1; zero where the model has no row, as where a node is restrained.
    displacements: FloatArray


def nodal_modes(structure: Structure, values: FloatArray) -> NodalModes:
    """Modes at ``values`` (n_parameters,), of the exact model where it is approximated.

    Degrees of freedom are labelled "node direction", such as ``12 x``; others, of elements on the
    structure for instance, have no node.
    """
    labels, frequencies, shapes = structure.labelled_modes(values)
    places = [_place(label) for label in labels]
    moving = dict.fromkeys(place[0] for place in places if place is not None)
    if not moving:
        raise NoNodesError(
            f"no degree of freedom is labelled 'node direction', such as '12 x'; labels are "
            f"{', '.join(map(repr, labels[:3]))}, …"
        )
    geometry = structure.geometry
    known = {} if geometry is None else geometry.nodes
    nodes = tuple(dict.fromkeys([*known, *moving]))  # restrained nodes are drawn, too
    number = {node: i for i, node in enumerate(nodes)}
    displacements = np.zeros((len(frequencies), len(nodes), len(DIRECTIONS)))
    for row, place in enumerate(places):
        if place is not None:
            displacements[:, number[place[0]], place[1]] = shapes[row]
    largest = abs(displacements[:, :, :3]).max(axis=(1, 2))
    return NodalModes(
        nodes,
        np.array([known.get(node, (np.nan,) * 3) for node in nodes]),
        geometry,
        frequencies,
        displacements / np.where(largest > 0.0, largest, 1.0)[:, None, None],
    )


def _place(label: str) -> tuple[str, int] | None:
    """Node and number of the direction, from 0; None where the label names none."""
    node, _, last = label.rpartition(" ")
    if not node or node.startswith(f"{INTERNAL} ") or last not in DIRECTIONS:
        return None
    return node, DIRECTIONS.index(last)


def write_modes_csv(path: Path, modes: NodalModes) -> None:
    """A row for each node: its coordinates, and each mode in the directions in which any moves.

    Columns are node, x_coord, y_coord, z_coord and, mode by mode, ``mode 1 x`` and so on; a row
    of comment states the frequencies in Hz.
    """
    moving = np.flatnonzero(modes.displacements.any(axis=(0, 1)))
    numbers = range(1, len(modes.frequencies_hz) + 1)
    columns = [f"mode {mode} {DIRECTIONS[i]}" for mode in numbers for i in moving]
    rows = [["node", "x_coord", "y_coord", "z_coord", *columns]]
    for i, node in enumerate(modes.nodes):
        at = ["" if np.isnan(x) else repr(x) for x in modes.positions[i].tolist()]
        shown = modes.displacements[:, i, moving].ravel().tolist()
        rows.append([node, *at, *(f"{component:.9g}" for component in shown)])
    write_csv(path, ["# frequencies_hz", *map(repr, modes.frequencies_hz.tolist())], rows)


def node_numbers(modes: NodalModes) -> list[int]:
    """Numbers of the nodes in a universal file: their own, or from 1 if some have none."""
    if all(node.isdecimal() and int(node) > 0 for node in modes.nodes):
        return [int(node) for node in modes.nodes]
    return list(range(1, len(modes.nodes) + 1))


def write_universal_file(path: Path, modes: NodalModes, title: str) -> None:
    """Nodes (15), lines and sides of faces (82), where coordinates are known, and modes (55).

    The formats are those of the Structural Dynamics Research Laboratory, University of Cincinnati,
    "Universal File Formats for Modal Analysis Testing"; numbers have six digits. Nodes that are not
    numbered are numbered from 1, in their order.
    """
    numbers = node_numbers(modes)
    known = ~np.isnan(modes.positions).any(axis=1)
    with path.open("x", encoding="ascii", errors="replace") as file:
        if known.any():
            lines_of_nodes = [
                _whole(numbers[i], 0, 0, 0) + _real(*modes.positions[i].tolist())
                for i in np.flatnonzero(known).tolist()
            ]
            file.write(_data_set(15, lines_of_nodes))
        number = dict(zip(modes.nodes, numbers, strict=True))
        edges = modes.geometry.edges if modes.geometry is not None else ()
        most = 250 // 3  # a data set 82 holds 250 entries, of which a line takes two and a zero
        for trace, start in enumerate(range(0, len(edges), most), 1):
            # Zero moves to the next node without drawing.
            lines = edges[start : start + most]
            entries = [n for a, b in lines for n in (number[a], number[b], 0)][:-1]
            rows = [_whole(*entries[i : i + 8]) for i in range(0, len(entries), 8)]
            file.write(_data_set(82, [_whole(trace, len(entries), 1), f"lines {trace}", *rows]))
        for mode in range(len(modes.frequencies_hz)):
            file.write(_data_set(55, _mode_lines(numbers, modes, mode, title)))


def _data_set(kind: int, lines: Iterable[str]) -> str:
    return "\n".join(["    -1", f"{kind:6d}", *lines, "    -1", ""])


def _whole(*numbers: int) -> str:
    return "".join(f"{each:10d}" for each in numbers)


def _real(*numbers: float) -> str:
    return "".join(f"{each:13.5E}" for each in numbers)


def _mode_lines(numbers: Sequence[int], modes: NodalModes, mode: int, title: str) -> Iterator[str]:
    frequency = float(modes.frequencies_hz[mode])
    yield title[:80] or "NONE"
    yield from ["NONE"] * 3
    yield f"Mode {mode + 1}, {frequency:.6g} Hz"
    # Structural model, normal modes, six components, displacements, real; and their number.
    yield _whole(1, 2, 3, 8, 2, len(DIRECTIONS))
    yield _whole(2, 4, 1, mode + 1)
    yield _real(frequency, 0.0, 0.0, 0.0)  # modal mass and damping are not stated
    for number, shape in zip(numbers, modes.displacements[mode].tolist(), strict=True):
        yield _whole(number)
        yield _real(*shape)
