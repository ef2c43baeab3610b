"""Make the simulated modes of model_classes/finite_elements/footbridge.py, and its candidates.

    python runs/make_footbridge.py [DIRECTORY]

The modes are those of that study's model at stiffness factors that it does not know, with a pipe
that it does not mention: 2 % of the modal mass of the second mode at its place, and in resonance
with it. Frequencies have a scatter of 0.5 %, unit shapes of 0.03 per component. Writes
footbridge.csv and footbridge_candidates.csv to DIRECTORY; neither may exist.
"""

import csv
import sys
from pathlib import Path

import numpy as np

import bayes_ssi as bs

MODEL_CLASSES = Path(__file__).parent.parent / "model_classes"
FACTORS = {"trusses": 0.93, "deck": 1.1}
PLACE, SHARE, MODE = "bottom left 8 z", 0.02, 2
FREQUENCY_SCATTER, SHAPE_SCATTER = 0.005, 0.03
BAND_HZ = (0.5, 6.0)
SEED = 1


def with_pipe(model: bs.MatrixStructure) -> bs.MatrixStructure:
    """The bridge with the pipe, in resonance with the bridge as it is without."""
    values = np.array([FACTORS[parameter.name] for parameter in model.parameters])
    modes = model.full_modes(values)
    ((number, _),) = model.rows_of(PLACE, "the pipe")
    row = model.system.rows[number]
    modal_mass = 1.0 / modes.vectors[row, MODE - 1] ** 2  # with a shape of 1 at its place
    frequency_hz = np.sqrt(modes.eigenvalues[MODE - 1]) / (2.0 * np.pi)
    print(f"pipe: {SHARE * modal_mass:.1f} kg at {frequency_hz:.4f} Hz")
    return model.with_element(bs.Pendulum(PLACE, SHARE * modal_mass, frequency_hz))


def simulated(model: bs.MatrixStructure, sensors: tuple[str, ...]) -> bs.ModalData:
    rng = np.random.default_rng(SEED)
    values = np.array([[FACTORS[parameter.name] for parameter in model.parameters]])
    frequencies_hz, shapes = model.modes(values)
    at_sensors = model.sensor_matrix(sensors).apply(shapes)[0]
    modes = []
    for i, frequency_hz in enumerate(frequencies_hz[0]):
        if BAND_HZ[0] <= frequency_hz <= BAND_HZ[1]:
            unit = at_sensors[:, i] / np.linalg.norm(at_sensors[:, i])
            unit *= np.sign(unit[np.abs(unit).argmax()])
            measured_hz = frequency_hz * (1.0 + FREQUENCY_SCATTER * rng.standard_normal())
            measured = unit + SHAPE_SCATTER * rng.standard_normal(len(unit))
            modes.append(
                bs.IdentifiedMode(str(i + 1), round(measured_hz, 4), np.round(measured, 4))
            )
    source = f"simulated with a pipe at {PLACE}, seed {SEED}"
    return bs.ModalData(tuple(modes), BAND_HZ, sensors, source)


def candidates(model: bs.MatrixStructure) -> list[tuple[str, str]]:
    """Name and place of every candidate: every other panel point, but not the ends."""
    points = [(side, i) for i in range(2, 12, 2) for side in ("left", "right")]
    ways = [("top", "y"), ("bottom", "z")]
    places = [f"{level} {side} {i} {way}" for level, way in ways for side, i in points]
    assert all(model.location_of(place) for place in places)
    return [(place, place) for place in places]


def main() -> None:
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else MODEL_CLASSES / "data"
    (bridge,) = bs.load_study(MODEL_CLASSES / "finite_elements/footbridge.py").model_classes
    model = bridge.structure.exact
    bs.write_modal_data(
        simulated(with_pipe(model), model.degrees_of_freedom), directory / "footbridge.csv"
    )
    with (directory / "footbridge_candidates.csv").open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("name", "place"))
        writer.writerows(candidates(model))
    print(f"wrote footbridge.csv and footbridge_candidates.csv to {directory}")


if __name__ == "__main__":
    main()
