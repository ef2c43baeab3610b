"""The README's picture: a split mode, a wrong model that fits perfectly, and the right one.

    python runs/problem_at_a_glance.py [FILE]

From the numerical study in model_classes/shear_building.py. The wrong fit is the deterministic
calibration of class 1-b, to frequencies alone as in the paper's Table 1; the right one is the
posterior of class 3. Draws FILE, runs/results/problem_at_a_glance.png if not given.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import bayes_ssi as bs
from bayes_ssi.inference.calibration.least_squares import DeterministicFit
from bayes_ssi.plots.figure_style import BLUE, GREY, ORANGE, VERMILION, style

HERE = Path(__file__).parent
STUDY = HERE.parent / "model_classes" / "shear_building.py"
WRONG, RIGHT = "1-b", "3"
STOREYS = ("k1", "k2", "k3")
INFILL_HEIGHT = 1.5  # storeys
LARGEST_DISPLACEMENT = 1.1  # of a mode as it is drawn, in storey heights


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "results" / "problem_at_a_glance.png"
    classes = {each.name: each for each in bs.load_study(STUDY).model_classes}
    ranking = bs.rank(bs.Study("at a glance", tuple(classes.values())))
    wrong = bs.calibrate(classes[WRONG], shape_weight=0.0).best
    right = next(each for each in ranking.posteriors if each.name == RIGHT)
    with style():
        figure = Figure(figsize=(9.0, 3.1))
        shapes, frequencies, stiffnesses = figure.subplots(1, 3, width_ratios=(0.85, 1.25, 1.0))
        draw_modes(shapes, classes[RIGHT])
        draw_fits(frequencies, classes, wrong, right)
        draw_stiffnesses(stiffnesses, wrong, right)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=200)
    for row in ranking.comparison.classes:
        print(f"class {row.name}: ln B = {row.log_bayes_factor:.1f}, P = {row.probability:.2g}")
    print(f"class {WRONG} misses the frequencies by {100 * wrong.objective:.4f} %, its stiffnesses")
    print("are off by", ", ".join(f"{100 * (value - 1):+.0f} %" for value in wrong.values))
    print(f"drawn in {path}")


def draw_modes(ax: Axes, model_class: bs.ModelClass) -> None:
    """Modes 2a and 2b of the true building: floors as dots, the infill as a square."""
    modes = model_class.structure.modes(np.ones((1, len(model_class.structural_parameters))))
    for centre, label, mode in ((0.0, "2a", 1), (2.9, "2b", 2)):
        shape = modes.shapes[0, :, mode]
        *floors, infill = LARGEST_DISPLACEMENT * shape / np.abs(shape).max() * np.sign(shape[-1])
        heights = np.arange(len(floors) + 1)
        x = centre + np.array([0.0, *floors])
        ax.plot([centre, centre], [0, heights[-1]], color=GREY, linestyle=":", linewidth=1)
        ax.plot(x, heights, color="black", marker="o", markersize=6)
        ax.plot(centre + infill, INFILL_HEIGHT, color=ORANGE, marker="s", markersize=9)
        for floor in (1, 2):
            ax.plot([x[floor], centre + infill], [floor, INFILL_HEIGHT], color=ORANGE, linewidth=1)
        ax.plot([centre - 0.6, centre + 0.6], [0, 0], color="black", linewidth=3)
        ax.text(centre, -0.25, f"mode {label}\n{modes.frequencies_hz[0, mode]:.2f} Hz",
                ha="center", va="top")  # fmt: skip
    ax.set_title("An infill in resonance\nsplits mode 2 into a pair")
    ax.set_xlim(-0.9, 4.2)
    ax.set_ylim(-1.0, 3.2)
    ax.axis("off")


def draw_fits(
    ax: Axes, classes: dict[str, bs.ModelClass], wrong: DeterministicFit, right: bs.Posterior
) -> None:
    """Identified frequencies, and those of the wrong fit and of the right class."""
    for mode in classes[RIGHT].data.modes:
        ax.axvline(mode.frequency_hz, color=GREY, linestyle=":", linewidth=1, zorder=0)
        # The pair stands close together.
        side = {"2a": "right", "2b": "left"}.get(mode.label, "center")
        ax.text(mode.frequency_hz, 2.3, mode.label, ha=side, va="bottom")
    identified = [mode.frequency_hz for mode in classes[RIGHT].data.modes]
    ax.plot(identified, [2] * len(identified), "k|", markersize=14, markeredgewidth=2)
    fitted = [each.model_hz for each in wrong.modes]
    ax.plot(fitted, [1] * len(fitted), "X", color=VERMILION, markersize=8)
    unexplained = classes[RIGHT].data.modes[1].frequency_hz
    ax.annotate("2a left over", (unexplained, 1), (unexplained - 0.15, 1), ha="right", va="center",
                color=VERMILION)  # fmt: skip
    medians = np.median(right.frequencies_hz, axis=(0, 1))
    ax.plot(medians, np.zeros(len(medians)), "o", color=BLUE, markersize=7)
    ax.set_yticks((2, 1, 0), ("identified", "infill as mass,\n2b is “mode 2”", "infill\nvibrates"))
    ax.get_yticklabels()[1].set_color(VERMILION)
    ax.get_yticklabels()[2].set_color(BLUE)
    ax.tick_params(left=False)
    ax.spines["left"].set_visible(False)
    ax.set_xlim(0.5, 4.4)
    ax.set_ylim(-0.5, 2.6)
    ax.set_xlabel("frequency (Hz)")
    ax.set_title("The fit does not show\nwhich model is right")


def draw_stiffnesses(ax: Axes, wrong: DeterministicFit, right: bs.Posterior) -> None:
    """Errors of the storey stiffnesses, with 90 % intervals of the right class."""
    y = np.arange(len(STOREYS))
    errors = [100.0 * (value - 1.0) for value in wrong.values]
    columns = [right.parameter_names.index(name) for name in STOREYS]
    low, median, high = 100.0 * (
        np.quantile(right.draws[..., columns], (0.05, 0.5, 0.95), axis=(0, 1)) - 1.0
    )
    ax.axvline(0.0, color=GREY, linestyle=":", linewidth=1, zorder=0)
    ax.plot(errors, y, "X", color=VERMILION, markersize=8)
    for error, place in zip(errors, y, strict=True):
        ax.annotate(f"{error:+.0f} %", (error, place), (0, 8), textcoords="offset points",
                    ha="center", color=VERMILION)  # fmt: skip
    ax.errorbar(median, y, xerr=(median - low, high - median), fmt="o", color=BLUE, capsize=3)
    ax.set_yticks(y, ("storey 1", "storey 2", "storey 3"))
    ax.set_xlim(-50, 50)
    ax.set_ylim(-0.5, 2.6)
    ax.set_xlabel("error of the stiffness (%)")
    ax.set_title("One recovers the stiffnesses;\nthe evidence shows which")


if __name__ == "__main__":
    main()
