"""Whether axes and units of a test are those of the model, by the modes of the nominal model."""

from collections.abc import Callable, Mapping
from itertools import chain, permutations

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

# Axis of the test → axis of the model that it is taken for.
Exchange = Mapping[str, str]


def compared_with_nominal(
    model: ExportedModel,
    modes: ModalData,
    places: Callable[[Exchange], Mapping[str, str] | None],
) -> list[str]:
    """The nominal model against the identified modes, in sentences for the user.

    Those that begin with (!) ask for a decision. For an exchange of axes, ``places`` gives the
    label of every sensor; None where sensors then have no label.
    """
    mapped = {}
    for order in permutations(TRANSLATIONS):
        labels_of = places(dict(zip(TRANSLATIONS, order, strict=True)))
        if labels_of is not None and len(set(labels_of.values())) == len(labels_of):
            mapped[order] = [labels_of[name] for name in modes.sensors]
    labels = list(dict.fromkeys(chain(*mapped.values())))
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
    macs = {
        order: mac(modes.unit_shapes, shapes[[labels.index(label) for label in of_order]])
        for order, of_order in mapped.items()
    }
    # The ratio of frequencies tells a tower's alike modes in two directions apart.
    ratios = np.exp(-abs(np.log(modes.frequencies_hz[:, None] / frequencies)))
    with_ratios = {order: of_order * ratios for order, of_order in macs.items()}
    better = _much_better(macs, "MAC") or _much_better(
        with_ratios, "MAC times ratio of frequencies"
    )
    return said + ([better] if better else [])


def _much_better(likeness: Mapping[tuple[str, ...], FloatArray], measure: str) -> str | None:
    """Whether other axes than the stated ones have a much larger mean likeness, in a sentence."""
    means = {order: _mean_of_largest(of_order) for order, of_order in likeness.items()}
    best = max(means, key=lambda order: means[order], default=TRANSLATIONS)
    stated = means.get(TRANSLATIONS, np.inf)
    if best == TRANSLATIONS or means[best] < stated + LEAST_GAIN_OF_MAC:
        return None
    axes = zip(TRANSLATIONS, best, strict=True)
    pairs = ", ".join(f"{axis} of the test as {taken}" for axis, taken in axes if axis != taken)
    return (
        f"(!) with {pairs} the identified modes would be like the nominal model's (mean {measure} "
        f"{means[best]:.2f} instead of {stated:.2f}): are the axes the same?"
    )


def _mean_of_largest(macs: FloatArray) -> float:
    known = macs[~np.isnan(macs).all(axis=1)]
    return float(np.nanmax(known, axis=1).mean()) if len(known) else 0.0
