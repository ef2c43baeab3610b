"""Figures of predictions, written as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.modal import mac
from bayes_ssi.plots.changes import plot_frequency_change
from bayes_ssi.plots.responses import plot_mac, plot_time_history, plot_transfer_functions
from bayes_ssi.plots.shapes import plot_components, plot_shape
from bayes_ssi.plots.style import draw_as_they_are, legend_of_figure, style
from bayes_ssi.predictions.bands import Band
from bayes_ssi.predictions.predicted_modes import predicted_modes, shown_places
from bayes_ssi.predictions.predictions import Predictions
from bayes_ssi.predictions.response_bands import ResponseBands
from bayes_ssi.response.ground_motion import GroundMotion
from bayes_ssi.response.modal_response import ground_influence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["save_prediction_figures"]

# Figures of transfer functions and histories hold so many bands at most.
MOST_DRAWN = 3
# Mode shapes stand in rows of so many.
MODES_ACROSS = 6


def save_prediction_figures(
    directory: str | Path, data: ModalData, answers: Sequence[ResponseBands]
) -> list[Path]:
    """Write figures of the answers to one question into ``directory``, which is made.

    Transfer functions and time histories of the first three answers, as far as they were asked
    for; for the most probable class of the first one its mode shapes, their MACs with the
    identified shapes, and its frequencies before and after updating.

    Args:
        directory: where to.
        data: the identified modes.
        answers: as of :func:`~bayes_ssi.predictions.response_bands.answer`.

    Raises:
        FileExistsError: the directory exists.
    """
    Path(directory).mkdir()
    paths = []
    with style():
        for name, figure in _figures(data, answers[:MOST_DRAWN]):
            paths.append(Path(directory) / f"{name}.png")
            figure.savefig(paths[-1])
    return paths


def _figures(data: ModalData, answers: Sequence[ResponseBands]) -> Iterator[tuple[str, Figure]]:
    question = answers[0].question
    if question.frequencies_hz is not None:
        yield "transfer_functions", _transfer_functions(answers, question.frequencies_hz)
    for i, motion in enumerate(question.motions, 1):
        number = f"_{i}" if len(question.motions) > 1 else ""
        yield f"time_histories{number}", _time_histories(answers, motion)
    each = max(answers[0].predictions.classes, key=lambda one: len(one.values))
    paired = [label for label in data.labels if label in each.pairing]
    if not paired:
        return
    own = Predictions(each.name, (each,))
    yield "mode_shapes", _mode_shapes(own, data, paired, question.level)
    with_shape = [label for label in data.labels if data.mode(label).unit_shape is not None]
    if with_shape:
        yield "mac", _mac(own, data, with_shape, paired)
    yield "frequency_change", _frequency_change(own, data, question.level)


def _at(band: Band, i: int) -> Band:
    """The band at one place."""
    return Band(*(part[i] for part in band))


def _by_place(
    answers: Sequence[ResponseBands], plot: Callable[[int, Axes], object], told: str
) -> Figure:
    """A panel for each place of the question, below one another, with one legend."""
    from matplotlib.figure import Figure

    places = answers[0].question.output.labels
    figure = Figure(figsize=(6.4, 1.0 + 2.2 * len(places)))
    axes = figure.subplots(len(places), 1, squeeze=False, sharex=True)[:, 0]
    for i, (place, ax) in enumerate(zip(places, axes, strict=True)):
        plot(i, ax)
        draw_as_they_are([ax.set_title(f"{place}: {told}", fontsize=9)])
        ax.label_outer()
    legend_of_figure(figure, axes[0])
    return figure


def _transfer_functions(answers: Sequence[ResponseBands], frequencies_hz: FloatArray) -> Figure:
    question = answers[0].question

    def plot(i: int, ax: Axes) -> None:
        bands = {
            each.name: _at(each.transfer_functions, i)
            for each in answers
            if each.transfer_functions is not None
        }
        quantity = f"amplitude ({question.transfer_unit})"
        plot_transfer_functions(frequencies_hz, bands, ax, quantity=quantity, legend=False)

    told = f"{question.transfer_name}, median and {100 * question.level:g} % band"
    return _by_place(answers, plot, told)


def _time_histories(answers: Sequence[ResponseBands], motion: GroundMotion) -> Figure:
    question = answers[0].question

    def plot(i: int, ax: Axes) -> None:
        bands = {each.name: _at(each.time_histories[motion.name], i) for each in answers}
        quantity = f"{question.output.quantity} ({question.unit})"
        plot_time_history(motion.times, bands, ax, quantity=quantity, legend=False)

    told = f"{motion.name}, median and {100 * question.level:g} % envelope"
    return _by_place(answers, plot, told)


def _mode_shapes(own: Predictions, data: ModalData, paired: Sequence[str], level: float) -> Figure:
    from matplotlib.figure import Figure

    structure = own.classes[0].structure
    main = shown_places(own, data)
    places = (*main, *structure.appendages)
    influence = ground_influence(structure)
    in_a_row = influence is None or bool((influence == 1.0).all())
    across = min(len(paired), MODES_ACROSS)
    down = -(-len(paired) // across)
    height = 3.2 if in_a_row else 0.8 + 0.2 * len(places)
    figure = Figure(figsize=(0.8 + 1.7 * across, 0.3 + height * down))
    axes = figure.subplots(down, across, squeeze=False, sharey=True)
    for label, ax in zip(paired, axes.flat, strict=False):
        shape = own.shapes(label, places, unit_over=main).band(level)
        if in_a_row:
            plot_shape(structure, places, shape, ax, title=f"mode {label}")
        else:
            plot_components(structure, places, shape, ax, title=f"mode {label}")
        ax.tick_params(labelleft=bool(ax.get_subplotspec().is_first_col()))
    for ax in axes.flat[len(paired) :]:
        ax.remove()
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
    model = [own.shapes_at_sensors(label).quantile(0.5) for label in paired]
    figure = Figure(figsize=(2.0 + 0.55 * len(paired), 1.1 + 0.45 * len(with_shape)))
    plot_mac(
        mac(identified, np.stack(model, axis=1)),
        with_shape,
        paired,
        figure.subplots(),
        of=("identified mode", f"median mode of {own.name!r}"),
    )
    return figure


def _frequency_change(own: Predictions, data: ModalData, level: float) -> Figure:
    from matplotlib.figure import Figure

    modes = list(predicted_modes(data, own, level))
    figure = Figure(figsize=(6.4, 1.4 + 0.4 * len(modes)))
    plot_frequency_change(
        [mode.label for mode in modes],
        np.array([mode.identified_hz for mode in modes]),
        np.array([mode.before_hz for mode in modes]),
        Band(*(np.array(part) for part in zip(*(mode.after_hz for mode in modes), strict=True))),
        figure.subplots(),
        level=level,
    )
    return figure
