"""Figures can be read: large enough text, nothing cut off, nothing over anything else."""

import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from searches import places_in_space, search_of

import bayes_ssi as bs
from bayes_ssi.plots import figure_style
from bayes_ssi.plots import shape_plots as shapes
from bayes_ssi.plots.class_plots import plot_corner, plot_evidence, plot_frequencies
from bayes_ssi.plots.figure_style import FIGURE_WIDTH, SMALL_TEXT, figures_for_files, whole_figure
from bayes_ssi.plots.place_plots import plot_place_bars
from bayes_ssi.report.report_figures import embedded_drawing
from bayes_ssi.results.predictions.posterior_draws import Band


@pytest.fixture
def posteriors(make_posterior):
    names = ("3", "1-a", "each storey, free errors, infill of mass 0.15")
    return [make_posterior(name, i, pairing={"1": 1, "2a": 2}) for i, name in enumerate(names)]


@pytest.fixture
def plots(posteriors, updated, case_c, make_posterior):
    """Name → how a figure of a report is drawn, of a study with long names."""
    small = make_posterior("4", names=("mass ratio, infill 1-2", "E", "k"))
    small = replace(small, draws=0.9 + 1e-3 * small.draws)
    return {
        "evidence": lambda: plot_evidence(bs.compare(posteriors)),
        "frequencies": lambda: plot_frequencies(case_c, posteriors),
        "identified": lambda: shapes.plot_identified_modes(case_c, configuration="as built"),
        "shapes": lambda: shapes.plot_mode_shapes(updated, case_c),
        "bars": lambda: plot_place_bars(search_of(places_in_space([0.2] + 20 * [0.01]))),
        "corner": lambda: plot_corner(posteriors[0]),
        "corner of small ranges": lambda: plot_corner(small),
    }


def texts_of(figure):
    """Every text that is drawn."""
    texts = [text for legend in figure.legends for text in legend.get_texts()]
    texts += [figure._suptitle] if figure._suptitle else []
    for ax in figure.axes:
        texts += [ax.title, ax._left_title, *ax.texts]
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            texts += [axis.label, axis.offsetText] if ax.axison else []
            texts += [tick.label1 for tick in axis.get_major_ticks()
                      if low <= tick.get_loc() <= high and ax.axison]  # fmt: skip
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


@pytest.mark.parametrize("name", ["evidence", "frequencies", "identified", "shapes",
                                  "bars", "corner", "corner of small ranges"])  # fmt: skip
def test_text_is_large_enough_and_neither_cut_nor_covered(plots, name):
    with figures_for_files():
        figure = whole_figure(plots[name]())
        figure.draw_without_rendering()
    texts, page = texts_of(figure), figure.bbox
    assert len(texts) > 3
    boxes = {text: text.get_window_extent() for text in texts}
    for text, box in boxes.items():
        assert text.get_fontsize() >= SMALL_TEXT, text
        assert min(box.x0, box.y0) >= -1, text
        assert box.x1 <= page.x1 + 1, text
        assert box.y1 <= page.y1 + 1, text
    for i, text in enumerate(texts):
        for other in texts[:i]:
            assert not overlap(boxes[text], boxes[other]), (text, other)


def overlap(a, b):
    """Whether boxes of text overlap by more than a pixel each way."""
    return min(a.x1, b.x1) - max(a.x0, b.x0) > 1 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1


def test_figures_fit_a_telephone_and_stand_two_abreast(plots):
    css = (files("bayes_ssi") / "report/templates/style.css").read_text("utf-8")
    ((least,),) = [re.findall(r"min-width: calc\(([\d.]+) \* var\(--natural\)\)", css)]
    assert float(least) * SMALL_TEXT >= 7.0  # points
    with figures_for_files():
        drawn = {name: embedded_drawing(whole_figure(plots[name]()), "x", "x")
                 for name in ("evidence", "shapes", "bars")}  # fmt: skip
    for figure in drawn.values():
        assert figure.width == round(96 * FIGURE_WIDTH)
        # 420 pixels less the margins of the page and of a model class: 0.7 + 0.6 rem, a border.
        assert float(least) * figure.width <= 420 - 2 * (1.3 * 16 + 1)
        assert not figure.is_wide
        assert f'width="{72 * FIGURE_WIDTH:.6g}pt"' in figure.html


def test_an_appendage_beyond_the_scale_is_in_the_legend_and_within_its_panel(updated, case_c):
    near, far = (np.array([0.7, 0.2, -1.0, component]) for component in (0.5, -3.4))
    modes = tuple(
        replace(mode, shape_after=(at - 0.1, at, at + 0.1))
        for mode, at in zip(updated.modes, (near, far), strict=False)
    )
    figure = shapes.plot_mode_shapes(replace(updated, modes=modes), case_c)
    figure.draw_without_rendering()
    legend = [text.get_text().replace("\n", " ") for text in figure.legends[0].get_texts()]
    assert {"appendage", shapes.BEYOND} <= set(legend)
    ax = figure.axes[1]
    (mark,) = [line for line in ax.lines if line.get_label() == shapes.BEYOND]
    at = ax.transData.transform(mark.get_xydata())[0]
    half = 0.5 * mark.get_markersize() * figure.dpi / 72
    assert ax.bbox.x0 <= at[0] - half < at[0] + half <= ax.bbox.x1


def test_components_of_one_direction_stand_together(augmented):
    places = [f"floor {i} {way}" for i in (1, 2) for way in ("x", "y", "torsion")]
    shape = Band(*(np.arange(6.0) / 5.0 + d for d in (-0.1, 0.0, 0.1)))
    ax = shapes.plot_shape_components(augmented, places, shape)
    assert [text.get_text() for text in ax.get_yticklabels()] == [
        f"floor {i} {way}" for way in ("x", "y", "torsion") for i in (1, 2)
    ]
    assert [bar.get_width() for bar in ax.patches] == [0.0, 0.6, 0.2, 0.8, 0.4, 1.0]
    assert len({bar.get_facecolor() for bar in ax.patches}) == 3
    np.testing.assert_allclose(np.diff(ax.get_yticks()), [1.0, 1.5, 1.0, 1.5, 1.0])


def test_names_in_other_scripts_are_drawn_without_warnings(monkeypatch, make_posterior):
    """In a font that has the letters, or, where there is none, as boxes."""
    posteriors = [make_posterior("塔 🏗", names=("剛性", "k2")), make_posterior("b", -2.0)]
    with figures_for_files():
        whole_figure(plot_evidence(bs.compare(posteriors))).draw_without_rendering()
        embedded_drawing(plot_corner(posteriors[0]), "塔", "x")
    # STIX, which is installed with matplotlib, has a script capital that DejaVu Sans lacks.
    monkeypatch.setattr(figure_style, "OTHER_FONTS", ("no such font", "STIXGeneral"))
    with figures_for_files():
        (label, _) = plot_evidence(bs.compare(posteriors)).get_yticklabels()
    assert label.get_fontfamily()[-1] == "STIXGeneral"
    assert "no such font" not in label.get_fontfamily()
