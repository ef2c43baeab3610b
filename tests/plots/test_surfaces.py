"""Surfaces of decks in space: what is outside, where it bends, and how it is drawn."""

from collections import Counter

import numpy as np
import pytest

from bayes_ssi.plots.figure_style import figures_for_files
from bayes_ssi.plots.moving_shapes import axes_in_space, numbered, outline
from bayes_ssi.structures.solver_files.abaqus_and_calculix import geometry_of_deck


@pytest.fixture
def cube(tmp_path):
    """Eight bricks, of which each has three of its six faces outside."""
    at = np.array([(x, y, z) for z in range(3) for y in range(3) for x in range(3)], dtype=float)
    lines = ["*NODE", *(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(at, 1))]
    lines.append("*ELEMENT, TYPE=C3D8R")
    corners = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    for element, first in enumerate(at[(at < 2).all(axis=1)], 1):
        nodes = [int(1 + (first + corner) @ (1, 3, 9)) for corner in corners]
        lines.append(", ".join(map(str, [element, *nodes])))
    (tmp_path / "cube.inp").write_text("\n".join([*lines, ""]))
    return geometry_of_deck(tmp_path / "cube.inp")


def test_a_mesh_has_the_faces_and_edges_of_the_cube_that_it_is(cube):
    assert len(cube.faces) == 6 * 4
    assert "14" not in {corner for face in cube.faces for corner in face}  # the node in the middle
    points, (_, faces) = np.array(list(cube.nodes.values())), numbered(cube)
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
    text = ", ".join(["7", *names]).replace("15, 16", "15,\n16")  # many nodes take two lines
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


def test_places_are_drawn_on_the_faces_of_a_structure(cube):
    with figures_for_files():
        ax = axes_in_space("cube", np.array(list(cube.nodes.values())), 0.1, cube)
        ax.figure.draw_without_rendering()
    faces, lines = ax.collections
    assert faces.get_alpha() < 0.2
    assert len(lines._segments3d) == 24
