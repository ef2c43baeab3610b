"""What a stored result predicts: the question and its answer, as bands.

Responses are computed place by place, and only their bands are kept: the histories of a thousand
draws at one place already fill a good part of a memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.predictions.bands import Band, Prediction
from bayes_ssi.predictions.predictions import Predictions
from bayes_ssi.predictions.stored_predictions import StoredPredictions
from bayes_ssi.response.ground_motion import GroundMotion
from bayes_ssi.response.modal_response import checked_frequencies
from bayes_ssi.response.output import Damping, Output, damping_ratios

__all__ = ["ResponseBands", "ResponseRequest", "answer"]

UNITS = {"displacement": "m", "acceleration": "m/s²", "drift": "m"}
PER_GROUND = {"displacement": "s²", "acceleration": "-", "drift": "s²"}
PER_FORCE = {"displacement": "s²/mass", "acceleration": "1/mass", "drift": "s²/mass"}


@dataclass(frozen=True, eq=False)
class ResponseRequest:
    """What is to be predicted.

    Attributes:
        output: the response quantity and its places.
        damping: ratio of all modes, or of each.
        frequencies_hz: (F,), of transfer functions; none are computed if None.
        force_at: where the force of the transfer functions acts; if None, they are from the
            ground's acceleration.
        motions: ground motions of time histories, their names unique.
        level: of the credible bands.

    Raises:
        ValueError: damping, frequencies or level make no sense, or two ground motions have one
            name.
    """

    output: Output
    damping: Damping
    frequencies_hz: FloatArray | None = None
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
        """Of the transfer functions' amplitudes."""
        return (PER_GROUND if self.force_at is None else PER_FORCE)[self.output.quantity]

    @property
    def transfer_name(self) -> str:
        """What is divided by what in the transfer functions."""
        by = "ground acceleration" if self.force_at is None else f"force at {self.force_at}"
        return f"{self.output.quantity} / {by}"

    @property
    def unit(self) -> str:
        """Of time histories and their peaks."""
        return UNITS[self.output.quantity]


@dataclass(frozen=True, eq=False)
class ResponseBands:
    """Predictions of one model class, or of the average.

    Attributes:
        predictions: the draws.
        question: what was asked.
        transfer_functions: bands of amplitudes (n_places, F), where they were asked for.
        transfer_peaks: bands of the largest amplitude (n_places,), likewise.
        time_histories: name of a ground motion → bands (n_places, n_samples).
        peaks: name of a ground motion → bands of the largest amplitude (n_places,).
    """

    predictions: Predictions
    question: ResponseRequest
    transfer_functions: Band | None
    transfer_peaks: Band | None
    time_histories: dict[str, Band]
    peaks: dict[str, Band]

    @property
    def name(self) -> str:
        return self.predictions.name


def answer(predicted: StoredPredictions, name: str, question: ResponseRequest) -> ResponseBands:
    """Predictions of the model class ``name``, or of the average over all for ``"average"``.

    Raises:
        ValueError: there is no such class, it has changed since it was sampled, or a place is
            not on its structure.
        TypeError: its structure does not know its masses.
    """
    predictions = predicted.of(name)
    places = _one_by_one(question.output)
    damping, level = question.damping, question.level
    transfer = transfer_peaks = None
    if question.frequencies_hz is not None:
        transfer, transfer_peaks = _bands(
            (
                predictions.transfer_functions(
                    question.frequencies_hz, place, damping, force_at=question.force_at
                )
                for place in places
            ),
            level,
        )
    histories, peaks = {}, {}
    for motion in question.motions:
        histories[motion.name], peaks[motion.name] = _bands(
            (predictions.time_histories(motion, place, damping) for place in places), level
        )
    return ResponseBands(predictions, question, transfer, transfer_peaks, histories, peaks)


def _one_by_one(output: Output) -> list[Output]:
    return [Output(output.quantity, (place,)) for place in output.places]  # type: ignore[arg-type]


def _bands(each_place: Iterator[Prediction], level: float) -> tuple[Band, Band]:
    """Bands of responses at all places, and of their largest amplitudes."""
    whole, largest = [], []
    for prediction in each_place:
        draws = prediction.draws[:, 0]
        whole.append(Prediction(draws).band(level))
        largest.append(Prediction(np.maximum(draws.max(-1), -draws.min(-1))).band(level))
    return _stacked(whole), _stacked(largest)


def _stacked(bands: list[Band]) -> Band:
    return Band(*(np.stack(part) for part in zip(*bands, strict=True)))
