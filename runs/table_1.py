"""The paper's Table 1 next to ours, with the exact minima that the paper does not mention.

    python runs/table_1.py

Approaches 1-a, 1-b and 3 fit frequencies alone; approach 2 fits the frequencies and shapes of
modes 1 and 3 (λ = 1). All multipliers are relative to their true values, so d is the error. The
paper's 2.7 % of approach 2 is over three parameters; over four, with ks at its nominal value as it
says of approach 1, it is 2.38 %. Below, what λ = 1 makes of the other approaches: the paper claims
that shapes would hardly matter.
"""

from pathlib import Path

from rich.console import Console
from rich.table import Table

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

STUDY = Path(__file__).parent.parent / "model_classes" / "shear_building.py"
PAPER = {
    "1-a": ((0.948, 1.159, 0.850), 13.0),
    "1-b": ((1.350, 0.685, 1.343), 33.6),
    "2": ((0.985, 1.045, 1.004), 2.7),
    "3": ((1.000, 1.000, 1.000, 1.000), 0.0),
}
SHAPE_WEIGHT = {"1-a": 0.0, "1-b": 0.0, "2": 1.0, "3": 0.0}
EXACT = 1e-6


def main() -> None:
    table = Table(title="Table 1: calibration for the four approaches", title_justify="left")
    for heading in ("approach", "", "k1", "k2", "k3", "ks", "d (%)", "f_ob (%)"):
        table.add_column(heading, justify="right")
    classes = load_study(STUDY).model_classes
    for candidate in classes:
        values, distance = PAPER[candidate.name]
        _add(table, candidate.name, "paper", values, distance, "")
        calibration = bs.calibrate(candidate, SHAPE_WEIGHT[candidate.name])
        for i, fit in enumerate(calibration.minima):
            if i == 0 or fit.objective < EXACT:
                row = "ours" if i == 0 else "also exact"
                _add(table, "", row, fit.values, 100 * fit.distance, f"{100 * fit.objective:.3f}")
        table.add_section()
    Console(width=80).print(table)
    shapes = Table(title="Shapes fitted, too (λ = 1)", title_justify="left")
    for heading in ("approach", "", "k1", "k2", "k3", "ks", "d (%)", "f_ob (%)"):
        shapes.add_column(heading, justify="right")
    for candidate in classes:
        best = bs.calibrate(candidate, 1.0).best
        objective = f"{100 * best.objective:.3f}"
        _add(shapes, candidate.name, "ours", best.values, 100 * best.distance, objective)
    Console(width=80).print(shapes)


def _add(
    table: Table, approach: str, row: str, values: tuple[float, ...], d: float, objective: str
) -> None:
    numbers = [f"{value:.3f}" for value in values] + ["n.a."] * (4 - len(values))
    table.add_row(approach, row, *numbers, f"{d:.1f}", objective)


if __name__ == "__main__":
    main()
