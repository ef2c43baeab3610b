"""Sensitivity of section 4's distances to what the paper does not publish. PSEUDO-EXPERIMENTAL.

    python runs/steel_frame_unpublished.py

Simulates the modes of model_classes/steel_frame.py without scatter at the paper's M3+, with floors
heavier than its own nominal ones and with blocks elsewhere, calibrates every approach's M3 at two
weights λ of the shapes, and prints f_ob and the distance from M3+ next to the paper's. The mass of
the floors decides how near the frame's own second transverse mode lies to the braces' 10.1 Hz.
About two minutes on one core.
"""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np

import bayes_ssi as bs
from bayes_ssi.ranking.study_file import load_study

HERE = Path(__file__).parent
TABLES = runpy.run_path(str(HERE / "tables_2_to_5.py"))
TRUE = TABLES["paper_values"](TABLES["BEST"])
CASES = (
    # Factor of the floors' masses, of the blocks' coordinates.
    (1.0, 1.0), (1.0, 1.25), (1.1, 1.0), (1.2, 1.0), (1.3, 1.0),
)  # fmt: skip
SHAPE_WEIGHTS = (0.05, 0.15)
STARTS = 8
BAND_HZ = (0.0, 40.0)


def changed(structure, mass, place):
    """The frame with other nominal masses and other places of the blocks."""
    elements = [
        replace(element, at=(place * element.at[0], place * element.at[1]))
        if isinstance(element, bs.FloorBlock)
        else element
        for element in structure.elements
    ]
    return replace(
        structure,
        masses=[mass * each for each in structure.masses],
        rotational_inertias=[mass * each for each in structure.rotational_inertias],
        elements=tuple(elements),
    )


def without_scatter(structure, labels):
    """The augmented model's modes at the paper's M3+, at the sensors."""
    values = np.array([[TRUE[parameter.name] for parameter in structure.parameters]])
    sensors = tuple(sensor.label for sensor in structure.sensors)
    frequencies_hz, shapes = structure.modes(values)
    at_sensors = structure.sensor_matrix(sensors).apply(shapes)[0]
    modes = [
        bs.IdentifiedMode(label, float(frequencies_hz[0, i]), at_sensors[:, i])
        for i, label in enumerate(labels)
    ]
    return bs.ModalData(tuple(modes), BAND_HZ, sensors)


def main():
    study = load_study(TABLES["STUDY"]).only(["1-a M3", "1-b M3", "2 M3", TABLES["BEST"]])
    augmented = study.model_classes[-1]
    labels = augmented.configurations[0].data.labels
    print("floors, blocks, λ: 4a, 4b in BC; f_ob and distance of M3 (paper: 1-a 1.24 and 17.6, "
          "1-b 2.10 and 72.9, 2 0.78 and 2.1)")  # fmt: skip
    for mass, place in CASES:
        data = {
            c.name: without_scatter(changed(c.structure, mass, place), labels)
            for c in augmented.configurations
        }
        pair = [data["BC"].mode(label).frequency_hz for label in ("4a", "4b")]
        for weight in SHAPE_WEIGHTS:
            results = []
            for candidate in study.model_classes[:-1]:
                tests = [
                    replace(c, structure=changed(c.structure, mass, place), data=data[c.name])
                    for c in candidate.configurations
                ]
                fit = bs.calibrate(
                    bs.ModelClass(candidate.name, configurations=tests), weight, n_starts=STARTS
                )
                values = dict(zip(fit.parameter_names, fit.best.values, strict=True))
                distance = TABLES["distance"](values, TRUE)
                results.append(
                    f"{candidate.name} {100 * fit.best.objective:.2f} and {distance:.1f}"
                )
            print(f"x {mass:g}, x {place:g}, {weight:g}: {pair[0]:.2f}, {pair[1]:.2f} Hz; "
                  f"{', '.join(results)}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
