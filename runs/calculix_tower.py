"""Make the files of a CalculiX model that the tests read, and say what CalculiX computes itself.

A tower of 12 m, 0.5 m by 0.7 m, clamped at its foot: bricks (C3D8I) in a lower and an upper
half of concrete, in N, m and kg. The modulus of each half is changed on its own (lower by 1.2,
upper by 0.8), and of both at once (lower by 0.9, upper by 1.3).

    python runs/calculix_tower.py FOLDER [--cells 16 16 128]

needs CalculiX (``ccx``, in Debian the package calculix-ccx); CalculiX 2.20 made the files in
tests/solver_files/data. FOLDER then holds the stiffness of each model and the mass that they share,
packed, and in frequencies.csv the six lowest frequencies as CalculiX prints them. With --cells, the
numbers of bricks in each direction (C3D8, without incompatible modes), it holds complete and
unpacked exports of a larger tower, and no frequencies.
"""

from __future__ import annotations

import argparse
import lzma
import shutil
import subprocess
import tempfile
from itertools import product
from pathlib import Path

CELLS = (1, 1, 84)
SIZES = (0.5, 0.7, 12.0)
YOUNG, POISSON, DENSITY = 30e9, 0.2, 2500.0
# Name → factors of the moduli of the lower and the upper half.
MODELS = {"tower": (1.0, 1.0), "lower": (1.2, 1.0), "upper": (1.0, 0.8), "both": (0.9, 1.3)}
FREQUENCIES = 6
STORED = ", SOLVER=MATRIXSTORAGE"


def deck(cells: tuple[int, int, int], lower: float, upper: float, solver: str) -> str:
    """The input deck with the moduli multiplied by two factors."""
    nx, ny, nz = cells
    lines = ["*NODE, NSET=ALL"]
    for k, j, i in product(range(nz + 1), range(ny + 1), range(nx + 1)):
        at = (size * n / count for size, n, count in zip(SIZES, (i, j, k), cells, strict=True))
        lines.append(f"{node(cells, i, j, k)}, " + ", ".join(f"{x:g}" for x in at))
    kind = "C3D8I" if cells == CELLS else "C3D8"
    element = 0
    for name, layers in (("LOWER", range(nz // 2)), ("UPPER", range(nz // 2, nz))):
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET={name}")
        for k, j, i in product(layers, range(ny), range(nx)):
            element += 1
            corners = [
                node(cells, i + a, j + b, k + c)
                for c in (0, 1)
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))
            ]
            lines.append(", ".join(map(str, [element, *corners])))
    for name, factor in (("LOWER", lower), ("UPPER", upper)):
        lines += [f"*MATERIAL, NAME={name}", "*ELASTIC", f"{YOUNG * factor!r}, {POISSON}"]
        lines += ["*DENSITY", f"{DENSITY}", f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"]
    restrained = (node(cells, i, j, 0) for j, i in product(range(ny + 1), range(nx + 1)))
    lines += ["*BOUNDARY", *(f"{each}, 1, 3" for each in restrained), "*STEP"]
    lines += [f"*FREQUENCY{solver}", str(FREQUENCIES), "*END STEP", ""]
    return "\n".join(lines)


def node(cells: tuple[int, int, int], i: int, j: int, k: int) -> int:
    """Number of the node at a corner of a brick."""
    nx, ny, _ = cells
    return 1 + i + (nx + 1) * (j + (ny + 1) * k)


def run(text: str, folder: Path) -> None:
    (folder / "job.inp").write_text(text, encoding="ascii")
    subprocess.run(["ccx", "-i", "job"], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def printed_frequencies(path: Path) -> list[str]:
    """The column of cycles per time, as printed, of the table of eigenvalues."""
    fields = [line.split() for line in path.read_text(encoding="ascii").splitlines()]
    rows = [each for each in fields if len(each) == 5 and each[0].isdigit()]
    return [each[3] for each in rows[:FREQUENCIES]]


def packed(source: Path, target: Path) -> None:
    target.write_bytes(lzma.compress(source.read_bytes(), preset=9))


def tests_data(folder: Path) -> None:
    """The files that the tests read."""
    table = ["model," + ",".join(f"f{i} (Hz)" for i in range(1, FREQUENCIES + 1))]
    for name, factors in MODELS.items():
        with tempfile.TemporaryDirectory() as scratch:
            run(deck(CELLS, *factors, ""), Path(scratch))
            table.append(",".join([name, *printed_frequencies(Path(scratch, "job.dat"))]))
            run(deck(CELLS, *factors, STORED), Path(scratch))
            packed(Path(scratch, "job.sti"), folder / f"{name}.sti.xz")
            if name == "tower":
                packed(Path(scratch, "job.mas"), folder / f"{name}.mas.xz")
                for ending in ("dof", "inp"):
                    shutil.copy(Path(scratch, f"job.{ending}"), folder / f"{name}.{ending}")
        print(table[-1])
    (folder / "frequencies.csv").write_text("\n".join(table) + "\n", encoding="ascii")


def large_exports(folder: Path, cells: tuple[int, int, int]) -> None:
    """Complete exports of a tower of so many bricks."""
    for name, factors in MODELS.items():
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            run(deck(cells, *factors, STORED), Path(scratch))
            for ending in ("sti", "mas", "dof", "inp"):
                Path(scratch, f"job.{ending}").rename(folder / f"{name}.{ending}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cells", type=int, nargs=3, metavar=("NX", "NY", "NZ"))
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.cells is None:
        tests_data(arguments.folder)
    else:
        large_exports(arguments.folder, tuple(arguments.cells))


if __name__ == "__main__":
    main()
