"""The paper's section 4 from records to tables, on SIMULATED ambient records of its steel frame.

    python runs/steel_frame_records.py [DIRECTORY] [--seed 0]

Simulates an ambient record of 15 to 20 minutes of each configuration, at 15 sensors as in the paper
(where they were it does not say), identifies the modes, ranks the twelve classes of
model_classes/steel_frame.py on them, and searches for appendages from "2 M3", which has none and
leaves 4a and 4b out. What comes out stands beside what made the records: the paper's M3+. Records,
modes and pictures are written to DIRECTORY, a new one. About ten minutes.
"""

import argparse
import runpy
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bayes_ssi as bs
from bayes_ssi.plots.record_plots import save_record_figures
from bayes_ssi.studies.ranking.study import load_study

HERE = Path(__file__).parent
STUDY = HERE.parent / "model_classes" / "steel_frame.py"
MAKE = runpy.run_path(str(HERE / "make_steel_frame.py"))
BEST, LABELS = MAKE["BEST"], MAKE["LABELS"]
# Corners and a side's middle of each floor, and the braces: 15 channels, as many as in the paper,
# which does not say where.
PLACES = {"NE": (2.0, 1.5), "SW": (-2.0, -1.5), "NW": (-2.0, 1.5)}
SENSORS = tuple(
    bs.floor_sensor(f"floor {floor} {name} {direction}", floor, at, direction)
    for floor in (1, 2)
    for name, at in PLACES.items()
    for direction in ("x", "y")
) + tuple(
    bs.floor_sensor(f"floor {floor} E {direction}", floor, (2.0, 0.0), direction)
    for floor, direction in ((1, "y"), (2, "x"), (2, "y"))
)
# Records of the model itself: what is inferred of the model's errors may be nothing.
ERROR = bs.ErrorModel(
    bs.Parameter("frequency_cov", bs.HalfNormal(0.005)),
    bs.Parameter("shape_sd", bs.HalfNormal(0.03)),
)
RATE_HZ, MINUTES, NOISE, DAMPINGS = 100.0, (15.0, 20.0), 0.02, (0.01, 0.02)
BAND_HZ = (2.0, 24.0)


class Simulated(NamedTuple):
    """A record, its band, and the modes that it holds, at its sensors at unit length."""

    record: bs.Record
    band_hz: tuple[float, float]
    frequencies_hz: np.ndarray
    dampings: np.ndarray
    shapes: np.ndarray


def simulated(name: str, n_sensors: int, rng: np.random.Generator) -> Simulated:
    """A stationary record of one configuration: white loads on all masses, noise of 2 %."""
    augmented = load_study(STUDY).only(["3 M3+"]).model_classes[0]
    structure = augmented.configuration(name).structure
    own = tuple(sensor.label for sensor in structure.sensors)
    structure = structure.with_sensors([each for each in SENSORS if each.label not in own])
    names = (*own, *(each.label for each in SENSORS if each.label not in own))[:n_sensors]
    values = np.array([[BEST[parameter.name] for parameter in structure.parameters]])
    frequencies_hz, shapes = structure.modes(values)
    f = frequencies_hz[0]
    at_sensors = structure.sensor_matrix(names).apply(shapes)[0]
    dampings = rng.uniform(*DAMPINGS, len(f))
    # Shapes have unit modal mass: forces of unit variance on each degree of freedom.
    loads = shapes[0] * rng.uniform(0.5, 1.5, (len(shapes[0]), 1)) * 60.0
    n = int(60.0 * rng.uniform(*MINUTES) * RATE_HZ)
    period = 2 * (3 * n // 4)
    at_hz = np.fft.rfftfreq(period, 1.0 / RATE_HZ)[1:]
    lines = np.zeros((len(names), len(at_hz) + 1), dtype=complex)
    forces = loads.T @ (rng.standard_normal((2, len(loads), len(at_hz))).T @ (1.0, 1j)).T
    for i in range(len(f)):
        ratio = f[i] / at_hz
        response = forces[i] / (1.0 - ratio**2 - 2j * dampings[i] * ratio)
        lines[:, 1:] += at_sensors[:, i, None] * response
    samples = np.fft.irfft(lines, period)[:, :n]
    samples += NOISE * samples.std(1, keepdims=True) * rng.standard_normal(samples.shape)
    record = bs.Record(samples, RATE_HZ, names, "acceleration", "m/s2")
    inside = (f > BAND_HZ[0]) & (f < BAND_HZ[1])
    unit = at_sensors / np.linalg.norm(at_sensors, axis=0)
    return Simulated(record, BAND_HZ, f[inside], dampings[inside], unit[:, inside])


def classes_with(data_of_tests: dict[str, bs.ModalData]) -> list[bs.ModelClass]:
    """The study's twelve classes, with sensors and data of the records."""
    classes = []
    for each in load_study(STUDY).model_classes:
        tests = []
        for test in each.configurations:
            own = {sensor.label for sensor in test.structure.sensors}
            more = [sensor for sensor in SENSORS if sensor.label not in own]
            structure = test.structure.with_sensors(more)
            tests.append(replace(test, structure=structure, data=data_of_tests[test.name]))
        classes.append(replace(each, configurations=tests, error=ERROR))
    return classes


def identified(name: str, rng: np.random.Generator, directory: Path) -> bs.ModalData:
    """The modes of one configuration's record, labelled as in the study."""
    case = simulated(name, 15, rng)
    np.savez(
        directory / f"{name}.npz",
        samples=case.record.samples,
        rate_hz=case.record.rate_hz,
        sensors=np.array(case.record.sensors),
        quantity=case.record.quantity,
        unit=case.record.unit,
    )
    result = bs.identify(case.record, case.band_hz)
    save_record_figures(directory / f"{name} figures", result)
    data = result.modal_data(f"SIMULATED ambient record, configuration {name}")
    minutes = case.record.duration_s / 60.0
    print(f"{name}, {minutes:.0f} min: identified (Hz), true, error over claimed error")
    for mode, true in zip(data.modes, case.frequencies_hz, strict=True):
        off = np.log(mode.frequency_hz / true) / mode.frequency_cov
        print(f"  {mode.frequency_hz:7.3f} {true:7.3f} {off:5.1f}")
    for check in result.failed_checks:
        print(f"  (!) {check}")
    if len(data.modes) != len(LABELS):
        raise SystemExit(
            f"{name}: {len(data.modes)} modes, not seven; labels must be given by hand"
        )
    modes = [replace(mode, label=own) for mode, own in zip(data.modes, LABELS, strict=True)]
    data = replace(data, modes=tuple(modes))
    bs.write_modal_data(data, directory / f"{name}.csv")
    return data


def draw_parameters(posteriors: tuple[bs.Posterior, ...], file: Path) -> None:
    """The parameters of M3 by each approach, over what made the records."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    names = [name for name in BEST if name not in ("ms", "fs")]
    figure, ax = plt.subplots(figsize=(8.0, 3.4), layout="constrained")
    ax.axhline(1.0, color="0.4", linewidth=1.0, label="what made the records")
    wanted = {"1-a M3": "o", "1-b M3": "s", "2 M3": "^", "3 M3+": "D"}
    colours = ("#E69F00", "#D55E00", "#0072B2", "#009E73")
    for i, ((name, marker), colour) in enumerate(zip(wanted.items(), colours, strict=True)):
        (posterior,) = (each for each in posteriors if each.name == name)
        rows = {row.name: row for row in posterior.summary}
        at = np.arange(len(names)) + 0.16 * (i - 1.5)
        true = np.array([BEST[each] for each in names])
        low, middle, high = (
            np.array([(rows[n].quantile_05, rows[n].median, rows[n].quantile_95) for n in names]).T
            / true
        )
        errors = [(middle - low).tolist(), (high - middle).tolist()]
        ax.errorbar(at, middle, yerr=errors, fmt=marker, color=colour, markersize=4,
                    linewidth=1.2, label=f"approach {name.split()[0]}")  # fmt: skip
    ax.set_xticks(range(len(names)), names)
    ax.set_ylabel("median and 90 % interval over truth")
    ax.legend(ncols=5, loc="upper center", bbox_to_anchor=(0.5, -0.1), frameon=False, fontsize=8)
    figure.savefig(file, dpi=130)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    default = HERE / "results" / "steel_frame_records"
    parser.add_argument("directory", type=Path, nargs="?", default=default)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.directory.mkdir(parents=True)
    rng = np.random.default_rng(options.seed)
    names = ("BC", "SC", "NC")
    data_of_tests = {name: identified(name, rng, options.directory) for name in names}
    classes = classes_with(data_of_tests)
    ranking = bs.rank(
        bs.Study("Steel frame, from records", classes), settings=bs.SamplingSettings(0.05)
    )
    print("class, log evidence, probability")
    for row in ranking.comparison.classes:
        print(f"  {row.name:8s} {row.log_evidence:9.2f} {row.probability:.4f}")
    for check in ranking.comparison.failed_checks:
        print(f"  (!) {check}")
    best = next(each for each in ranking.posteriors if each.name == ranking.comparison.best.name)
    print(f"{best.name}: median, 5 to 95 %, true")
    for row in best.summary:
        true = BEST.get(row.name)
        print(f"  {row.name:14s} {row.median:.4f} ({row.quantile_05:.4f} to {row.quantile_95:.4f})"
              f"  {'' if true is None else true}")  # fmt: skip
    draw_parameters(ranking.posteriors, options.directory / "parameters.png")
    (bare,) = (each for each in classes if each.name == "2 M3")
    one = bs.SearchSettings(number_weights=(1.0, 1.0))
    result = bs.search(bare, one, settings=bs.SamplingSettings(0.1))
    print('search from "2 M3"; true: braces on floor 1 in y, 74.3 kg, 10.11 Hz')
    rows = sorted(result.record.hypotheses, key=lambda each: -each.probability)
    for row in rows[:4]:
        print(f"  {row.name}: {row.probability:.4f}")
    for each in result.record.hypothesis(rows[0].name).features:
        (low, mass, high), (slow, hz, fast) = each.mass, each.frequency_hz
        print(f"  {each.place.name}: {mass:.1f} ({low:.1f} to {high:.1f}) kg, "
              f"{hz:.3f} ({slow:.3f} to {fast:.3f}) Hz")  # fmt: skip
    for check in result.ranking.comparison.failed_checks:
        print(f"  (!) {check}")


if __name__ == "__main__":
    main()
