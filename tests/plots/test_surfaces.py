"""Surfaces of decks and modes in space: what is outside, where it bends, and how it is drawn."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.plots import space
from bayes_ssi.plots.figure_style import figures_for_files
from bayes_ssi.plots.ranking_plots import figures_of_modes
from bayes_ssi.plots.space import (
    draw_faces,
    draw_structure,
    outline,
    panels_in_space,
    plot_modes_in_space,
)
from bayes_ssi.results.predictions.nodal_modes import nodal_modes
from bayes_ssi.structures.solver_files.abaqus_and_calculix import geometry_of_deck


@pytest.fixture
def cube(tmp_path):
    """Eight bricks, of which each has three of its six faces outside."""
    at = np.array([(x, y, z) for z in range(3) for y in range(3) for x in range(3)], dtype=float)
    lines = ["*NODE", *(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(at, 1))]
    lines.append("*ELEMENT, TYPE=C3D8R")
    corners = [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 1),
        (1, 1, 1),
        (0, 1, 1),
    ]
    for element, first in enumerate(at[(at < 2).all(axis=1)], 1):
        nodes = [int(1 + (first + corner) @ (1, 3, 9)) for corner in corners]
        lines.append(", ".join(map(str, [element, *nodes])))
    (tmp_path / "cube.inp").write_text("\n".join([*lines, ""]))
    return geometry_of_deck(tmp_path / "cube.inp")


def numbered(geometry):
    number = {node: i for i, node in enumerate(geometry.nodes)}
    points = np.array(list(geometry.nodes.values()))
    return points, [[number[corner] for corner in face] for face in geometry.faces]


def test_a_mesh_has_the_faces_and_edges_of_the_cube_that_it_is(cube):
    assert len(cube.faces) == 6 * 4
    assert "14" not in {corner for face in cube.faces for corner in face}  # the node in the middle
    points, faces = numbered(cube)
    edges = points[outline(points, faces)]
    assert len(edges) == 12 * 2
    # On an edge of the cube, two coordinates are those of its sides.
    on_sides = np.isin(edges, (0.0, 2.0)).all(axis=1).sum(axis=1)
    np.testing.assert_array_equal(on_sides, 2)


@pytest.mark.parametrize(
    ("kind", "nodes", "n_faces"),
    [("C3D4", 4, 4), ("C3D10", 10, 4), ("C3D6", 6, 5), ("C3D15", 15, 5), ("C3D8I", 8, 6),
     ("C3D20R", 20, 6), ("S3", 3, 1), ("S8R", 8, 1), ("M3D4", 4, 1), ("S4R", 4, 1)],
)  # fmt: skip
def test_elements_are_closed_by_their_faces(tmp_path, kind, nodes, n_faces):
    """Two faces of a solid meet at each of its sides, in opposite directions; a shell has one."""
    names = [str(i) for i in range(1, nodes + 1)]
    text = ", ".join(["7", *names])
    if len(names) > 15:  # elements of many nodes take two lines
        text = ", ".join(["7", *names[:15]]) + ",\n" + ", ".join(names[15:])
    lines = [*(f"{i}, {i}" for i in names), f"*ELEMENT, TYPE={kind}", text, ""]
    (tmp_path / "one.inp").write_text("*NODE\n" + "\n".join(lines))
    faces = geometry_of_deck(tmp_path / "one.inp").faces
    assert len(faces) == n_faces
    sides = Counter(side for face in faces for side in zip(face, (*face[1:], face[0]), strict=True))
    assert max(sides.values()) == 1
    if n_faces > 1:
        assert {(b, a) for a, b in sides} == set(sides)


def test_flat_shells_have_lines_at_their_border_only():
    points = np.array([(x, y, 0.0) for y in range(3) for x in range(3)])
    faces = [[0, 1, 4, 3], [1, 4, 5, 2], [3, 4, 7, 6], [4, 5, 8, 7]]  # the second is turned over
    assert len(outline(points, faces)) == 8
    folded = points.copy()
    folded[[2, 5, 8], 2] = 1.0  # by 45°
    assert len(outline(folded, faces)) == 10


def test_modes_are_drawn_where_nodes_are(cube, monkeypatch):
    """Faces are moved by the shape, the largest displacement by a fixed share of the size."""
    labels = [f"{node} x" for node in cube.nodes]
    stiffness = np.diag(np.arange(1.0, 28.0))
    structure = bs.MatrixStructure(
        stiffness, np.eye(27), labels=labels, sensors=["27 x"], n_modes=2, geometry=cube
    )
    modes = nodal_modes(structure, np.empty(0))
    drawn = []

    def draw(ax, points, faces, alpha, colours):
        drawn.append(points)
        draw_faces(ax, points, faces, alpha, colours)

    monkeypatch.setattr(space, "draw_faces", draw)
    with figures_for_files():
        figure = plot_modes_in_space(modes, {"first": 1, "second": 2})
        figure.draw_without_rendering()
    assert [(ax.get_title(loc="left") or ax.get_title()).split("\n")[0] for ax in figure.axes] == [
        "mode first", "mode second",
    ]  # fmt: skip
    at_rest = np.array(list(cube.nodes.values()))
    for node, points in enumerate(drawn):  # mode by mode, one node moves alone
        moved = points - at_rest
        assert abs(moved[node, 0]) == pytest.approx(0.12 * 2.0)
        assert np.count_nonzero(abs(moved) > 1e-9) == 1
    with pytest.raises(ValueError, match="needs a mode, and coordinates"):
        plot_modes_in_space(modes, {})


def test_a_result_has_a_figure_of_its_modes_where_coordinates_are_known(cube):
    labels = [f"{node} x" for node in cube.nodes]
    data = bs.ModalData((bs.IdentifiedMode("a", 0.2),), (0.0, 0.25))
    posterior = SimpleNamespace(
        configurations=[SimpleNamespace(pairing={"a": 2})],
        parameter_names=(),
        maxima=np.empty((1, 0)),
    )
    names = []
    for geometry in (cube, None):
        structure = bs.MatrixStructure(
            np.diag(np.arange(1.0, 28.0)), np.eye(27), labels=labels, sensors=["27 x"], n_modes=2,
            geometry=geometry,
        )  # fmt: skip
        candidate = bs.ModelClass("a", structure, data, pairing={"a": 2})
        names.append([name for name, _ in figures_of_modes(candidate, posterior)])
    assert names == [["modes"], []]


def test_places_are_drawn_on_the_faces_of_a_structure(cube):
    with figures_for_files():
        _, (ax,) = panels_in_space(["cube"], np.array(list(cube.nodes.values())), 0.1)
        draw_structure(ax, cube)
        ax.figure.draw_without_rendering()
    faces, lines = ax.collections
    assert faces.get_alpha() < 0.2
    assert len(lines._segments3d) == 24
