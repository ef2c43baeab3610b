"""The response request from the options of ``bayes-ssi predict``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bayes_ssi.results.predictions.predictions import Predictions
    from bayes_ssi.results.predictions.response_bands import ResponseRequest
    from bayes_ssi.results.predictions.stored_predictions import StoredPredictions
    from bayes_ssi.structures.response.output import Damping, Output, Quantity

NO_TRANSFER = "none"


def response_request(
    predicted: StoredPredictions,
    first: Predictions,
    *,
    quantity: Quantity,
    places: tuple[str, ...],
    damping: str | None,
    transfer: str | None,
    band: tuple[float, float] | None,
    records: tuple[Path, ...],
    unit: str | None,
    dt: float | None,
    level: float,
) -> tuple[ResponseRequest, list[str]]:
    """The request from the options, and remarks on it."""
    import numpy as np

    from bayes_ssi.results.predictions.posterior_draws import PREDICTION_SETTINGS
    from bayes_ssi.results.predictions.response_bands import (
        ResponseRequest,
        default_frequencies,
        default_output,
    )
    from bayes_ssi.structures.response.ground_motion import UNITS
    from bayes_ssi.structures.response.ground_motion_files import read_ground_motion
    from bayes_ssi.structures.response.modal_response import ground_influence
    from bayes_ssi.structures.response.output import (
        GROUND,
        HEAVY_DAMPING,
        damping_ratios,
        heavy_damping_warning,
    )

    for name, value in (("--unit", unit), ("--dt", dt)):
        if value is not None and not records:
            raise ValueError(f"{name}: applies to records, but no --record is given")
    ratios, remark = _damping(predicted, damping)
    lowest = damping_ratios(ratios, np.size(ratios)).min()
    output = _output(quantity, places) if places else default_output(first, quantity)
    remarks = [remark]
    heaviest = float(np.max(ratios))
    if heaviest > HEAVY_DAMPING:
        remarks.append(f"(!) {heavy_damping_warning(heaviest)}")
    frequencies = None
    if transfer is None:
        structures = [each.structure for each in first.classes]
        unknown = [one for one in structures if ground_influence(one) is None]
        transfer = NO_TRANSFER if unknown else GROUND
        if unknown:
            remarks.append(
                "No transfer functions: how ground motion acts on the degrees of freedom of the "
                f"{type(unknown[0]).__name__} is not known."
            )
    if transfer != NO_TRANSFER:
        frequencies = default_frequencies(predicted.data, lowest, band)
        source = "the ground's acceleration" if transfer == GROUND else f"a force at {transfer!r}"
        remarks.append(
            f"Transfer functions: from {source}, {len(frequencies)} frequencies from "
            f"{frequencies[0]:g} to {frequencies[-1]:g} Hz."
        )
        if len(frequencies) == PREDICTION_SETTINGS.most_frequencies:
            remarks.append(
                "(!) The frequencies may miss the top of a narrow peak; give a narrower --band."
            )
    elif band is not None:
        raise ValueError("--band: applies to transfer functions, but --transfer is none")
    motions = tuple(read_ground_motion(file, unit=unit, dt=dt) for file in records)
    remarks += [
        f"Record {motion.name}: {len(motion)} samples, {motion.dt:g} s apart; peak "
        f"{motion.peak_acceleration / UNITS['g']:.3g} g."
        for motion in motions
    ]
    frequencies_of_modes = np.median(first.classes[0].frequencies_hz, axis=0)
    remarks += [
        f"(!) {warning}." for motion in motions for warning in motion.warnings(frequencies_of_modes)
    ]
    force_at = None if transfer in (GROUND, NO_TRANSFER) else transfer
    return ResponseRequest(output, ratios, frequencies, force_at, motions, level), remarks


def _damping(predicted: StoredPredictions, text: str | None) -> tuple[Damping, str]:
    """The damping from the option or from the data, and a sentence about it."""
    from bayes_ssi.results.predictions.response_bands import default_damping

    if text is None:
        default, source = default_damping(predicted.data)
        return default, f"Damping: {100 * default:.3g} % in all modes, {source}."
    try:
        ratios = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(
            f"--damping: must be a fraction, or one for each mode separated by commas, got {text!r}"
        ) from None
    each = ", ".join(f"{100 * ratio:.3g}" for ratio in ratios)
    if len(ratios) == 1:
        return ratios[0], f"Damping: {each} % in all modes, as given."
    return ratios, f"Damping: {each} % mode by mode, as given."


def _output(quantity: Quantity, places: tuple[str, ...]) -> Output:
    from bayes_ssi.structures.response.output import Output

    if quantity != "drift":
        return Output(quantity, places)
    for place in places:
        if place.count(":") != 1:
            raise ValueError(f"--at: a drift is given as LOWER:UPPER, got {place!r}")
    pairs = [place.partition(":") for place in places]
    return Output(quantity, tuple((lower, upper) for lower, _, upper in pairs))
