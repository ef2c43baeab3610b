"""How far calibrated classes are from a reference class, in what all of them may infer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bayes_ssi.inference.calibration.calibration import Calibration
from bayes_ssi.inference.calibration.fit import rms_distance
from bayes_ssi.inference.model_class.model_class import ModelClass


def distances_from(
    reference: str, classes: Sequence[ModelClass], calibrations: Mapping[str, Calibration]
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Root mean square distances of the best fits from that of a reference class (section 4.5).

    They are over the parameters of all classes without appendages, each divided by its prior
    median; a class that does not infer one has it at the median.

    Returns:
        The names of the parameters, and name of a class → its distance.
    """
    if reference not in calibrations:
        raise ValueError(
            f"reference: no calibrated model class {reference!r}; choose from "
            f"{', '.join(map(repr, calibrations))}"
        )
    known = [each for each in classes if each.name in calibrations]
    bare = [each for each in known if not any(c.structure.appendages for c in each.configurations)]
    medians: dict[str, float] = {}
    for each in bare or known:
        at_median = each.values(np.zeros((1, len(each.parameter_names))))[0]
        own = dict(zip(each.parameter_names, at_median.tolist(), strict=True))
        medians |= {name: own[name] for name in calibrations[each.name].parameter_names}

    def normalised(name: str) -> dict[str, float]:
        one = calibrations[name]
        values = dict(zip(one.parameter_names, one.best.values, strict=True))
        return {each: values.get(each, median) / median for each, median in medians.items()}

    at = normalised(reference)
    return tuple(medians), {name: rms_distance(normalised(name), at) for name in calibrations}
