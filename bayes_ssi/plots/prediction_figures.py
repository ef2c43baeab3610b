"""The figures of predictions, written as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.modal import mac
from bayes_ssi.plots.before_and_after import plot_frequency_change
from bayes_ssi.plots.figure_style import (
    LINES,
    WIDTH,
    figure_of,
    figures_for_files,
    legend_of_figure,
    save_figure,
    without_math,
)
from bayes_ssi.plots.identified_modes import PANELS_ACROSS
from bayes_ssi.plots.matrix_plots import plot_mac
from bayes_ssi.plots.response_plots import plot_time_history, plot_transfer_functions
from bayes_ssi.plots.shape_plots import plot_building_shape, plot_shape_components
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


def save_prediction_figures(
    directory: str | Path, data: ModalData, responses: Sequence[ResponseBands]
) -> list[Path]:
    """Write figures of predictions of one request into ``directory``, which is made.

    Transfer functions and time histories of the first four model classes, where requested;
    for the most probable class of the first one its mode shapes, their MACs with the
    identified shapes, and its frequencies before and after updating.

    Args:
        directory: where to.
        data: the identified modes.
        responses: as of :func:`~bayes_ssi.predictions.response_bands.predict_responses`.

    Raises:
        FileExistsError: the directory exists.
    """
    Path(directory).mkdir()
    with figures_for_files():
        return [
            save_figure(drawn, Path(directory) / f"{name}.png")
            for name, drawn in _figures(data, responses[: len(LINES)])
        ]


def _figures(
    data: ModalData, responses: Sequence[ResponseBands]
) -> Iterator[tuple[str, Axes | Figure]]:
    request = responses[0].request
    if request.frequencies_hz is not None:
        yield "transfer_functions", _transfer_functions(responses, request.frequencies_hz)
    for i, motion in enumerate(request.motions, 1):
        number = f"_{i}" if len(request.motions) > 1 else ""
        yield f"time_histories{number}", _time_histories(responses, motion)
    each = max(responses[0].predictions.classes, key=lambda one: len(one.values))
    paired = [label for label in data.labels if label in each.pairing]
    if not paired:
        return
    own = Predictions(each.name, (each,))
    yield "mode_shapes", _mode_shapes(own, data, paired, request.level)
    with_shape = [label for label in data.labels if data.mode(label).unit_shape is not None]
    if with_shape:
        yield "mac", _mac(own, data, with_shape, paired)
    modes = list(predicted_modes(data, own, request.level))
    yield "frequency_change", plot_frequency_change(modes, data, level=request.level)


def _at(band: Band, i: int) -> Band:
    """The band at one place."""
    return Band(*(part[i] for part in band))


def _by_place(
    responses: Sequence[ResponseBands], plot: Callable[[int, Axes], object], title: str
) -> Figure:
    """A panel for each place, one below the other, with one legend."""
    places = responses[0].request.output.labels
    figure = figure_of(None, (WIDTH, 1.0 + 2.2 * len(places)))
    axes = figure.subplots(len(places), 1, squeeze=False, sharex=True)[:, 0]
    for i, (place, ax) in enumerate(zip(places, axes, strict=True)):
        plot(i, ax)
        without_math(ax.set_title(f"{place}: {title}", fontsize=9))
        ax.label_outer()
    legend_of_figure(figure, axes[0])
    return figure


def _transfer_functions(responses: Sequence[ResponseBands], frequencies_hz: FloatArray) -> Figure:
    request = responses[0].request

    def plot(i: int, ax: Axes) -> None:
        bands = {
            each.name: _at(each.transfer_functions, i)
            for each in responses
            if each.transfer_functions is not None
        }
        quantity = f"amplitude ({request.transfer_unit})"
        plot_transfer_functions(frequencies_hz, bands, ax, quantity=quantity, legend=False)

    title = f"{request.transfer_name}, median and {100 * request.level:g} % band"
    return _by_place(responses, plot, title)


def _time_histories(responses: Sequence[ResponseBands], motion: GroundMotion) -> Figure:
    request = responses[0].request

    def plot(i: int, ax: Axes) -> None:
        bands = {each.name: _at(each.time_histories[motion.name], i) for each in responses}
        quantity = f"{request.output.quantity} ({request.unit})"
        plot_time_history(motion.times, bands, ax, quantity=quantity, legend=False)

    title = f"{motion.name}, median and {100 * request.level:g} % envelope"
    return _by_place(responses, plot, title)


def _mode_shapes(own: Predictions, data: ModalData, paired: Sequence[str], level: float) -> Figure:
    structure = own.classes[0].structure
    main = shown_places(own, data)
    places = (*main, *structure.appendages)
    influence = ground_influence(structure)
    sideways = influence is None or bool((influence == 1.0).all())
    plot: Callable[..., Axes] = plot_building_shape if sideways else plot_shape_components
    across = min(len(paired), PANELS_ACROSS)
    down = -(-len(paired) // across)
    height = 3.2 if sideways else 0.8 + 0.2 * len(places)
    figure = figure_of(None, (0.8 + 1.7 * across, 0.3 + height * down))
    axes = figure.subplots(down, across, squeeze=False, sharey=True)
    for label, ax in zip(paired, axes.flat, strict=False):
        shape = own.shapes(label, places, unit_over=main).band(level)
        plot(structure, places, shape, ax, title=f"mode {label}")
        ax.tick_params(labelleft=bool(ax.get_subplotspec().is_first_col()))
    for ax in axes.flat[len(paired) :]:
        ax.remove()
    title = f"{own.name!r}: mode shapes with {100 * level:g} % bands"
    without_math(figure.suptitle(title, fontsize=10, x=0.02, ha="left"))
    return figure


def _mac(
    own: Predictions, data: ModalData, with_shape: Sequence[str], paired: Sequence[str]
) -> Axes:
    identified = np.stack([np.asarray(data.mode(each).unit_shape) for each in with_shape], axis=1)
    model = [own.shapes_at_sensors(label).quantile(0.5) for label in paired]
    matrix = mac(identified, np.stack(model, axis=1))
    names = ("identified mode", f"median mode of {own.name!r}")
    return plot_mac(matrix, with_shape, paired, of=names)
