"""Places of a search: in space, and as bars."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from searches import place_record, places_in_space, search_of

import bayes_ssi as bs
from bayes_ssi.plots.figure_style import MOST_VECTORS, figures_for_files
from bayes_ssi.plots.place_plots import MOST_BARS, plot_place_map, plot_places
from bayes_ssi.studies.appendages.candidates import PendulumPlace

GEOMETRY = bs.Geometry({"a": (0.0, 0.0, 0.0), "b": (9.0, 0.0, 4.0)}, (("a", "b"),), "m")
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@pytest.fixture
def draw():
    """Draws places, as a search would, and lays the figure out."""

    def drawn(places, geometry=None):
        with figures_for_files():
            ax = plot_places(search_of(places, geometry))
            ax.figure.draw_without_rendering()
        return ax

    return drawn


def loose(probabilities):
    """Places without coordinates."""
    return [place_record(PendulumPlace(bs.Candidate(f"s{i}", f"s{i}")), probability)
            for i, probability in enumerate(probabilities)]  # fmt: skip


def title_of(ax):
    return " ".join(ax.figure.get_suptitle().split())


def labels_of(ax):
    return [text.get_text() for legend in ax.figure.legends for text in legend.get_texts()]


def test_arrows_have_the_direction_of_their_places_and_the_colour_of_their_probability(draw):
    ax = draw(places_in_space((0.001, 0.002, 0.3, 0.05, 0.0, 0.6), (X, Z)), GEOMETRY)
    structure, dots, *arrows = ax.collections
    assert len(structure._segments3d) == 1
    assert dots.get_label() == "improbable place"
    assert [len(each) for each in dots._offsets3d] == [1, 1, 1]  # below 1 % of the highest
    assert len(arrows) == 3  # the least probable first
    shafts = np.array([arrow._segments3d[0] for arrow in arrows])
    along = shafts[:, 0] - shafts[:, 1]
    np.testing.assert_allclose(along / np.linalg.norm(along, axis=1)[:, None], [Z, X, Z], atol=1e-9)
    colours = np.array([arrow.get_color()[0] for arrow in arrows])
    # As the eye weighs red, green and blue.
    assert (np.diff(colours[:, :3] @ [0.299, 0.587, 0.114]) < 0.0).all()
    assert title_of(ax) == "Most probable: pendulum p5, 0.6000 x 0 to 9, y 0 to 0, z 0 to 4 (m)"
    assert [text.get_text() for text in ax.texts] == ["x", "y", "z"]
    assert "probability of an appendage" in {each.get_xlabel() for each in ax.figure.axes}
    assert labels_of(ax) == ["improbable place", "place and direction"]
    assert arrows[-1].get_gid() == "hover: pendulum p5: probability 0.6000"


@pytest.mark.parametrize("far", [(9.0, 0.0, 0.0), (9.0, 0.0, 60.0), (9.0, 9.0, 1.0), (0.1, 0, 0)])
def test_nothing_of_a_map_is_cut_off(far):
    geometry = bs.Geometry({"a": (0.0, 0.0, 0.0), "b": far}, (("a", "b"),), "m")
    with figures_for_files():
        figure = plot_place_map(search_of(places_in_space((0.3, 0.6), (X, Z)), geometry)).figure
        FigureCanvasAgg(figure).draw()
    page = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    assert min(each.min() for each in (page[0], page[-1], page[:, 0], page[:, -1])) == 255
    assert page.min() < 50


def test_a_map_has_one_scale_in_all_directions(draw):
    ax = draw(places_in_space((0.1, 0.2, 0.7)), GEOMETRY)
    ratio = ax._box_aspect / np.diff(np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()]))[:, 0]
    np.testing.assert_allclose(ratio, ratio[0])


def test_places_without_direction_have_the_marker_of_their_kind(draw):
    ax = draw(places_in_space((0.1, 0.9)))
    assert labels_of(ax) == ["pendulum"]
    assert [len(each.get_offsets()) for each in ax.collections] == [1, 1]
    # Those without coordinates are left out.
    ax = draw([*places_in_space((0.3, 0.3)), *loose([0.4])])
    assert title_of(ax).startswith("Most probable: pendulum p")
    assert len(ax.collections) == 2


def test_hundreds_of_equal_places_are_one_picture(draw):
    ax = draw(places_in_space(np.full(MOST_VECTORS + 2, 1e-3), (X, Z)))
    assert len(ax.collections) == MOST_VECTORS + 2
    assert all(each.get_rasterized() for each in ax.collections)


def test_a_map_says_of_what_the_probability_is():
    search = search_of(places_in_space((0.3, 0.6)), GEOMETRY)
    search.a_feature = "a change"
    with figures_for_files():
        figure = plot_places(search).figure
    assert "probability of a change" in {each.get_xlabel() for each in figure.axes}


def test_without_coordinates_the_most_probable_places_are_bars(draw):
    ax = draw(loose(np.array([0.5, 0.2, *np.full(30, 0.01)])[::-1]))
    lengths = [bar.get_width() for bar in ax.patches]
    assert lengths[:3] == [0.5, 0.2, 0.01]
    assert len(lengths) == MOST_BARS + 1
    assert lengths[-1] == pytest.approx(0.01 * (32 - MOST_BARS))
    assert ax.get_yticklabels()[-1].get_text() == f"{32 - MOST_BARS} others together"
    assert ax.get_xlabel() == "probability of an appendage"
    ax = draw(loose([0.999, 0.001]))  # no tick of a probability is above one
    assert max(ax.get_xticks()) == pytest.approx(1.0)
    assert ax.get_xlim() == (0.0, pytest.approx(1.25 * 0.999))
