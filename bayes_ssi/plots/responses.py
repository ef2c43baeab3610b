"""Figures of responses and predictions, on given axes or new ones; they never sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bayes_ssi.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    axes_of,
    draw_as_they_are,
    hover,
    legend_below,
)
from bayes_ssi.predictions.predictions import Band
from bayes_ssi.priors import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "plot_components",
    "plot_frequency_change",
    "plot_mac",
    "plot_shape",
    "plot_time_history",
    "plot_transfer_functions",
]

WIDE = (6.4, 3.2)  # inches
# A band is told from the next one by colour, by lightness and by the line of its median.
BANDS = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (VERMILION, ":"))
# A logarithmic axis begins no lower than this share of its highest value.
LOWEST = 1e-4
# Half the width of a building, in the unit of the shapes that are drawn on it, and how far from its
# axis anything is drawn: appendages may move many times as far as floors.
HALF_WIDTH, REACH = 0.7, 2.1


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
        frequencies_hz: (F,).
        bands: name → band of arrays (F,), at most four.
        ax: axes; new ones if None.
        reference: name and amplitude (F,) of what the bands are held against, a black line.
        quantity: what the amplitude is, with its unit.
        legend: whether to draw one.
    """
    ax = axes_of(ax, WIDE)
    _bands(ax, frequencies_hz, bands)
    if reference is not None:
        ax.plot(frequencies_hz, reference[1], color="black", linewidth=1.1, label=reference[0])
    ax.set_yscale("log")
    # At rest, and where it is annulled, a response is as low as rounding lets it.
    highest = max((float(np.max(band.high)) for band in bands.values()), default=1.0)
    ax.set_ylim(bottom=max(ax.get_ylim()[0], LOWEST * highest))
    ax.set_xlim(float(frequencies_hz[0]), float(frequencies_hz[-1]))
    ax.set_xlabel("frequency (Hz)")
    ax.set_ylabel(quantity)
    ax.grid(alpha=0.3)
    if legend:
        legend_below(ax, columns=2)
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

    Arguments as those of :func:`plot_transfer_functions`, over ``times`` (s).
    """
    ax = axes_of(ax, WIDE)
    _bands(ax, times, bands)
    if reference is not None:
        ax.plot(times, reference[1], color="black", linewidth=0.7, label=reference[0])
    ax.axhline(0.0, color=GREY, linewidth=0.5)
    ax.set_xlim(float(times[0]), float(times[-1]))
    ax.set_xlabel("time (s)")
    ax.set_ylabel(quantity)
    ax.grid(alpha=0.3)
    if legend:
        legend_below(ax, columns=2)
    return ax


def _bands(ax: Axes, x: FloatArray, bands: Mapping[str, Band]) -> None:
    if len(bands) > len(BANDS):
        raise ValueError(f"a figure holds at most {len(BANDS)} bands, got {len(bands)}")
    for (name, band), (colour, line) in zip(bands.items(), BANDS, strict=False):
        ax.fill_between(x, band.low, band.high, color=colour, alpha=0.35, linewidth=0)
        ax.plot(x, band.median, color=colour, linestyle=line, linewidth=1.2, label=name)


class Drawn(Protocol):
    """What a drawing asks of a structure; a stored record of its modes answers it too."""

    @property
    def appendages(self) -> tuple[str, ...]: ...

    def heights(self) -> dict[str, float]: ...


def plot_shape(
    structure: Drawn,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    reference: tuple[str, Sequence[str], FloatArray] | None = None,
    name: str = "model",
    title: str = "",
) -> Axes:
    """A mode shape as the deformed building: floors and columns, appendages marked, with bands.

    An appendage that moves further than the axes reach is an arrow at their edge, its component
    and band written below.

    Args:
        structure: says at which height each degree of freedom is drawn.
        places: degrees of freedom of the shape.
        shape: median and band of the components (n_places,), in a scale in which floors move by
            about 1.
        ax: axes; new ones if None.
        reference: name, places and components of another shape, drawn as crosses.
        name: of the shape, for a legend.
        title: above the building.
    """
    ax = axes_of(ax, (2.2, 3.0))
    heights = structure.heights()
    floors = [i for i, place in enumerate(places) if place not in structure.appendages]
    floors.sort(key=lambda i: heights[places[i]])
    y = np.array([0.0, *(heights[places[i]] for i in floors)])
    low, median, high = (np.r_[0.0, part[floors]] for part in shape)
    ax.axvline(0.0, color=GREY, linewidth=0.6, linestyle=":")
    ax.plot([-0.9 * REACH, 0.9 * REACH], [0, 0], color="black", linewidth=2.0)
    for k, side in enumerate((-HALF_WIDTH, HALF_WIDTH)):
        ax.fill_betweenx(y, low + side, high + side, color=BLUE, alpha=0.35, linewidth=0)
        label = name if k == 0 else None
        ax.plot(median + side, y, color=BLUE, linewidth=1.2, label=label)
    for x, height in zip(median[1:], y[1:], strict=True):
        ax.plot([x - HALF_WIDTH, x + HALF_WIDTH], [height, height], color="black", linewidth=2.5)
    for i, place in enumerate(places):
        if place in structure.appendages:
            _appendage(ax, heights[place], *(float(part[i]) for part in shape))
    _numbers_below(ax, structure, places, shape, REACH - 0.1)
    if reference is not None:
        other, at, components = reference
        ax.plot(components, [heights[place] for place in at], "x", color="black", markersize=7,
                markeredgewidth=1.5, label=other)  # fmt: skip
    ax.set_xlim(-REACH, REACH)
    ax.set_ylim(-0.15, max(heights.values()) + 0.4)
    ax.set_yticks(y, ["ground", *(places[i] for i in floors)])
    draw_as_they_are(ax.get_yticklabels())
    ax.set_xticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(axis="y", length=0)
    draw_as_they_are([ax.set_title(title)])
    return ax


def _appendage(ax: Axes, height: float, low: float, median: float, high: float) -> None:
    inside = abs(median) < REACH - 0.1
    at = median if inside else np.copysign(REACH - 0.1, median)
    if inside:
        ax.errorbar(at, height, xerr=[[median - low], [high - median]], color=VERMILION, capsize=3)
    marker = "s" if inside else "<" if median < 0 else ">"
    ax.plot(at, height, marker, color=VERMILION, markeredgecolor="black", markersize=7,
            linestyle="none", label="appendage", zorder=3)  # fmt: skip


def _numbers_below(
    ax: Axes, structure: Drawn, places: Sequence[str], shape: Band, reach: float
) -> None:
    """Write below the axes the components of appendages that these do not hold."""
    far = [
        # Adding zero makes a negative zero a plain one.
        f"{place}: {median + 0.0:.1f}\n({low + 0.0:.1f} to {high + 0.0:.1f})"
        for i, (place, low, median, high) in enumerate(
            zip(places, *np.round(shape, 1), strict=True)
        )
        if place in structure.appendages and abs(shape.median[i]) >= reach
    ]
    draw_as_they_are([ax.set_xlabel("\n".join(far), fontsize=7)])


def plot_components(
    structure: Drawn,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    title: str = "",
) -> Axes:
    """A mode shape component by component, for structures that move in several directions.

    The axes reach as far as the main structure moves; components of appendages that move further
    are written below.

    Args:
        structure: which says what is an appendage.
        places: degrees of freedom, from the lowest bar upwards.
        shape: median and band of the components (n_places,).
        ax: axes; new ones if None.
        title: above the figure.
    """
    ax = axes_of(ax, (2.6, 0.8 + 0.22 * len(places)))
    y = np.arange(len(places))
    low, median, high = shape
    main = [i for i, place in enumerate(places) if place not in structure.appendages]
    reach = 1.15 * max(1e-300, *(float(np.abs(part[main]).max()) for part in shape))
    colours = [BLUE if i in main else VERMILION for i in y]
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.barh(y, median, height=0.6, color=colours, alpha=0.45)
    ax.errorbar(median, y, xerr=[median - low, high - median], fmt="none", ecolor="black",
                elinewidth=0.8, capsize=2)  # fmt: skip
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-0.5, len(places) - 0.5)
    ax.set_yticks(y, places)
    draw_as_they_are([*ax.get_yticklabels(), ax.set_title(title)])
    _numbers_below(ax, structure, places, shape, reach)
    return ax


def plot_mac(
    matrix: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    ax: Axes | None = None,
    *,
    of: tuple[str, str] = ("", ""),
) -> Axes:
    """A matrix of modal assurance criteria, values written in.

    Args:
        matrix: (n_rows, n_columns), as of :func:`~bayes_ssi.modal.mac`.
        rows, columns: names of the modes.
        ax: axes; new ones if None.
        of: what the rows and what the columns are.
    """
    ax = axes_of(ax, (1.2 + 0.55 * len(columns), 0.9 + 0.5 * len(rows)))
    image = ax.imshow(matrix, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, k), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            ax.text(k, i, f"{value:.2f}", ha="center", va="center", fontsize=8,
                    color="white" if value > 0.6 else "black")  # fmt: skip
    ax.set_xticks(range(len(columns)), columns)
    ax.set_yticks(range(len(rows)), rows)
    draw_as_they_are([*ax.get_xticklabels(), *ax.get_yticklabels()])
    ax.set_ylabel(of[0])
    ax.set_xlabel(of[1])
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    ax.figure.colorbar(image, ax=ax, label="MAC")
    return ax


def plot_frequency_change(
    labels: Sequence[str],
    identified_hz: FloatArray,
    before_hz: FloatArray,
    after: Band,
    ax: Axes | None = None,
    *,
    level: float = 0.95,
) -> Axes:
    """Model frequencies before and after updating, relative to the identified ones.

    Args:
        labels: of the identified modes.
        identified_hz: (n,).
        before_hz: (n,), of the model at the prior medians; NaN where it has no such mode.
        after: bands (n,) of the posterior.
        ax: axes; new ones if None.
        level: that the bands hold, for the legend.
    """
    ax = axes_of(ax, (6.4, 1.4 + 0.4 * len(labels)))
    y = np.arange(len(labels))
    before, low, median, high = (
        100.0 * (np.asarray(part) / identified_hz - 1.0) for part in (before_hz, *after)
    )
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.hlines(y, before, median, color=GREY, linewidth=0.8)
    before_label, after_label = "before: prior medians", f"after: posterior, {100 * level:g} %"
    for i, label in enumerate(labels):
        (point,) = ax.plot(before[i], i, "o", color=VERMILION, markerfacecolor="white",
                           markersize=6,
                           label=None if i else before_label)  # fmt: skip
        bar = ax.errorbar(median[i], i, xerr=[[median[i] - low[i]], [high[i] - median[i]]],
                          fmt="s", color=BLUE, markersize=5, capsize=3,
                          label=None if i else after_label)  # fmt: skip
        hover(point, f"mode {label} before: {before_hz[i]:.4g} Hz, {before[i]:+.2f} %")
        hover(bar, f"mode {label} after: {after.median[i]:.4g} Hz, {median[i]:+.2f} % "
              f"({low[i]:+.2f} to {high[i]:+.2f} %)")  # fmt: skip
    names = [f"{label}\n{f:.4g} Hz" for label, f in zip(labels, identified_hz, strict=True)]
    ax.set_yticks(y, names)
    draw_as_they_are(ax.get_yticklabels())
    ax.set_ylim(len(labels) - 0.5, -0.5)
    ax.set_ylabel("identified mode")
    ax.set_xlabel("model / identified - 1 (%)")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax
