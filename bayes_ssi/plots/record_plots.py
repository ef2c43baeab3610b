"""From a vibration record to its modes: spectra, stabilisation, residuals, shapes and phases."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from bayes_ssi.measurements.records.modal_identification import ModalIdentification
from bayes_ssi.plots import figure_style as look
from bayes_ssi.plots.moving_shapes import plot_moving_shapes
from bayes_ssi.plots.shape_plots import plot_identified_modes

MOVING = "moving_shapes.html"
# The figures of an identification by the names of their files.
CAPTIONS = {
    "singular_values": "Singular values of the record's spectral matrices and of the fit's; modes "
    "with 90 % intervals",
    "stabilisation": "Poles of each octave over orders, the candidates; modes with 90 % intervals",
    "whitened_residuals": "What is left of each spectral matrix divided by the fit's: 1 on average "
    "where the fit is right",
    "shapes": "Identified modes and shapes, largest component ±1, with 90 % intervals",
    "complexity": "Phases of the motion at each mode: on one line where the mode is real and alone",
}


def plot_singular_values(identified: ModalIdentification, ax: Axes | None = None) -> Axes:
    """Singular values of the spectral matrices and of the fit's, and the modes with 90 % widths."""
    ax = _axes(ax)
    frequencies = identified.spectrum.frequencies_hz
    measured = np.linalg.eigvalsh(identified.spectrum.matrices)[:, ::-1]
    for k in range(measured.shape[1]):
        ax.semilogy(frequencies, measured[:, k], color=look.BLUE, linewidth=0.6, alpha=0.6,
                    label=None if k else "record")  # fmt: skip
    for i, band in enumerate(band for band in identified.bands if band.is_wanted):
        ax.semilogy(band.fit.data.frequencies_hz, band.singular_values(), color=look.VERMILION,
                    linewidth=1.0)  # fmt: skip
        if i == 0:
            ax.lines[-1].set_label(f"fit, {identified.loads}")
    _draw_modes(ax, identified)
    for i, (frequency, _) in enumerate(identified.not_identified):
        ax.axvline(frequency, color=look.GREY, linewidth=0.8, linestyle=":",
                   label=None if i else "peak not identified")  # fmt: skip
    # What is far below the noise is of no interest.
    ax.set_ylim(bottom=0.3 * float(np.quantile(measured[:, min(3, measured.shape[1]) - 1], 0.02)))
    unit = identified.record.unit
    if identified.record.quantity != "acceleration":  # into which records are turned
        unit = f"{unit.removesuffix('/s')}/s²"
    of = f"over those of {identified.ground!r}" if identified.ground else f"(({unit})²/Hz)"
    ax.set_ylabel(f"singular values {of}")
    look.title_of(ax, "Singular values of the spectral matrices")
    look.legend_below(ax, columns=4)
    return ax


def plot_stabilisation(identified: ModalIdentification, ax: Axes | None = None) -> Axes:
    """Poles of every order of each octave, and the modes with 90 % widths."""
    ax = _axes(ax)
    frequencies, orders = identified.candidates.stabilisation
    ax.plot(frequencies, orders, "o", color=look.BLUE, markersize=2, label="pole")
    _draw_modes(ax, identified)
    ax.set_ylabel("order")
    look.title_of(ax, "Stabilisation of poles, octave by octave")
    look.legend_below(ax, columns=3)
    return ax


def plot_whitened_residuals(identified: ModalIdentification, ax: Axes | None = None) -> Axes:
    """What is left of each spectral matrix when it is divided by the fit's.

    Squared deviations from the unit matrix, over their number: 1 on average where the fit is right.
    """
    ax = _axes(ax)
    parts = [band.fit.residuals() for band in identified.bands if band.is_wanted]
    n_near = max(1, sum(len(left) for _, left in parts) // 40)
    for i, (frequencies, left) in enumerate(parts):
        ax.semilogy(frequencies, left, ".", color=look.BLUE, markersize=3,
                    label=None if i else "block of lines")  # fmt: skip
        # In each band by itself: there is nothing between bands. One of few blocks has one mean.
        n = min(n_near, len(left))
        means = (np.convolve(each, np.full(n, 1.0 / n), "valid") for each in (frequencies, left))
        ax.plot(*means, ".-", color=look.ORANGE, linewidth=1.2, markersize=1.0,
                label=None if i else f"mean of {n_near} blocks")  # fmt: skip
    ax.axhline(1.0, color=look.GREY, linewidth=0.8)
    ax.set_xlim(parts[0][0][0], parts[-1][0][-1])
    ax.set_ylabel("chi-square over its number")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_locator(NullLocator())
    title = f"Whitened residuals: up to {identified.whiteness:.2f} in a band"
    look.title_of(ax, f"{title}, {identified.allowed_whiteness:.2f} accepted there")
    look.legend_below(ax, columns=2)
    return ax


def plot_complexity(identified: ModalIdentification) -> Figure:
    """Phases of the motion at each quoted frequency: 0 or 180 degrees for a real mode alone.

    Components of the first singular vector of the nearest spectral matrix, one for each sensor; the
    outer circle is 1.
    """
    frequencies = identified.quoted.frequencies_hz
    # All but the ground, where that is measured.
    channels = [i for i, name in enumerate(identified.record.sensors) if name != identified.ground]
    polar = {"projection": "polar"}
    figure, axes = look.panels_of(len(frequencies), 0.0, 1.9, subplot_kw=polar)
    for frequency, ax in zip(frequencies, axes, strict=True):
        ends = np.array([each.band_hz for each in identified.bands])
        nearest = np.abs(frequency - ends.mean(axis=1)) / np.ptp(ends, axis=1)
        data = identified.bands[nearest.argmin()].fit.data
        nearest = np.abs(data.frequencies_hz - frequency).argmin()
        leading = np.linalg.eigh(data.matrices[nearest])[1][:, -1]
        motion = data.to_channels[channels] @ leading
        motion = motion / np.linalg.norm(motion)
        motion = motion * np.exp(-0.5j * np.angle((motion**2).sum()))
        motion *= np.sign(motion.real[np.abs(motion.real).argmax()])
        for sensor, component in zip(identified.quoted.sensors, motion, strict=True):
            phase, size = np.angle(component), abs(component)
            ax.plot([phase, phase], [0.0, size], color=look.BLUE, linewidth=1.2)
            (end,) = ax.plot(phase, size, "o", color=look.BLUE, markersize=3)
            look.hover(end, f"{sensor}: {size:.3f}, {np.degrees(phase):.1f}°")
        ax.set_ylim(0.0, 1.0)
        ax.set_yticks([0.5, 1.0], ["", ""])
        ax.set_xticks(np.pi * np.arange(4) / 2.0, ["0°", "", "180°", ""], fontsize=look.SMALL_TEXT)
        ax.set_title(f"{frequency:.4g} Hz", fontsize=look.SMALL_TEXT)
    return figure


def save_record_figures(directory: Path, identified: ModalIdentification) -> list[Path]:
    """Write the figures of an identification as PNG files, and a page of shapes that move."""
    directory.mkdir(parents=True)
    if len(identified.too_short) < len(identified.modes):
        plot_moving_shapes(identified.modal_data()).save(directory / MOVING)
    return look.save_figures(directory, _figures(identified))


def _figures(identified: ModalIdentification) -> Iterator[look.NamedFigure]:
    yield "singular_values", plot_singular_values(identified)
    if identified.candidates.stabilisation.size:
        yield "stabilisation", plot_stabilisation(identified)
    yield "whitened_residuals", plot_whitened_residuals(identified)
    if len(identified.too_short) < len(identified.modes):
        yield "shapes", plot_identified_modes(identified.modal_data())
    yield "complexity", plot_complexity(identified)


def _axes(ax: Axes | None) -> Axes:
    ax = look.axes_of(ax, (6.3, 3.2))
    ax.set_xlabel("frequency (Hz)")
    return ax


def _draw_modes(ax: Axes, identified: ModalIdentification) -> None:
    """The modes in their band, with 90 % widths."""
    ax.set_xlim(*identified.band_hz)
    for i, mode in enumerate(identified.modes):
        frequency, cov = mode.frequency_hz, mode.frequency_cov
        half = look.SDS_OF_90_PERCENT * cov * frequency
        ax.axvspan(frequency - half, frequency + half, color=look.ORANGE, alpha=0.6, linewidth=0)
        line = ax.axvline(frequency, color=look.ORANGE, linewidth=0.8,
                          label=None if i else f"mode by {identified.method}, 90 %")  # fmt: skip
        look.hover(line, f"{frequency:.5g} Hz ± {100 * cov:.2g} %")
