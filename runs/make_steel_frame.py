"""Make the PSEUDO-EXPERIMENTAL modes of model_classes/steel_frame.py, which are simulated.

    python runs/make_steel_frame.py [DIRECTORY]

The paper publishes no identified modes of its section 4. These are the modes of that study's
augmented model at the paper's best parameters (M3+, Table 5), in the three configurations, at its
sensors: frequencies with a scatter of 0.6 %, unit shapes with 0.03 per component, with which the
objectives of calibrations are about the paper's, from seed 20130704. Writes steel_frame_BC.csv,
_SC.csv and _NC.csv to DIRECTORY; none may exist.
"""

import sys
from pathlib import Path

import numpy as np

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

MODEL_CLASSES = Path(__file__).parent.parent / "model_classes"
# Table 5, model M3+; Icx2 and Icy2 are 1.
BEST = {
    "Icx1": 0.607, "Icy1": 0.769, "Ibx": 1.305, "Iby": 1.163, "m1": 0.803, "m2": 0.785,
    "JO1": 0.785, "JO2": 0.742, "ms": 1.062, "fs": 1.011,
}  # fmt: skip
LABELS = ("1", "2", "3", "4a", "4b", "5", "6")
FREQUENCY_SCATTER, SHAPE_SCATTER = 0.006, 0.03
BAND_HZ = (0.0, 30.0)
SEED = 20130704


def simulated(configuration: bs.Configuration, rng: np.random.Generator) -> bs.ModalData:
    """The modes of one configuration at the best parameters, with scatter."""
    structure = configuration.structure
    sensors = tuple(sensor.label for sensor in structure.sensors)
    frequencies_hz, shapes = structure.modes(
        np.array([[BEST[parameter.name] for parameter in structure.parameters]])
    )
    at_sensors = structure.sensor_matrix(sensors).apply(shapes)[0]
    modes = []
    for i, label in enumerate(LABELS):
        unit = at_sensors[:, i] / np.linalg.norm(at_sensors[:, i])
        # In torsion, components at opposite corners are equal but for rounding: the first counts.
        sizes = np.abs(unit)
        unit *= np.sign(unit[(sizes > (1.0 - 1e-6) * sizes.max()).argmax()])
        modes.append(
            bs.IdentifiedMode(
                label,
                round(frequencies_hz[0, i] * (1.0 + FREQUENCY_SCATTER * rng.standard_normal()), 4),
                np.round(unit + SHAPE_SCATTER * rng.standard_normal(len(unit)), 4),
                frequency_cov=FREQUENCY_SCATTER,
                shape_sd=SHAPE_SCATTER,
            )
        )
    source = (
        f"PSEUDO-EXPERIMENTAL: simulated with the paper's M3+ (Table 5), configuration "
        f"{configuration.name}, scatter {FREQUENCY_SCATTER:.1%} and {SHAPE_SCATTER:g}, seed {SEED}"
    )
    return bs.ModalData(tuple(modes), BAND_HZ, sensors, source)


def main() -> None:
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else MODEL_CLASSES / "data"
    augmented = load_study(MODEL_CLASSES / "steel_frame.py").only(["3 M3+"]).model_classes[0]
    rng = np.random.default_rng(SEED)
    for configuration in augmented.configurations:
        path = directory / f"steel_frame_{configuration.name}.csv"
        bs.write_modal_data(simulated(configuration, rng), path)
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
