"""Predicted responses with their bands."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.plots import figure_style as look
from bayes_ssi.results.predictions.posterior_draws import Band
from bayes_ssi.results.predictions.requested_predictions import ResponseBands


def plot_transfer_functions(
    frequencies_hz: FloatArray,
    bands: Mapping[str, Band],
    ax: Axes | None = None,
    *,
    reference: tuple[str, FloatArray] | None = None,
    quantity: str = "amplitude",
    legend: bool = True,
) -> Axes:
    """Amplitudes of transfer functions with their bands, on a logarithmic axis.

    Args:
        frequencies_hz: (F,), frequencies of the amplitudes.
        bands: name → band of arrays (F,), at most four.
        reference: name and amplitude (F,) of a black line to compare the bands with.
        quantity: name and unit of the amplitude.
    """
    ax = _draw(ax, frequencies_hz, bands, reference, 1.1, ("frequency (Hz)", quantity), legend)
    ax.set_yscale("log")
    highest = max((float(np.max(band.high)) for band in bands.values()), default=1.0)
    # Where a response vanishes or cancels out, only rounding errors are left: show 4 decades.
    ax.set_ylim(bottom=max(ax.get_ylim()[0], 1e-4 * highest))
    return ax


def plot_time_history(
    times: FloatArray,
    bands: Mapping[str, Band],
    ax: Axes | None = None,
    *,
    reference: tuple[str, FloatArray] | None = None,
    quantity: str = "response",
    legend: bool = True,
) -> Axes:
    """Time histories with the envelope of their draws.

    Arguments are as in :func:`plot_transfer_functions`, over ``times`` (s).
    """
    ax = _draw(ax, times, bands, reference, 0.7, ("time (s)", quantity), legend)
    ax.axhline(0.0, color=look.GREY, linewidth=0.5)
    return ax


def _draw(
    ax: Axes | None,
    x: FloatArray,
    bands: Mapping[str, Band],
    reference: tuple[str, FloatArray] | None,
    linewidth: float,
    names: tuple[str, str],
    legend: bool,
) -> Axes:
    if len(bands) > len(look.LINES):
        raise ValueError(f"a figure holds at most {len(look.LINES)} bands, got {len(bands)}")
    ax = look.axes_of(ax, (look.FIGURE_WIDTH, 3.2))
    for (name, band), colour, line in zip(bands.items(), look.COLOURS, look.LINES, strict=False):
        ax.fill_between(x, band.low, band.high, color=colour, alpha=0.35, linewidth=0)
        ax.plot(x, band.median, color=colour, linestyle=line, linewidth=1.2, label=name)
    if reference is not None:
        name, curve = reference
        ax.plot(x, curve, color="black", linewidth=linewidth, label=name)
    ax.set(xlim=(float(x[0]), float(x[-1])), xlabel=names[0], ylabel=names[1])
    ax.grid(alpha=0.3)
    if legend:
        look.legend_below(ax, columns=2)
    return ax


def save_prediction_figures(
    directory: str | Path, responses: Sequence[ResponseBands]
) -> list[Path]:
    """Write figures of predictions of one request into ``directory``, which is created.

    Transfer functions and time histories of the first four model classes, where requested.
    """
    Path(directory).mkdir()
    return look.save_figures(Path(directory), _figures(responses[: len(look.LINES)]))


def _figures(responses: Sequence[ResponseBands]) -> Iterator[look.NamedFigure]:
    request = responses[0].request
    places = request.output.labels
    if request.frequencies_hz is not None:
        bands = {each.name: each.transfer.curves for each in responses if each.transfer}
        plot = partial(plot_transfer_functions, request.frequencies_hz,
                       quantity=f"amplitude ({request.transfer_unit})")  # fmt: skip
        title = f"{request.transfer_name}, median and 90 % band"
        yield "transfer_functions", _by_place(places, bands, plot, title)
    for i, motion in enumerate(request.motions, 1):
        bands = {each.name: each.histories[motion.name].curves for each in responses}
        quantity = f"{request.output.quantity} ({request.unit})"
        plot = partial(plot_time_history, motion.times, quantity=quantity)
        title = f"{motion.name}, median and 90 % envelope"
        number = f"_{i}" if len(request.motions) > 1 else ""
        yield f"time_histories{number}", _by_place(places, bands, plot, title)


def _by_place(
    places: Sequence[str], bands: Mapping[str, Band], plot: Callable[..., Axes], title: str
) -> Figure:
    """A panel for each place, one below the other, with one legend."""
    figure = look.new_figure((look.FIGURE_WIDTH, 1.0 + 2.2 * len(places)))
    axes = figure.subplots(len(places), 1, squeeze=False, sharex=True)[:, 0]
    for i, (place, ax) in enumerate(zip(places, axes, strict=True)):
        plot({name: Band(*(part[i] for part in band)) for name, band in bands.items()}, ax,
             legend=False)  # fmt: skip
        look.title_of(ax, f"{place}: {title}")
        ax.label_outer()
    look.legend_of_figure(figure, axes)
    return figure
