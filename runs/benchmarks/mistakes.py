"""Does a ranking notice mistakes in the data, and name them?

    python runs/benchmarks/mistakes.py

The shear building study and the four-storey laboratory frame are ranked with every class they
have, on their own data and on data with one mistake: two channels exchanged (in all modes, in one
mode), a sensor's sign, frequencies in rad/s; with a wrong pairing; and without the classes that
allow for the profile of stiffnesses. Printed are the best class, its misfit and what is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import bayes_ssi as bs

STUDIES = Path(__file__).parents[2] / "model_classes"
SETTINGS = bs.SamplingSettings(log_evidence_error=0.1, economical=True)
Change = Callable[[bs.ModalData], bs.ModalData]


def in_modes(change: Callable[[np.ndarray], np.ndarray], label: str = "") -> Change:
    """Shapes changed, of all modes or of one."""
    return lambda data: replace(
        data,
        modes=tuple(
            replace(mode, shape=change(mode.shape)) if label in ("", mode.label) else mode
            for mode in data.modes
        ),
    )


def exchanged(shape: np.ndarray) -> np.ndarray:
    return shape[[1, 0, *range(2, len(shape))]]


def turned(shape: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(shape)) == 1, -1.0, 1.0) * shape


def in_rad_s(data: bs.ModalData) -> bs.ModalData:
    factor = 2.0 * math.pi
    low, high = data.band_hz
    modes = (replace(mode, frequency_hz=factor * mode.frequency_hz) for mode in data.modes)
    return replace(data, modes=tuple(modes), band_hz=(factor * low, factor * high))


MISTAKES: dict[str, Change] = {
    "none": lambda data: data,
    "channels of floors 1 and 2 exchanged": in_modes(exchanged),
    "the same in mode 3 only": in_modes(exchanged, "3"),
    "sign of floor 2": in_modes(turned),
    "rad/s for Hz": in_rad_s,
}


def changed(candidate: bs.ModelClass, change: Change) -> bs.ModelClass:
    tests = tuple(replace(test, data=change(test.data)) for test in candidate.configurations)
    return replace(candidate, configurations=tests)


def with_two_modes_exchanged(candidate: bs.ModelClass) -> bs.ModelClass:
    (test,) = candidate.configurations
    last = sorted(test.pairing, key=test.pairing.get)[-2:]
    wrong = test.pairing | dict(zip(last, [test.pairing[name] for name in last[::-1]], strict=True))
    return replace(candidate, configurations=(replace(test, pairing=wrong),))


def show(name: str, classes: list[bs.ModelClass]) -> None:
    comparison = bs.rank(bs.Study(name, classes), settings=SETTINGS).comparison
    best = comparison.best
    print(f"{name}: {best.name!r}, {best.misfit_sds:.1f} sd. {best.misfit or 'Explained.'}\n")


def main() -> None:
    for study, without in (
        ("shear_building", ("3",)),
        ("four_storey_frame", ("each storey", "each storey, free errors")),
    ):
        classes = bs.load_study(STUDIES / f"{study}.py").model_classes
        for mistake, change in MISTAKES.items():
            show(f"{study}, {mistake}", [changed(each, change) for each in classes])
        show(f"{study}, wrong pairing", [with_two_modes_exchanged(each) for each in classes])
        left = [each for each in classes if each.name not in without]
        show(f"{study}, without {', '.join(without)}", left)


if __name__ == "__main__":
    main()
