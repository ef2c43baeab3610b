"""Responses that a stored result predicts, as credible bands, and what is asked for by default.

Only bands are kept: the histories of a thousand draws at every place would not fit into memory.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.bands import Band, Prediction
from bayes_ssi.results.predictions.posterior_draws import PREDICTION_SETTINGS
from bayes_ssi.results.predictions.predictions import Predictions
from bayes_ssi.results.predictions.stored_predictions import StoredPredictions
from bayes_ssi.structures.response.ground_motion import GroundMotion
from bayes_ssi.structures.response.modal_response import checked_frequencies, ground_influence
from bayes_ssi.structures.response.output import GROUND, Damping, Output, Quantity, damping_ratios

UNITS = {"displacement": "m", "acceleration": "m/s²", "drift": "m"}
PER_GROUND = {"displacement": "s²", "acceleration": "-", "drift": "s²"}
PER_FORCE = {"displacement": "s²/mass", "acceleration": "1/mass", "drift": "s²/mass"}


@dataclass(frozen=True, eq=False)
class ResponseRequest:
    """The responses to be predicted."""

    output: Output
    damping: Damping
    # (F,), frequencies of transfer functions; none are computed if None.
    frequencies_hz: FloatArray | None = None
    # Where the force of the transfer functions acts; if None, their input is the ground
    # acceleration.
    force_at: str | None = None
    motions: tuple[GroundMotion, ...] = ()
    level: float = 0.95

    def __post_init__(self) -> None:
        if self.frequencies_hz is not None:
            checked_frequencies(self.frequencies_hz)
        damping_ratios(self.damping, np.size(self.damping))
        Prediction(np.zeros(1)).band(self.level)
        object.__setattr__(self, "motions", tuple(self.motions))
        for name, count in Counter(motion.name for motion in self.motions).items():
            if count > 1:
                raise ValueError(f"two ground motions are named {name!r}; give each its own name")

    @property
    def transfer_unit(self) -> str:
        """Unit of the transfer functions' amplitudes."""
        return (PER_GROUND if self.force_at is None else PER_FORCE)[self.output.quantity]

    @property
    def transfer_name(self) -> str:
        """Output and input of the transfer functions."""
        by = "ground acceleration" if self.force_at is None else f"force at {self.force_at}"
        return f"{self.output.quantity} / {by}"

    @property
    def unit(self) -> str:
        """Unit of time histories and their peaks."""
        return UNITS[self.output.quantity]


@dataclass(frozen=True, eq=False)
class ResponseBands:
    """Responses predicted by one model class, or by the average over all."""

    predictions: Predictions
    request: ResponseRequest
    transfer_functions: Band | None  # bands of amplitudes (n_places, F), where requested
    transfer_peaks: Band | None  # bands of the largest amplitude (n_places,), likewise
    time_histories: dict[str, Band]  # name of a ground motion → bands (n_places, n_samples)
    peaks: dict[str, Band]  # name of a ground motion → bands of the largest amplitude (n_places,)

    @property
    def name(self) -> str:
        return self.predictions.name

    def peak_rows(self) -> Iterator[tuple[str | None, str, str, float, float, float]]:
        """Ground motion (None for transfer functions), unit, place, low, median and high."""
        peaks: list[tuple[str | None, str, Band]] = []
        if self.transfer_peaks is not None:
            peaks.append((None, self.request.transfer_unit, self.transfer_peaks))
        peaks += [(name, self.request.unit, band) for name, band in self.peaks.items()]
        for motion, unit, band in peaks:
            for place, *interval in zip(self.request.output.labels, *band, strict=True):
                yield (motion, unit, place, *interval)


def predict_responses(
    predicted: StoredPredictions, name: str, request: ResponseRequest
) -> ResponseBands:
    """Responses of the model class ``name``, or of the average over all for ``"average"``."""
    predictions = predicted.of(name)
    damping, frequencies_hz, force_at = request.damping, request.frequencies_hz, request.force_at

    def bands(compute: Callable[[Output], Prediction], n_points: int) -> tuple[Band, Band]:
        """Bands of the response at all places, and of its largest amplitude."""
        curves, peaks = [], []
        places = request.output.places
        # Solving for the modes again costs more than another place does.
        at_once = max(1, PREDICTION_SETTINGS.array_size // (predictions.n_draws * n_points))
        for start in range(0, len(places), at_once):
            some = places[start : start + at_once]
            draws = compute(Output(request.output.quantity, some)).draws
            largest = np.maximum(draws.max(-1), -draws.min(-1))
            curves.append(Prediction(draws).band(request.level))
            peaks.append(Prediction(largest).band(request.level))
        return _joined(curves), _joined(peaks)

    transfer = transfer_peaks = None
    if frequencies_hz is not None:
        transfer, transfer_peaks = bands(
            lambda output: predictions.transfer_functions(
                frequencies_hz, output, damping, force_at=force_at
            ),
            len(frequencies_hz),
        )
    histories, peaks = {}, {}
    for motion in request.motions:
        histories[motion.name], peaks[motion.name] = bands(
            partial(predictions.time_histories, motion, damping=damping), len(motion)
        )
    return ResponseBands(predictions, request, transfer, transfer_peaks, histories, peaks)


def _joined(bands: list[Band]) -> Band:
    """Bands of all places, from those of some at a time."""
    return Band(*(np.concatenate(part) for part in zip(*bands, strict=True)))


def default_damping(data: ModalData) -> tuple[float, str]:
    """A damping ratio for all modes, and its source in words."""
    identified = [mode.damping for mode in data.modes if mode.damping]
    if identified:
        return float(np.median(identified)), "the median of the identified damping ratios"
    return 0.02, "assumed, since none was identified"


def default_output(predictions: Predictions, quantity: Quantity) -> Output:
    """The quantity at the top of the main structure; for drift, between the ground and the top.

    The top is the highest degree of freedom that moves along with the ground, the first of them
    where there are several.
    """
    structure = predictions.classes[0].structure
    heights, influence = structure.heights(), ground_influence(structure)
    places = predictions.main_places
    if influence is not None and influence.any():
        moved = zip(structure.degrees_of_freedom, influence, strict=True)
        moving = {place for place, along_with_ground in moved if along_with_ground}
        places = tuple(place for place in places if place in moving) or places
    top = max(places, key=lambda place: heights[place])
    return Output(quantity, ((GROUND, top),) if quantity == "drift" else (top,))


def default_frequencies(
    data: ModalData, lowest_damping: float, band_hz: tuple[float, float] | None = None
) -> FloatArray:
    """Equally spaced frequencies that resolve every peak of a band.

    At least 400, for smooth curves, and else as many as the narrowest peak needs, up to a limit.
    """
    low, high = data.band_hz if band_hz is None else band_hz
    if not 0.0 <= low < high < math.inf:
        raise ValueError(
            f"band: must be two frequencies in Hz, the lower one first, got {low!r} and {high!r}"
        )
    lowest = max(low, min(mode.frequency_hz for mode in data.modes))
    # A peak extends ζf to either side; steps of an eighth of that meet its height within 0.2 %.
    needed = math.ceil((high - low) / (lowest_damping * lowest / 8.0)) + 1
    most = PREDICTION_SETTINGS.most_frequencies
    return np.linspace(low, high, min(max(needed, 400), most))
