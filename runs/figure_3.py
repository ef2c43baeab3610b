"""The paper's Figure 3: the effect of non-structural elements on the transfer function.

    python runs/figure_3.py [FILE]

From ground acceleration to the largest acceleration of any floor, Cases (a) to (f), the elements
modelled correctly (line) and as masses only (grey area); damping 2 %. Prints frequencies and
peaks, and draws FILE, runs/results/figure_3.png if not given.
"""

import runpy
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from bayes_ssi.plots.figure_style import BLUE, GREY, style
from bayes_ssi.structures.response import Output, transfer_functions

HERE = Path(__file__).parent
CASES = HERE.parent / "model_classes" / "non_structural_elements.py"
FREQUENCIES = np.arange(0.0, 7.5, 0.002)
NO_VALUES = np.empty((1, 0))


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "results" / "figure_3.png"
    cases = runpy.run_path(str(CASES))
    table = Table(title="Case by case: frequencies (Hz) and the highest peak", title_justify="left")
    for heading in ("case", "elements", "natural frequencies (Hz)", "peak", "at (Hz)"):
        table.add_column(heading, justify="right" if heading in ("peak", "at (Hz)") else "left")
    with style():
        figure = Figure(figsize=(7.4, 4.6))
        axes = figure.subplots(2, 3, sharex=True, sharey=True)
        for case, ax in zip(cases["elements"], axes.flat, strict=True):
            forms = {"correct": cases["correct"][case], "as masses": cases["incorrect"][case]}
            curves = {}
            for form, structure in forms.items():
                output = Output("acceleration", cases["FLOORS"])
                responses = transfer_functions(
                    structure, NO_VALUES, FREQUENCIES, output, cases["DAMPING"]
                )
                curves[form] = np.abs(responses[0]).max(axis=0)
                peak = int(curves[form].argmax())
                natural = structure.modes(NO_VALUES).frequencies_hz[0]
                table.add_row(
                    f"{case} ({cases['configurations'][case]})" if form == "correct" else "",
                    form,
                    "  ".join(f"{frequency:.3f}" for frequency in natural),
                    f"{curves[form][peak]:.1f}",
                    f"{FREQUENCIES[peak]:.2f}",
                )
            table.add_section()
            ax.fill_between(FREQUENCIES, 0.1, curves["as masses"], color=GREY, alpha=0.45,
                            linewidth=0, label="incorrect: elements as masses only")  # fmt: skip
            ax.plot(FREQUENCIES, curves["correct"], color=BLUE, linewidth=1.4,
                    label="correct: elements with their springs")  # fmt: skip
            ax.set_title(f"({case}) {cases['configurations'][case]}: {cases['titles'][case]}",
                         fontsize=8)  # fmt: skip
            ax.set_yscale("log")
            ax.set_xlim(0.0, FREQUENCIES[-1])
            ax.set_ylim(0.1, 60.0)
            ax.grid(alpha=0.3)
        for ax in axes[1]:
            ax.set_xlabel("frequency (Hz)")
        figure.supylabel("largest floor acceleration / ground acceleration", fontsize=9)
        figure.legend(
            *axes.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=2
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    Console(width=100).print(table)
    print(f"drawn in {path}")


if __name__ == "__main__":
    main()
