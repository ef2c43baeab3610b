"""Whether axes and units of a test are those of the model, by the modes of the nominal model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.finite_elements.matrix_structure import MatrixStructure
from bayes_ssi.structures.modal import mac, seen_shapes
from bayes_ssi.structures.solver_files.exported_model import ExportedModel
from bayes_ssi.structures.solver_files.solver_text import TRANSLATIONS

# Errors of identified shapes and of a nominal model take less from the mean MAC, and from its
# product with the ratio of frequencies.
LEAST_GAIN_OF_MAC = 0.2
# Nominal frequencies are not off by such a factor; in units that do not belong together they are
# off by √1000 = 32, or √9.81 = 3.1 (kgf) to √(1000/9.81) = 10.
MOST_RATIO_OF_FREQUENCIES = 3.0

# Axis of the model → axis of the test that is taken for it.
Exchange = Mapping[str, str]


@dataclass(frozen=True)
class AxisExchange:
    """Axes of the test that fit the model better than the stated ones."""

    axes: Exchange
    # MAC, or MAC times ratio of frequencies, which tells a tower's alike modes in two directions
    # apart.
    measure: str
    mean: float
    stated_mean: float

    def __str__(self) -> str:
        pairs = ", ".join(f"{a} of the test as {b}" for a, b in self.axes.items() if a != b)
        return (
            f"with {pairs} the identified modes would be like the nominal model's (mean "
            f"{self.measure} {self.mean:.2f} instead of {self.stated_mean:.2f}): are the axes the "
            "same?"
        )


def compared_with_nominal(
    model: ExportedModel,
    modes: ModalData,
    places: Callable[[Exchange], Mapping[str, str] | None],
) -> tuple[list[str], AxisExchange | None]:
    """The nominal model against the identified modes.

    Args:
        places: sensor → label for an exchange of axes; None where sensors then have no label.

    Returns:
        Sentences for the user, of which those that begin with (!) ask for a decision; and axes that
        fit the test much better than the stated ones, None if none do.
    """
    mapped = {}
    for order in permutations(TRANSLATIONS):
        labels_of = places(dict(zip(TRANSLATIONS, order, strict=True)))
        if labels_of is not None and len(set(labels_of.values())) == len(labels_of):
            mapped[order] = [labels_of[name] for name in modes.sensors]
    labels = list(dict.fromkeys(label for each in mapped.values() for label in each))
    n = len(modes.modes)
    # As many again as were identified, for those that were missed.
    n_modes = min(2 * n, int(np.count_nonzero(model.mass.diagonal())))
    structure = MatrixStructure(
        model.stiffness,
        model.mass,
        labels=model.labels,
        sensors=labels or [model.labels[0] if model.labels else ""],
        n_modes=n_modes,
    )
    modes_of_model = structure.modes(np.empty((1, 0)))
    frequencies, shapes = modes_of_model.frequencies_hz[0], seen_shapes(modes_of_model.shapes)[0]
    row = {label: i for i, label in enumerate(labels)}
    macs = {
        order: mac(modes.unit_shapes, shapes[[row[label] for label in each]])
        for order, each in mapped.items()
    }
    ratios = np.exp(-abs(np.log(modes.frequencies_hz[:, None] / frequencies)))
    exchange = _much_better(macs, "MAC") or _much_better(
        {order: each * ratios for order, each in macs.items()}, "MAC times ratio of frequencies"
    )
    nominal, identified = (
        ", ".join(f"{hz:.4g}" for hz in part) for part in (frequencies[:n], modes.frequencies_hz)
    )
    said = [f"Nominal frequencies: {nominal} Hz; identified: {identified} Hz."]
    ratio = frequencies[0] / modes.frequencies_hz[0]
    if not 1.0 / MOST_RATIO_OF_FREQUENCIES < ratio < MOST_RATIO_OF_FREQUENCIES:
        said.append(
            f"(!) The lowest nominal frequency is {ratio:.3g} times the identified one: are the "
            "model's units of force, length and mass consistent?"
        )
    return said + ([f"(!) {exchange}"] if exchange else []), exchange


def _much_better(
    likeness: Mapping[tuple[str, ...], FloatArray], measure: str
) -> AxisExchange | None:
    """The axes of the largest mean likeness, where it is much larger than with the stated ones."""
    means = {order: _mean_of_largest(each) for order, each in likeness.items()}
    if TRANSLATIONS not in means:
        return None
    stated = means[TRANSLATIONS]
    best = max(means, key=lambda order: means[order])
    if means[best] < stated + LEAST_GAIN_OF_MAC:
        return None
    axes = dict(zip(TRANSLATIONS, best, strict=True))
    return AxisExchange(axes, measure, means[best], stated)


def _mean_of_largest(macs: FloatArray) -> float:
    known = macs[~np.isnan(macs).all(axis=1)]
    return float(np.nanmax(known, axis=1).mean()) if len(known) else 0.0
