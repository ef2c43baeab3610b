"""Figures of predictions, written as PNG files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.data import ModalData
from bayes_ssi.figure_style import style
from bayes_ssi.modal import mac
from bayes_ssi.prediction_report import PER_GROUND, UNITS, Answer
from bayes_ssi.predictions import Band, Prediction, Predictions
from bayes_ssi.response_plots import (
    plot_frequency_change,
    plot_mac,
    plot_shape,
    plot_time_history,
    plot_transfer_functions,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["save_prediction_figures"]

# Figures of transfer functions and histories hold so many bands at most.
MOST_DRAWN = 3


def save_prediction_figures(
    directory: str | Path, data: ModalData, answers: Sequence[Answer]
) -> list[Path]:
    """Write figures of the answers to one question into ``directory``, which exists.

    Transfer functions and time histories of the first three answers; for the most probable class
    of the first one its mode shapes, their MACs with the identified shapes, and its frequencies
    before and after updating.

    Args:
        directory: where to.
        data: the identified modes.
        answers: as of :func:`~bayes_ssi.prediction_report.answer`.
    """
    paths = []
    with style():
        for name, figure in _figures(data, answers[:MOST_DRAWN]):
            paths.append(Path(directory) / f"{name}.png")
            figure.savefig(paths[-1])
    return paths


def _figures(data: ModalData, answers: Sequence[Answer]) -> Iterator[tuple[str, Figure]]:
    question = answers[0].question
    yield "transfer_functions", _transfer_functions(answers)
    if question.motion is not None:
        yield "time_histories", _time_histories(answers)
    each = max(answers[0].predictions.classes, key=lambda one: len(one.values))
    paired = [label for label in data.labels if label in each.pairing]
    if not paired:
        return
    own = Predictions(each.name, (each,))
    yield "mode_shapes", _mode_shapes(own, paired, question.level)
    with_shape = [label for label in data.labels if data.mode(label).unit_shape is not None]
    if with_shape:
        yield "mac", _mac(own, data, with_shape, paired)
    yield "frequency_change", _frequency_change(own, data, paired, question.level)


def _at(prediction: Prediction, i: int, level: float) -> Band:
    """The band at one place."""
    return Prediction(prediction.draws[:, i]).band(level)


def _panels(n: int) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 1.0 + 2.2 * n))
    return figure, list(figure.subplots(n, 1, squeeze=False, sharex=True)[:, 0])


def _transfer_functions(answers: Sequence[Answer]) -> Figure:
    question = answers[0].question
    quantity = question.output.quantity
    figure, axes = _panels(len(question.output.labels))
    for i, (place, ax) in enumerate(zip(question.output.labels, axes, strict=True)):
        plot_transfer_functions(
            question.frequencies_hz,
            {each.name: _at(each.transfer_functions, i, question.level) for each in answers},
            ax,
            quantity=f"{quantity} / ground acc. ({PER_GROUND[quantity]})",
            legend=i == 0,
        )
        ax.set_title(f"{place}: median and {100 * question.level:g} % band")
        ax.label_outer()
    return figure


def _time_histories(answers: Sequence[Answer]) -> Figure:
    question = answers[0].question
    quantity = question.output.quantity
    assert question.motion is not None
    figure, axes = _panels(len(question.output.labels))
    for i, (place, ax) in enumerate(zip(question.output.labels, axes, strict=True)):
        bands = {
            each.name: _at(each.time_histories, i, question.level)
            for each in answers
            if each.time_histories is not None
        }
        plot_time_history(
            question.motion.times,
            bands,
            ax,
            quantity=f"{quantity} ({UNITS[quantity]})",
            legend=i == 0,
        )
        ax.set_title(f"{place}: median and {100 * question.level:g} % envelope")
        ax.label_outer()
    return figure


def _mode_shapes(own: Predictions, paired: Sequence[str], level: float) -> Figure:
    from matplotlib.figure import Figure

    structure = own.classes[0].structure
    places = structure.degrees_of_freedom
    main = [place for place in places if place not in structure.appendages]
    figure = Figure(figsize=(0.8 + 1.7 * len(paired), 3.2))
    axes = figure.subplots(1, len(paired), squeeze=False, sharey=True)[0]
    for label, ax in zip(paired, axes, strict=True):
        shape = own.shapes(label, places, unit_over=main).band(level)
        plot_shape(structure, places, shape, ax, title=f"mode {label}")
        ax.label_outer()
    title = figure.suptitle(
        f"{own.name!r}: mode shapes with {100 * level:g} % bands", fontsize=10, x=0.02, ha="left"
    )
    title.set_parse_math(False)
    return figure


def _mac(
    own: Predictions, data: ModalData, with_shape: Sequence[str], paired: Sequence[str]
) -> Figure:
    from matplotlib.figure import Figure

    identified = np.stack([np.asarray(data.mode(each).unit_shape) for each in with_shape], axis=1)
    model = [own.shapes(label, data.sensors).quantile(0.5) for label in paired]
    figure = Figure(figsize=(2.0 + 0.55 * len(paired), 1.1 + 0.45 * len(with_shape)))
    plot_mac(
        mac(identified, np.stack(model, axis=1)),
        with_shape,
        paired,
        figure.subplots(),
        of=("identified mode", f"median mode of {own.name!r}"),
    )
    return figure


def _frequency_change(
    own: Predictions, data: ModalData, paired: Sequence[str], level: float
) -> Figure:
    from matplotlib.figure import Figure

    each = own.classes[0]
    bands = [own.frequencies_hz(label).band(level) for label in paired]
    before = each.structure.modes(each.structure.medians()).frequencies_hz[0]
    figure = Figure(figsize=(6.4, 1.4 + 0.4 * len(paired)))
    plot_frequency_change(
        paired,
        np.array([data.mode(label).frequency_hz for label in paired]),
        np.array([before[each.pairing[label] - 1] for label in paired]),
        Band(*(np.array(part) for part in zip(*bands, strict=True))),
        figure.subplots(),
        level=level,
    )
    return figure
