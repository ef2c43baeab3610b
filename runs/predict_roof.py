"""Predictions of two model classes of the numerical study for the roof, and the truth.

    bayes-ssi rank model_classes/shear_building.py
    python runs/predict_roof.py [RESULT [FILE]]

From the stored result RESULT, runs/results/shear_building if not given, nothing is sampled. Draws
the 90 % bands of the roof's transfer function for class 3, whose infill vibrates, and class 1-a,
whose infill is mass only, over the true building's, and prints where the truth lies. Draws FILE,
runs/results/roof.png if not given.
"""

import runpy
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bayes_ssi.plots.figure_style import style
from bayes_ssi.plots.prediction_plots import plot_transfer_functions
from bayes_ssi.results.predictions.posterior_draws import Band
from bayes_ssi.results.predictions.predictions import load_predictions
from bayes_ssi.structures.response import Output, transfer_functions

HERE = Path(__file__).parent
CLASSES = HERE.parent / "model_classes"
FREQUENCIES = np.arange(0.5, 4.5, 0.004)
ROOF = Output("acceleration", ("floor 3",))
AROUND_MODE_2 = (2.2, 3.4)  # Hz
NAMES = {"3": "class 3: the infill vibrates", "1-a": "class 1-a: the infill is mass only"}


def main() -> None:
    result = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "results" / "shear_building"
    path = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE / "results" / "roof.png"
    cases = runpy.run_path(str(CLASSES / "non_structural_elements.py"))
    damping = cases["DAMPING"]
    try:
        stored = load_predictions(result, CLASSES / "shear_building.py")
        predicted = {
            name: stored.of(name).transfer_functions(FREQUENCIES, ROOF, damping) for name in NAMES
        }
    except ValueError as error:
        print(f"Error: {error}; bayes-ssi rank model_classes/shear_building.py makes it",
              file=sys.stderr)  # fmt: skip
        sys.exit(2)
    truth = np.abs(
        transfer_functions(cases["correct"]["c"], np.empty((1, 0)), FREQUENCIES, ROOF, damping)
    )[0, 0]

    low, high = AROUND_MODE_2
    near = (low <= FREQUENCIES) & (high >= FREQUENCIES)
    with style():
        figure = Figure(figsize=(6.8, 3.4))
        axes = figure.subplots(1, 2, sharey=True)
        for ax, (name, title) in zip(axes, NAMES.items(), strict=True):
            band = Band(*(part[0] for part in predicted[name].band()))
            inside = ((band.low <= truth) & (truth <= band.high))[near]
            share = f"{100 * inside.mean():.0f} % of the frequencies from {low} to {high} Hz"
            print(f"class {name}: the truth lies in the 90 % band at {share}", end="")
            beyond = np.where(near, np.maximum(truth / band.high, band.low / truth), 0.0)
            at = int(beyond.argmax())
            far = f", beyond it by up to a factor of {beyond[at]:.1f}, at {FREQUENCIES[at]:.2f} Hz"
            print("" if inside.all() else far)
            plot_transfer_functions(
                FREQUENCIES,
                {"posterior median and 90 % band": band},
                ax,
                reference=("true building", truth),
                quantity="roof acceleration / ground acceleration" if name == "3" else "",
                legend=False,
            )
            ax.set_title(title)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
        figure.savefig(path)
    print(f"drawn in {path}")


if __name__ == "__main__":
    main()
