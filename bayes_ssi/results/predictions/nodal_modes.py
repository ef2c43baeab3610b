"""Modes of a structure at all of its nodes, as other programs draw them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.results.result_files import write_csv
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.structures.solver_files.solver_text import DIRECTIONS, INTERNAL
from bayes_ssi.structures.structure import Structure


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


def nodal_modes(structure: Structure, values: FloatArray) -> NodalModes | None:
    """Modes at ``values`` (n_parameters,), of the exact model; None where it has no nodes.

    Degrees of freedom are labelled "node direction", such as ``12 x``; others, of elements on the
    structure for instance, have no node.
    """
    labels, frequencies, shapes = structure.labelled_modes(values)
    places = [_place(label) for label in labels]
    moving = dict.fromkeys(place[0] for place in places if place is not None)
    if not moving:
        return None
    geometry = structure.geometry
    known = {} if geometry is None else geometry.nodes
    nodes = tuple(dict.fromkeys([*known, *moving]))  # restrained nodes are drawn, too
    number = {node: i for i, node in enumerate(nodes)}
    displacements = np.zeros((len(frequencies), len(nodes), len(DIRECTIONS)))
    for row, place in enumerate(places):
        if place is not None:
            displacements[:, number[place[0]], place[1]] = shapes[row]
    largest = abs(displacements[:, :, :3]).max(axis=(1, 2))
    displacements /= np.where(largest > 0.0, largest, 1.0)[:, None, None]
    positions = np.array([known.get(node, (np.nan,) * 3) for node in nodes])
    return NodalModes(nodes, positions, geometry, frequencies, displacements)


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
    rows = [
        ["# frequencies_hz", *map(repr, modes.frequencies_hz.tolist())],
        ["node", "x_coord", "y_coord", "z_coord", *columns],
    ]
    for i, node in enumerate(modes.nodes):
        at = ["" if np.isnan(x) else repr(x) for x in modes.positions[i].tolist()]
        shown = modes.displacements[:, i, moving].ravel().tolist()
        rows.append([node, *at, *(f"{component:.9g}" for component in shown)])
    write_csv(path, rows)


def node_numbers(modes: NodalModes) -> list[int]:
    """Numbers of the nodes in a universal file: their own, or from 1 if some have none."""
    if all(node.isdecimal() and int(node) > 0 for node in modes.nodes):
        return [int(node) for node in modes.nodes]
    return list(range(1, len(modes.nodes) + 1))


def write_universal_file(path: Path, modes: NodalModes, title: str) -> None:
    """Nodes (15), lines and sides of faces (82), where coordinates are known, and modes (55).

    Numbers have six digits. Nodes that are not numbered are numbered from 1, in their order.

    Raises:
        ValueError: the package that writes universal files is not installed.
    """
    with optional_package("pyuff", extra="uff"):
        import pyuff
    numbers = np.array(node_numbers(modes))
    known = ~np.isnan(modes.positions).any(axis=1)
    sets = []
    if known.any():
        systems = dict.fromkeys(("def_cs", "disp_cs", "color"), np.zeros(known.sum(), dtype=int))
        positions = dict(zip("xyz", modes.positions[known].T, strict=True))
        sets.append(pyuff.prepare_15(node_nums=numbers[known], **systems, **positions))
    number = dict(zip(modes.nodes, numbers.tolist(), strict=True))
    edges = modes.geometry.edges if modes.geometry is not None else ()
    most = 250 // 3  # a data set 82 holds 250 entries, of which a line takes two and a zero
    for trace, start in enumerate(range(0, len(edges), most), 1):
        # Zero moves to the next node without drawing.
        lines = edges[start : start + most]
        entries = np.array([n for a, b in lines for n in (number[a], number[b], 0)][:-1])
        named = {"trace_num": trace, "id": f"lines {trace}", "color": 1}
        sets.append(pyuff.prepare_82(n_nodes=len(entries), nodes=entries, **named))
    head = title.encode("ascii", "replace").decode()[:80] or "NONE"
    pairs = zip(modes.frequencies_hz.tolist(), modes.displacements, strict=True)
    for mode, (frequency, shape) in enumerate(pairs, 1):
        sets.append(
            pyuff.prepare_55(
                # Structural model, normal modes, six components, displacements, real.
                model_type=1, analysis_type=2, data_ch=3, spec_data_type=8, data_type=2,
                id1=head, id2="NONE", id3="NONE", id4="NONE",
                id5=f"Mode {mode}, {frequency:.6g} Hz",
                load_case=1, mode_n=mode, freq=frequency,
                modal_m=0.0, modal_damp_vis=0.0, modal_damp_his=0.0,  # not stated
                node_nums=numbers, **{f"r{i}": row for i, row in enumerate(shape.T, 1)},
            )
        )  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets)
