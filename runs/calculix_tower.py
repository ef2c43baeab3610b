"""Make the files of a CalculiX model that the tests read, and say what CalculiX computes itself.

A tower of 12 m, 0.5 m by 0.7 m, clamped at its foot: bricks (C3D8I) in a lower and an upper
half of concrete, in N, m and kg. The modulus of each half is changed on its own (lower by 1.2,
upper by 0.8), and of both at once (lower by 0.9, upper by 1.3).

    python runs/calculix_tower.py FOLDER

needs CalculiX (``ccx``, in Debian the package calculix-ccx); CalculiX 2.20 made the files in
tests/solver_files/data. FOLDER then holds the stiffness of each model and the mass that they share,
packed, and in frequencies.csv the six lowest frequencies as CalculiX prints them.
"""

from __future__ import annotations

import lzma
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

LAYERS, HEIGHT, WIDTH, DEPTH = 84, 12.0, 0.5, 0.7
YOUNG, POISSON, DENSITY = 30e9, 0.2, 2500.0
CORNERS = ((0.0, 0.0), (WIDTH, 0.0), (WIDTH, DEPTH), (0.0, DEPTH))
# Name → factors of the moduli of the lower and the upper half.
MODELS = {"tower": (1.0, 1.0), "lower": (1.2, 1.0), "upper": (1.0, 0.8), "both": (0.9, 1.3)}
FREQUENCIES = 6


def deck(lower: float, upper: float, solver: str) -> str:
    """The input deck with the moduli multiplied by two factors."""
    lines = ["*NODE, NSET=ALL"]
    for layer in range(LAYERS + 1):
        for corner, (x, y) in enumerate(CORNERS, start=1):
            lines.append(f"{4 * layer + corner}, {x:g}, {y:g}, {HEIGHT * layer / LAYERS:g}")
    for name, layers in (("LOWER", range(LAYERS // 2)), ("UPPER", range(LAYERS // 2, LAYERS))):
        lines.append(f"*ELEMENT, TYPE=C3D8I, ELSET={name}")
        for layer in layers:
            nodes = [4 * layer + i for i in range(1, 9)]
            lines.append(", ".join(map(str, [layer + 1, *nodes])))
    for name, factor in (("LOWER", lower), ("UPPER", upper)):
        lines += [f"*MATERIAL, NAME={name}", "*ELASTIC", f"{YOUNG * factor!r}, {POISSON}"]
        lines += ["*DENSITY", f"{DENSITY}", f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"]
    lines += ["*BOUNDARY", *(f"{node}, 1, 3" for node in range(1, 5)), "*STEP"]
    lines += [f"*FREQUENCY{solver}", str(FREQUENCIES), "*END STEP", ""]
    return "\n".join(lines)


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


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    table = ["model," + ",".join(f"f{i} (Hz)" for i in range(1, FREQUENCIES + 1))]
    for name, factors in MODELS.items():
        with tempfile.TemporaryDirectory() as scratch:
            run(deck(*factors, ""), Path(scratch))
            table.append(",".join([name, *printed_frequencies(Path(scratch, "job.dat"))]))
            run(deck(*factors, ", SOLVER=MATRIXSTORAGE"), Path(scratch))
            packed(Path(scratch, "job.sti"), folder / f"{name}.sti.xz")
            if name == "tower":
                packed(Path(scratch, "job.mas"), folder / f"{name}.mas.xz")
                for ending in ("dof", "inp"):
                    shutil.copy(Path(scratch, f"job.{ending}"), folder / f"{name}.{ending}")
        print(table[-1])
    (folder / "frequencies.csv").write_text("\n".join(table) + "\n", encoding="ascii")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
