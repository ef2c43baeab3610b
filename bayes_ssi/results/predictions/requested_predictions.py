"""Modes and responses that a stored result predicts on request, as credible bands, and their files.

Only bands are kept: the histories of a thousand draws at every place would not fit into memory.
"""

import csv
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.foundations.packages import versions
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.posterior_draws import (
    ARRAY_SIZE,
    MOST_FREQUENCIES,
    Band,
    Prediction,
)
from bayes_ssi.results.predictions.predictions import (
    AVERAGE,
    PredictedMode,
    Predictions,
    StoredPredictions,
    predicted_modes,
    shown_places,
)
from bayes_ssi.results.result_files import read_json, write_csv
from bayes_ssi.structures.response import (
    GROUND,
    HEAVY_DAMPING,
    UNITS,
    Damping,
    GroundMotion,
    Output,
    Quantity,
    checked_frequencies,
    damping_ratios,
    ground_influence,
    heavy_damping_warning,
)
from bayes_ssi.structures.structure import Structure

RESPONSE_UNITS = {"displacement": "m", "acceleration": "m/s²", "drift": "m"}
PER_GROUND = {"displacement": "s²", "acceleration": "-", "drift": "s²"}
PER_FORCE = {"displacement": "s²/mass", "acceleration": "1/mass", "drift": "s²/mass"}


@dataclass(frozen=True, eq=False)
class ResponseRequest:
    """Which responses are predicted.

    Attributes:
        output: the quantity, and its places.
        damping: fraction of critical damping, of all modes or of each.
        frequencies_hz: (F,), of transfer functions; none are computed if None.
        force_at: where the transfer functions' force acts; if None, the ground accelerates.
        motions: of the ground, for time histories and their peaks.

    Raises:
        ValueError: a frequency or damping ratio is not usable, or two motions have one name.
    """

    output: Output
    damping: Damping
    frequencies_hz: FloatArray | None = None
    force_at: str | None = None
    motions: tuple[GroundMotion, ...] = ()

    def __post_init__(self) -> None:
        if self.frequencies_hz is not None:
            checked_frequencies(self.frequencies_hz)
        damping_ratios(self.damping, np.size(self.damping))
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
        return RESPONSE_UNITS[self.output.quantity]


class Response(NamedTuple):
    curves: Band  # (n_places, n_points)
    peaks: Band  # (n_places,), of the largest amplitude


@dataclass(frozen=True, eq=False)
class ResponseBands:
    """Modes and responses predicted by one model class, or by the average over all."""

    predictions: Predictions
    request: ResponseRequest
    modes: tuple[PredictedMode, ...]
    places: tuple[str, ...]  # of the shapes
    shapes: dict[str, Band]  # label of a mode → bands of its shape (n_places,)
    transfer: Response | None  # transfer functions, where requested
    histories: dict[str, Response]  # name of a ground motion → time histories

    @property
    def name(self) -> str:
        return self.predictions.name

    def peak_rows(self) -> Iterator[tuple[str | None, str, str, float, float, float]]:
        """Ground motion (None for transfer functions), unit, place, low, median and high."""
        responses: dict[str | None, Response] = {None: self.transfer} if self.transfer else {}
        for motion, response in (responses | self.histories).items():
            unit = self.request.transfer_unit if motion is None else self.request.unit
            for place, *interval in zip(self.request.output.labels, *response.peaks, strict=True):
                yield (motion, unit, place, *interval)


@checked
def predict_responses(
    predicted: StoredPredictions, name: str = AVERAGE, request: ResponseRequest | None = None
) -> ResponseBands:
    """Modes and responses with credible bands: transfer functions, time histories, peaks.

    Args:
        predicted: what :func:`~bayes_ssi.results.predictions.predictions.load_predictions` gives.
        name: model class, or hypothesis of a search; "average" for all by their probabilities.
        request: the response; if None, transfer functions of the acceleration at the top.

    Raises:
        ValueError: there is no such class, place or mode, or a damping ratio is not usable.
    """
    predictions = predicted.of(name)
    if request is None:
        request, _ = completed_request(predicted, predictions)
    damping, frequencies_hz, force_at = request.damping, request.frequencies_hz, request.force_at

    def response(compute: Callable[[Output], Prediction], n_points: int) -> Response:
        curves, peaks = [], []
        places = request.output.places
        # Solving for the modes again costs more than another place does.
        at_once = max(1, ARRAY_SIZE // (predictions.n_draws * n_points))
        for start in range(0, len(places), at_once):
            some = places[start : start + at_once]
            draws = compute(Output(request.output.quantity, some)).draws
            largest = np.maximum(draws.max(-1), -draws.min(-1))
            curves.append(Prediction(draws).band())
            peaks.append(Prediction(largest).band())
        return Response(joined(curves), joined(peaks))

    transfer = None
    if frequencies_hz is not None:
        amplitudes = partial(predictions.transfer_functions, damping=damping, force_at=force_at)
        transfer = response(partial(amplitudes, frequencies_hz), len(frequencies_hz))
    history = partial(predictions.time_histories, damping=damping)
    histories = {each.name: response(partial(history, each), len(each)) for each in request.motions}
    modes = tuple(predicted_modes(predicted.data, predictions))
    places = shown_places(predictions, predicted.data)
    shapes = {m.label: predictions.shapes(m.label, places).band() for m in modes if places}
    return ResponseBands(predictions, request, modes, places, shapes, transfer, histories)


def completed_request(
    predicted: StoredPredictions,
    predictions: Predictions,
    output: Output | Quantity = "acceleration",
    *,
    damping: Damping | None = None,
    source: str | None = None,
    band_hz: tuple[float, float] | None = None,
    motions: tuple[GroundMotion, ...] = (),
) -> tuple[ResponseRequest, list[str]]:
    """The request with what is given and defaults for the rest, and remarks on it.

    Args:
        output: a quantity alone is predicted at the top.
        source: of transfer functions, the ground or a degree of freedom; "none" for none. The
            ground, where it is known how its motion acts, if None.
        band_hz: of transfer functions; that of the data if None.
    """
    given = isinstance(output, Output) or motions or source not in (None, "none")
    if given and not predictions.main_places:
        raise ValueError("the structure has no degrees of freedom: its frequencies alone are known")
    output = output if isinstance(output, Output) else default_output(predictions, output)
    origin = "as given"
    if damping is None:
        damping, origin = default_damping(predicted.data)
    ratios = damping_ratios(damping, np.size(damping))
    where = "in all modes" if len(ratios) == 1 else "mode by mode"
    shown = ", ".join(f"{100 * ratio:.3g}" for ratio in ratios)
    remarks = [f"Damping: {shown} % {where}, {origin}."]
    if ratios.max() > HEAVY_DAMPING:
        remarks.append(f"(!) {heavy_damping_warning(float(ratios.max()))}")
    if source is None and (unknown := structures_of_unknown_ground(predictions)):
        source = "none"
        remarks.append(
            "No transfer functions: how ground motion acts on the degrees of freedom of the "
            f"{type(unknown[0]).__name__} is not known."
        )
    hz, force_at = None, None if source in (None, GROUND, "none") else source
    if source != "none":
        hz = default_frequencies(predicted.data, float(ratios.min()), band_hz)
        acting = f"a force at {force_at!r}" if force_at else "the ground's acceleration"
        remarks.append(
            f"Transfer functions: from {acting}, {len(hz)} frequencies from {hz[0]:g} to "
            f"{hz[-1]:g} Hz."
        )
        if len(hz) == MOST_FREQUENCIES:
            remarks.append("(!) The frequencies may miss the top of a narrow peak; narrow them.")
    remarks += [
        f"Record {motion.name}: {len(motion)} samples, {motion.dt:g} s apart; peak "
        f"{motion.peak_acceleration / UNITS['g']:.3g} g."
        for motion in motions
    ]
    modes_hz = np.median(predictions.classes[0].frequencies_hz, axis=0)
    remarks += [f"(!) {text}." for motion in motions for text in motion.warnings(modes_hz)]
    return ResponseRequest(output, damping, hz, force_at, motions), remarks


def default_damping(data: ModalData) -> tuple[float, str]:
    """A damping ratio for all modes, and its source in words."""
    identified = [mode.damping for mode in data.modes if mode.damping]
    if identified:
        return float(np.median(identified)), "the median of the identified damping ratios"
    return 0.02, "assumed, since none was identified"


def default_output(predictions: Predictions, quantity: Quantity) -> Output:
    """The quantity at the top of the main structure; for drift, between the ground and the top.

    The top is the highest degree of freedom that moves along with the ground, the first of them
    where there are several; where there is none, as of frequencies alone, the ground.
    """
    structure = predictions.classes[0].structure
    heights, influence = structure.heights(), ground_influence(structure)
    places = predictions.main_places
    if influence is not None and influence.any():
        moved = zip(structure.degrees_of_freedom, influence, strict=True)
        moving = {place for place, along_with_ground in moved if along_with_ground}
        places = tuple(place for place in places if place in moving) or places
    top = max(places, key=lambda place: heights[place], default=GROUND)
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
    return np.linspace(low, high, min(max(needed, 400), MOST_FREQUENCIES))


def structures_of_unknown_ground(predictions: Predictions) -> list[Structure]:
    """Structures on which it is not known how the ground's motion acts."""
    structures = [draws.structure for draws in predictions.classes]
    return [s for s in structures if not predictions.main_places or ground_influence(s) is None]


# The file that every directory of predictions holds.
MARKER = "predictions.json"
# Tables that fit on a page; the others are curves, shown as figures.
TABLES = ("frequencies.csv", "peaks.csv")


def predictions_record(
    predicted: StoredPredictions, names: tuple[str, ...], request: ResponseRequest
) -> dict[str, Any]:
    """What the file of that name says of the saved predictions of these classes."""
    damping = request.damping
    return {
        "study": predicted.stored.record.study,
        "result_created": predicted.stored.record.created,
        "configuration": predicted.configuration,
        "predictions_of": names,
        "draws": predicted.n_draws,
        "quantity": request.output.quantity,
        "places": request.output.labels,
        "damping": damping if isinstance(damping, (int, float)) else tuple(damping),
        "transfer_functions": None if request.frequencies_hz is None else request.transfer_name,
        "records": [
            {"name": motion.name, "samples": len(motion), "dt_s": motion.dt}
            for motion in request.motions
        ],
        "versions": versions(),
    }


def load_saved_predictions(result: Path) -> dict[str, Any]:
    """The ``record``, ``tables`` and ``figures`` (paths) of predictions; empty if there are none.

    The first row of a table names its columns.
    """
    directory = result / "predictions"
    if not (directory / MARKER).is_file():
        return {}
    tables = {}
    for name in TABLES:
        if (directory / name).is_file():
            with (directory / name).open(encoding="utf-8", newline="") as file:
                tables[name] = list(csv.reader(file))
    record = read_json(directory / MARKER)
    if missing := {"configuration", "damping", "draws", "predictions_of"} - record.keys():
        raise ValueError(f"{directory / MARKER}: damaged: no {', '.join(sorted(missing))}")
    return {"record": record, "tables": tables, "figures": sorted(directory.glob("figures/*.png"))}


BAND = ("low", "median", "high")
# Name of a file, its columns, and its rows.
CsvTable = tuple[str, Sequence[str], Iterable[Sequence[object]]]


def save_predictions(directory: str | Path, responses: Sequence[ResponseBands]) -> None:
    """Write predictions of one request into ``directory``, which exists.

    A row for each model class, place and point, with seven digits of every number:
    ``frequencies.csv``, ``mode_shapes.csv`` where there are places and, where requested,
    ``transfer_functions.csv``, ``time_histories.csv`` and ``peaks.csv`` (for both).
    """
    for name, columns, rows in _tables(responses):
        rounded = (
            [f"{c:.7g}" if isinstance(c, (float, np.floating)) else c for c in row]
            for row in chain([columns], rows)
        )
        write_csv(Path(directory) / name, rounded)


def _tables(responses: Sequence[ResponseBands]) -> Iterator[CsvTable]:
    request, points = responses[0].request, ("model_class", "place")
    frequencies = (
        (each.name, *mode[:3], *mode.after_hz, mode.share)
        for each in responses
        for mode in each.modes
    )
    columns = ("model_class", "mode", "identified_hz", "before_hz", *BAND, "share")
    yield "frequencies.csv", columns, frequencies
    if responses[0].places:
        shapes = (
            (each.name, label, *row)
            for each in responses
            for label, shape in each.shapes.items()
            for row in zip(each.places, *shape, strict=True)
        )
        yield "mode_shapes.csv", ("model_class", "mode", "place", *BAND), shapes
    if request.frequencies_hz is not None:
        curves = (
            row
            for each in responses
            if each.transfer is not None
            for row in _points(each, request.frequencies_hz, each.transfer.curves)
        )
        yield "transfer_functions.csv", (*points, "frequency_hz", *BAND), curves
    if request.motions:
        histories = (
            (motion.name, *row)
            for motion in request.motions
            for each in responses
            for row in _points(each, motion.times, each.histories[motion.name].curves)
        )
        yield "time_histories.csv", ("record", *points, "time_s", *BAND), histories
    if request.frequencies_hz is not None or request.motions:
        of_transfer = f"transfer function: {request.transfer_name}"
        peaks = (
            (each.name, of_transfer if motion is None else f"time history: {motion}", *row)
            for each in responses
            for motion, *row in each.peak_rows()
        )
        yield "peaks.csv", ("model_class", "of", "unit", "place", *BAND), peaks


def _points(each: ResponseBands, points: FloatArray, band: Band) -> Iterator[Sequence[object]]:
    """Name of the class, place, point, low, median and high."""
    for i, place in enumerate(each.request.output.labels):
        for row in zip(points, *(part[i] for part in band), strict=True):
            yield (each.name, place, *row)
