"""The paper's Figure 4: natural frequencies and mode shapes of Case (c).

    python runs/figure_4.py [FILE]

Modes 1, 2a, 2b and 3 of the building whose infill vibrates (marks), with modes 1, 2 and 3 of the
incorrect model, in which the infill is mass only (lines). Shapes have unit length at the floors.
Prints frequencies and MACs at the floors, and draws FILE, runs/results/figure_4.png if not given.
"""

import runpy
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from bayes_ssi.plots.class_plots import plot_mac
from bayes_ssi.plots.figure_style import BLUE, VERMILION, style
from bayes_ssi.structures.modal import mac

HERE = Path(__file__).parent
CASES = HERE.parent / "model_classes" / "non_structural_elements.py"
LABELS = ("1", "2a", "2b", "3")
# The mode of the incorrect model that is compared with each of them.
COUNTERPARTS = (0, 1, 1, 2)
NO_VALUES = np.empty((1, 0))


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "results" / "figure_4.png"
    cases = runpy.run_path(str(CASES))
    correct, incorrect, bare = cases["correct"]["c"], cases["incorrect"]["c"], cases["bare"]
    f, shapes = (part[0] for part in correct.modes(NO_VALUES))
    f_mass, shapes_mass = (part[0] for part in incorrect.modes(NO_VALUES))
    n = len(cases["FLOORS"])
    for each in (shapes, shapes_mass):
        each /= np.linalg.norm(each[:n], axis=0) * np.sign(each[n - 1])
    like = mac(shapes[:n], shapes_mass)
    like_bare = mac(shapes[:n], bare.modes(NO_VALUES).shapes[0])

    table = Table(title="Case (c): MAC at the floors", title_justify="left")
    for heading in ("mode", "f (Hz)", "as mass (Hz)", "MAC as mass", "MAC bare", "MAC with 2a"):
        table.add_column(heading, justify="right")
    own = mac(shapes[:n], shapes[:n])
    for i, (label, other) in enumerate(zip(LABELS, COUNTERPARTS, strict=True)):
        table.add_row(
            label, f"{f[i]:.4f}", f"{f_mass[other]:.4f}", f"{like[i, other]:.4f}",
            f"{like_bare[i, other]:.4f}", f"{own[i, 1]:.4f}",
        )  # fmt: skip
    with style():
        figure = Figure(figsize=(8.6, 3.4))
        *axes, matrix = figure.subplots(1, 5, width_ratios=(1, 1, 1, 1, 1.5))
        levels, heights = np.arange(n + 1), correct.heights()
        for i, (label, other, ax) in enumerate(zip(LABELS, COUNTERPARTS, axes, strict=True)):
            ax.axvline(0.0, color="black", linewidth=0.6)
            (line,) = ax.plot(np.r_[0.0, shapes_mass[:, other]], levels, "-", color="black",
                              linewidth=1.2, label="incorrect: infill as mass only")  # fmt: skip
            (marks,) = ax.plot(np.r_[0.0, shapes[:n, i]], levels, ":o", color=BLUE,
                               label="correct, at the floors")  # fmt: skip
            component = shapes[n, i]
            (mark,) = ax.plot(np.clip(component, -1.0, 1.0), heights["infill 1-2"], "s",
                              color=VERMILION, markeredgecolor="black",
                              label="correct, infill (its component next to it)")  # fmt: skip
            ax.annotate(f"{component:.1f}", (np.clip(component, -0.85, 0.85), 1.32), fontsize=8,
                        color=VERMILION, ha="center", va="top")  # fmt: skip
            ax.set_xlim(-1.15, 1.15)
            ax.set_yticks(levels, ["ground", "1", "2", "3"] if i == 0 else [])
            ax.set_title(f"{label}: {f[i]:.3f} Hz\n(mass: {f_mass[other]:.3f})", fontsize=9)
            ax.set_xlabel("component")
            if i == 0:
                ax.set_ylabel("floor")
        plot_mac(like, LABELS, ("1", "2", "3"), matrix, of=("correct", "incorrect"))
        matrix.set_title("at the floors")
        figure.legend(handles=[marks, mark, line], loc="outside lower center", ncols=3)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    Console(width=80).print(table)
    print(f"drawn in {path}")


if __name__ == "__main__":
    main()
