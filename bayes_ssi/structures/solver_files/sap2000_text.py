"""SAP2000 and ETABS: the text files .TXE, .TXK, .TXM and .TXC.

The programs write them when the solver options name a case whose stiffness and mass are to be
output; the file .TXA with them describes their layout (CSI Knowledge Base, "Stiffness matrix").
Each has a line of headings, then lines of tab-separated fields:

- ``.TXE``: label of a joint and the numbers of the equations of U1, U2, U3, R1, R2, R3, in the
  joint's own axes. 0 is restrained or inactive, a positive number an equation (which joints may
  share through constraints), a negative one a constraint. A line without a tab continues the one
  before.
- ``.TXC``: number of a constraint, equation, coefficient: the displacement that has the negative
  number is the sum of the coefficients times those of the equations.
- ``.TXK``, ``.TXM``: row, column, value of one half of the symmetric matrices.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

from bayes_ssi.structures.solver_files.exported_model import Matrices, Source
from bayes_ssi.structures.solver_files.solver_text import (
    DIRECTIONS,
    matrix_of_lines,
    numbered_lines,
    read_number_lines,
    require_whole_lines,
    rows_from_one,
)


def read_sap2000(source: Source) -> Matrices:
    """Stiffness and mass by the labels of joints, and what constraints make depend on others."""
    equations = source.needed(".TXE", "equation numbers of the joints")
    stiffness = source.needed(".TXK", "stiffness")
    files = (stiffness, source.mass or source.needed(".TXM", "mass"))
    numbers = list(_equations(equations))
    size = max((n for _, _, n in numbers), default=0)
    if size < 1:
        raise ValueError(f"{equations}: no joint has an equation; truncated?")
    labels: dict[int, str] = {}
    dependent: dict[str, Mapping[int, float]] = {}
    constraints: Mapping[int, Mapping[int, float]] = {}
    if any(n < 0 for _, _, n in numbers):
        constraints = _constraints(source.needed(".TXC", "constraints"), size)
    for line, label, n in numbers:
        if n < 0 and -n not in constraints:
            raise ValueError(
                f"{equations}: line {line}: {label}: no constraint {n} in the .TXC file"
            )
        if n < 0:
            dependent[label] = constraints[-n]
        elif n > 0 and labels.setdefault(n - 1, label) != label:
            dependent[label] = {n - 1: 1.0}
    unlabelled = next((i for i in range(size) if i not in labels), None)
    if unlabelled is not None:
        raise ValueError(f"{equations}: no joint has equation {unlabelled + 1}; truncated?")
    notes = ["directions are those of the joints' own axes; restrained displacements have no rows"]
    if dependent:
        notes.append(
            f"{len(dependent)} displacements have no row of their own: constraints tie them to "
            "those of others (dependent)"
        )
    entries = [read_number_lines(f, "row, column, value", delimiter="\t", skip=1) for f in files]
    return Matrices(
        (
            matrix_of_lines(stiffness, entries[0], size, first_line=2, to_the_last="row"),
            matrix_of_lines(files[1], entries[1], size, first_line=2),
        ),
        files,
        labels=[labels[i] for i in range(size)],
        dependent=dependent,
        notes=tuple(notes),
    )


def _records(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number of the line and fields of each record, after the headings."""
    require_whole_lines(path)
    record: list[str] = []
    start = 0
    for number, line in numbered_lines(path):
        if number == 1:
            continue
        fields = [field.strip() for field in line.split("\t")]
        if len(fields) > 1 and record:
            yield start, record
            record = []
        start = start if record else number
        record += fields
    if record:
        yield start, record


def _equations(path: Path) -> Iterator[tuple[int, str, int]]:
    """Line, label and equation number of every displacement."""
    for line, (joint, *numbers) in _records(path):
        if len(numbers) != len(DIRECTIONS):
            raise ValueError(
                f"{path}: line {line}: expected a joint and six equation numbers, separated by "
                f"tabs, got {1 + len(numbers)} fields"
            )
        for direction, number in zip(DIRECTIONS, numbers, strict=True):
            try:
                yield line, f"{joint} {direction}", int(number)
            except ValueError:
                raise ValueError(
                    f"{path}: line {line}: joint {joint}: an equation number must be whole, got "
                    f"{number!r}"
                ) from None


def _constraints(path: Path, size: int) -> dict[int, dict[int, float]]:
    """Number of a constraint → row → coefficient."""
    values = read_number_lines(path, "constraint, equation, coefficient", delimiter="\t", skip=1)
    rows = rows_from_one(path, values[:, 1:2], size, first_line=2)[:, 0]
    constraints: dict[int, dict[int, float]] = {}
    for number, row, coefficient in zip(values[:, 0], rows, values[:, 2], strict=True):
        constraints.setdefault(abs(int(number)), {})[int(row)] = float(coefficient)
    return constraints
