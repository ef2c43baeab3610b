"""The paper's Tables 2 to 5 next to ours, from PSEUDO-EXPERIMENTAL data, and all sets ranked.

    bayes-ssi rank model_classes/steel_frame.py --error 0.05 --workers 2
    python runs/tables_2_to_5.py [--shape-weight λ] [--result DIRECTORY]

Calibrates the twelve updating sets of model_classes/steel_frame.py on all three configurations
together, and prints parameters, objective and distance from M3+ next to the paper's; then the
distances at several weights λ of the shapes, since the paper does not state its own; then the
ranking that the first command saved, with the posterior of the best class. λ is by default what
runs/steel_frame_unpublished.py fits, which also has the ranges of many seeds. Minutes on one core.
"""

import argparse
import math
import sys
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

import bayes_ssi as bs
from bayes_ssi.report.tables.ranking_tables import parameter_table, ranking_table
from bayes_ssi.results.stored_result import load_result
from bayes_ssi.studies.ranking.study import load_study

HERE = Path(__file__).parent
STUDY = HERE.parent / "model_classes" / "steel_frame.py"
RESULT = HERE / "results" / "steel_frame"
SHAPE_WEIGHT = 0.075
SHAPE_WEIGHTS = (0.0, 0.05, 0.075, 0.1, 0.3, 1.0)
STARTS = 16
PARAMETERS = ("Icx1", "Icy1", "Icx2", "Icy2", "Ibx", "Iby", "m1", "m2", "JO1", "JO2", "ms", "fs")
# The distance is over the first ten, as in the paper.
OF_FRAME = PARAMETERS[:10]
BEST = "3 M3+"
# Tables 2 to 5: the ten parameters, those of the braces if any, and f_ob in percent.
PAPER = {
    "1-a M1": (.952, .928, 1, 1, 1, 1, 1.045, .794, .946, .793, 1.26),
    "1-a M2": (.881, .913, 1.099, .989, 1, 1, 1.041, .774, .944, .766, 1.23),
    "1-a M3": (.952, .857, 1, 1, .984, 1.137, 1.035, .789, .928, .804, 1.24),
    "1-b M1": (.451, .658, 1, 1, 1, 1, .528, .628, .666, .515, 4.89),
    "1-b M2": (1.172, .825, .732, 2.510, 1, 1, .973, .870, 1.226, .933, 2.31),
    "1-b M3": (.820, 2.873, 1, 1, 1.155, .395, .960, .837, 1.221, .812, 2.10),
    "2 M1": (.756, .792, 1, 1, 1, 1, .887, .716, .830, .694, .856),
    "2 M2": (.782, .778, .915, 1.073, 1, 1, .862, .726, .834, .707, .843),
    "2 M3": (.629, .755, 1, 1, 1.254, 1.192, .816, .777, .790, .740, .780),
    "3 M1+": (.711, .772, 1, 1, 1, 1, .839, .705, .807, .673, 1.025, 1.020, .839),
    "3 M2+": (.806, .788, .836, 1.028, 1, 1, .830, .735, .800, .716, 1.084, 1.013, .739),
    "3 M3+": (.607, .769, 1, 1, 1.305, 1.163, .803, .785, .785, .742, 1.062, 1.011, .659),
}  # fmt: skip
TITLES = {"1-a": "Table 2: approach 1-a", "1-b": "Table 3: approach 1-b",
          "2": "Table 4: approach 2", "3": "Table 5: approach 3"}  # fmt: skip
WIDTH = 116


def new_table(title):
    return Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=0)


def paper_values(name):
    return dict(zip(PARAMETERS, PAPER[name][:-1], strict=False))


def distance(values, reference):
    """RMS distance in percent over the frame's ten parameters; 1 where one is not updated."""
    return 100.0 * bs.rms_distance(
        {name: values.get(name, 1.0) for name in OF_FRAME},
        {name: reference.get(name, 1.0) for name in OF_FRAME},
    )


def calibrated(candidate, shape_weight):
    """Values by name, f_ob in percent, and the number of distinct minima."""
    calibration = bs.calibrate(candidate, shape_weight, n_starts=STARTS)
    values = dict(zip(calibration.parameter_names, calibration.best.values, strict=True))
    return values, 100.0 * calibration.best.objective, len(calibration.minima)


def print_tables(console, classes, shape_weight):
    ours = {each.name: calibrated(each, shape_weight) for each in classes}
    reference = {"paper": paper_values(BEST), "ours": ours[BEST][0]}
    for approach, title in TITLES.items():
        table = new_table(f"{title}; ours on pseudo-experimental data, λ = {shape_weight:g}")
        for heading in ("set", "", *PARAMETERS, "f_ob %", "d %", "minima"):
            table.add_column(heading, justify="right", no_wrap=True)
        for name in (each for each in PAPER if each.split()[0] == approach):
            published = (paper_values(name), PAPER[name][-1], None)
            for source, (values, f_ob, minima) in (("paper", published), ("ours", ours[name])):
                table.add_row(
                    name.split()[1] if source == "paper" else "",
                    source,
                    *(_cell(parameter, values, approach) for parameter in PARAMETERS),
                    f"{f_ob:.3f}",
                    f"{distance(values, reference[source]):.1f}",
                    "" if minima is None else str(minima),
                )
            table.add_section()
        console.print(table)


def _cell(parameter, values, approach):
    if parameter in ("ms", "fs") and approach != "3":
        return "n.a."
    return f"{values[parameter]:.3f}" if values.get(parameter, 1) != 1 else "1"


def print_distances(console, classes):
    """Distances of every approach's M3 from M3+, the paper's and ours, at several weights λ."""
    approaches = ("1-a M3", "1-b M3", "2 M3")
    table = new_table("Distance d (%) of M3 from our M3+ (and from what made the data), by λ")
    for heading in ("λ", *approaches, "3 M3+"):
        table.add_column(heading, justify="right", no_wrap=True)
    truth = paper_values(BEST)
    published = (f"{distance(paper_values(name), truth):.1f}" for name in approaches)
    table.add_row("paper", *published, "")
    by_name = {each.name: each for each in classes}
    for weight in SHAPE_WEIGHTS:
        values = {name: calibrated(by_name[name], weight)[0] for name in (*approaches, BEST)}
        cells = [
            f"{distance(values[name], values[BEST]):.1f} ({distance(values[name], truth):.1f})"
            for name in approaches
        ]
        table.add_row(f"{weight:g}", *cells, f"({distance(values[BEST], truth):.1f})")
    console.print(table)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--shape-weight", type=float, default=SHAPE_WEIGHT)
    parser.add_argument("--result", type=Path, default=RESULT)
    options = parser.parse_args()
    if not (math.isfinite(options.shape_weight) and options.shape_weight >= 0):
        parser.error(f"--shape-weight must be zero or positive, got {options.shape_weight}")
    console = Console(width=WIDTH)
    classes = load_study(STUDY).model_classes
    print_tables(console, classes, options.shape_weight)
    print_distances(console, classes)
    try:
        result = load_result(options.result)
    except ValueError as error:
        print(f"Error: {error}; bayes-ssi rank model_classes/steel_frame.py --error 0.05 makes it",
              file=sys.stderr)  # fmt: skip
        sys.exit(2)
    console.print(ranking_table(result.comparison, result.record.study))
    console.print(parameter_table(result.ranked_posteriors[0]))


if __name__ == "__main__":
    main()
