"""Mode shapes that move: scenes, surfaces of decks, and what the script of a page draws."""

import json
import re
import shutil
import subprocess
from collections import Counter
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from html_page import Page

import bayes_ssi as bs
from bayes_ssi.inference.posterior.model_at_draws import configuration_modes
from bayes_ssi.plots import moving_shapes, plot_moving_shapes
from bayes_ssi.plots.figure_style import figures_for_files
from bayes_ssi.structures.geometry import Geometry, stick
from bayes_ssi.structures.solver_files.abaqus_and_calculix import geometry_of_deck


def scene_of(structure, modes, pairing, sensors=(), at_draws=lambda: None):
    """The scene of a class; ``at_draws`` is called once its modes at draws are known."""
    data = bs.ModalData(tuple(modes), (0.0, 100.0), tuple(sensors))
    candidate = bs.ModelClass("a", structure, data, pairing=pairing)
    values = candidate.values(np.zeros((3, len(candidate.parameter_names))))
    posterior = SimpleNamespace(
        configurations=configuration_modes(candidate, values),
        parameter_names=candidate.parameter_names,
        maxima=values[:1],
    )
    at_draws()
    (scene,) = moving_shapes.class_scenes(candidate, posterior)
    return scene


def test_floors_of_a_building_move_as_plates(tiny_ranking):
    """Two equal storeys: the lower floor moves by the golden ratio of the upper, or against it."""
    shapes = plot_moving_shapes(tiny_ranking)
    assert list(shapes.scenes) == [row.name for row in tiny_ranking.comparison.classes]
    ((scene,), *_) = shapes.scenes.values()
    assert len(scene["nodes"]) == 3 * 4
    assert [sensor["name"] for sensor in scene["sensors"]] == ["floor 1", "floor 2"]
    best = tiny_ranking.posterior(next(iter(shapes.scenes)))
    for mode, updated in zip(scene["modes"], best.configurations[0].updated.modes, strict=True):
        moves = np.array(mode["moves"])
        assert not moves[:, 1:].any()
        assert np.abs(moves).max() == pytest.approx(1.0)
        plates = moves[:, 0].reshape(3, 4)
        assert np.ptp(plates, axis=1).max() == 0.0
        assert not plates[0].any()
        np.testing.assert_allclose(mode["model"], plates[1:, 0], atol=1e-4)
        np.testing.assert_allclose(mode["measured"], mode["model"], atol=0.05)
        assert mode["note"].endswith(f"MAC {updated.mac_after[1]:.4f}")
        assert f"model {updated.after_hz[1]:.4g} Hz" in mode["note"]
    first = np.array(scene["modes"][0]["model"])
    assert abs(first[0] / first[1]) == pytest.approx((np.sqrt(5.0) - 1.0) / 2.0, abs=0.05)


def test_a_mode_that_a_class_does_not_explain_is_measured_motion_alone():
    building = bs.ShearBuilding((1.0, 1.0), (40.0, 40.0))
    modes = (bs.IdentifiedMode("1", 0.6, [1.0, 2.0]), bs.IdentifiedMode("x", 1.1, [-2.0, 1.0]))
    alone = scene_of(building, modes, {"1": 1}, building.degrees_of_freedom)["modes"][1]
    assert alone["model"] is None
    assert not np.any(alone["moves"])
    assert alone["measured"] == [-1.0, 0.5]
    assert "not explained by this model class" in alone["note"]


def test_intervals_of_measured_motion_are_in_the_scale_of_the_model():
    """Of a unit shape (0.6, 0.8) with sd 0.01, drawn with the largest component 1: 1.645/80."""
    building = bs.ShearBuilding((1.0, 1.0), (40.0, 40.0))
    modes = [bs.IdentifiedMode("x", 1.0, [0.6, 0.8], shape_sd=0.01), bs.IdentifiedMode("y", 1.1)]
    scene = scene_of(building, modes, {}, building.degrees_of_freedom)
    assert scene["modes"][0]["half"] == pytest.approx([0.01 * 1.645 / 0.8] * 2, abs=1e-4)
    assert scene["modes"][1]["half"] == [None, None]


def test_an_appendage_that_moves_far_is_drawn_three_times_as_far_as_the_rest():
    mast = bs.Pendulum(on=1, mass=0.001, frequency=1.0, label="mast")
    frame = bs.ShearBuilding((1.0,), (40.0,)).with_element(mast)
    scene = scene_of(frame, [bs.IdentifiedMode("1", 1.0)], {"1": 2})
    lengths = np.linalg.norm(scene["modes"][0]["moves"], axis=1)
    assert lengths.max() == pytest.approx(3.0, abs=1e-3)
    assert 0.0 < lengths[4:8].max() < 1.0


def test_a_floor_that_turns_moves_its_corners_at_right_angles_to_their_radii():
    """And a sensor is drawn on its line of measurement: y = 1.5 for one at (2, 1.5) along x."""
    building = bs.ShearBuilding3D(
        (1.0,), (1.0,), (900.0,), (900.0,), (100.0,),
        sensors=[bs.floor_sensor("NE x", 1, (2.0, 1.5), "x"),
                 bs.floor_sensor("NE y", 1, (2.0, 1.5), "y")],
    )  # fmt: skip
    location = building.sensor_location("NE x")
    assert location.position == pytest.approx((0.0, 1.5, 1.5 * np.sqrt(1.5)))
    assert location.direction == pytest.approx((1.0, 0.0, 0.0))
    modes = [bs.IdentifiedMode("t", 1.6, [-1.5, 2.0])]
    scene = scene_of(building, modes, {"t": 1}, ["NE x", "NE y"])
    nodes, moves = np.array(scene["nodes"])[4:], np.array(scene["modes"][0]["moves"])[4:]
    np.testing.assert_allclose((nodes * moves)[:, :2].sum(axis=1), 0.0, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(moves, axis=1), 1.0, atol=1e-4)
    np.testing.assert_allclose(scene["modes"][0]["model"], scene["modes"][0]["measured"], atol=1e-3)
    assert scene["modes"][0]["note"].endswith("MAC 1.0000")


def test_a_space_frame_has_its_own_dimensions():
    lines = (-4.0, 0.0, 4.0), (-3.0, 3.0)
    geometry, _ = bs.SpaceFrame((2.0, 3.0), *lines, 1.0, *[(1.0,) * 2] * 6).drawing()
    nodes = np.array(list(geometry.nodes.values()))
    np.testing.assert_array_equal(np.ptp(nodes, axis=0), [8.0, 6.0, 5.0])
    assert set(nodes[:, 2]) == {0.0, 2.0, 5.0}


def in_a_row(n):
    nodes = {f"n{i}": (float(i), 0.0, 0.0) for i in range(n)}
    return Geometry(nodes, tuple((f"n{i}", f"n{i + 1}") for i in range(n - 1)))


def test_nodes_with_coordinates_move_along_their_axes():
    structure = bs.MatrixStructure(
        np.diag([400.0, 100.0]), np.eye(2), labels=["n1 z", "n2 y"], sensors=["n2 y", "n1 z"],
        n_modes=2, geometry=in_a_row(3),
    )  # fmt: skip
    scene = scene_of(structure, [bs.IdentifiedMode("1", 1.6, [2.0, 0.0])], {"1": 1},
                     ["n2 y", "n1 z"])  # fmt: skip
    np.testing.assert_array_equal(scene["nodes"], [[-1, 0, 0], [0, 0, 0], [1, 0, 0]])
    assert scene["lines"] == [[0, 1], [1, 2]]
    (mode,) = scene["modes"]
    assert np.abs(mode["moves"]).tolist() == [[0, 0, 0], [0, 0, 0], [0, 1, 0]]
    assert [sensor["at"] for sensor in scene["sensors"]] == [[1, 0, 0], [0, 0, 0]]
    assert mode["measured"] == mode["model"]


def test_of_many_nodes_some_are_left_out():
    n = moving_shapes.MOST_NODES + 500
    structure = bs.MatrixStructure(
        np.diag([1.0, 2.0]), np.eye(2), labels=["n0 z", "n9 z"], sensors=["n0 z"], n_modes=1,
        geometry=in_a_row(n),
    )  # fmt: skip
    scene = scene_of(structure, [bs.IdentifiedMode("1", 0.16)], {"1": 1})
    assert len(scene["nodes"]) == len(scene["modes"][0]["moves"]) == moving_shapes.MOST_NODES
    assert np.max(scene["lines"]) < moving_shapes.MOST_NODES


def test_what_has_no_coordinates_stands_one_above_the_other():
    geometry, moving = stick(["roof x", "roof y", "tip", "roof torsion", "hall rx"])
    assert geometry.nodes == {"": (0, 0, 0), "roof": (0, 0, 1), "tip": (0, 0, 2), "hall": (0, 0, 3)}
    assert moving["roof"] == ((("roof x", 1.0),), (("roof y", 1.0),), ())
    assert moving["tip"] == ((("tip", 1.0),), (), ())
    assert moving["hall"] == ((), (), ())


def test_a_function_is_not_called_again():
    """One solution of a black box may take minutes."""
    calls = []

    def modes(k):
        calls.append(k)
        return np.array([1.0, 2.0]), np.array([[1.0, 1.0], [2.0, -0.5]])

    k = bs.Parameter("k", bs.LogNormal(1.0, 0.1))
    structure = bs.FunctionStructure(modes, {"k": k}, n_modes=2, sensors=("a", "b"))
    given = [bs.IdentifiedMode("1", 1.0, [1.0, 2.0])], {"1": 1}, ("a", "b")
    scene = scene_of(structure, *given, at_draws=calls.clear)
    assert not calls
    np.testing.assert_allclose(np.abs(scene["modes"][0]["model"]), [0.5, 1.0])


@pytest.fixture(scope="module")
def page(tiny_ranking):
    return plot_moving_shapes(tiny_ranking).page()


def test_the_page_is_well_formed_small_and_needs_no_network(page):
    assert Page(page).addresses == []
    assert not re.findall(r"https?:|@import|url\(", page)
    assert len(moving_shapes.asset("js").encode()) < 150e3
    records = re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)
    assert len(records) == 2
    assert all(json.loads(record)[0]["modes"] for record in records)


def test_names_do_not_end_the_script():
    data = bs.ModalData((bs.IdentifiedMode("</script>", 1.0, [1.0]),), (0.0, 2.0), ("<s>",), "<b>")
    assert "<b>" in Page(plot_moving_shapes(data).page()).text
    assert "MovingShapes" in repr(plot_moving_shapes(data))


def test_identified_modes_alone(tmp_path):
    modes = (bs.IdentifiedMode("1", 1.0, [3.0, np.nan]), bs.IdentifiedMode("2", 1.5))
    shapes = plot_moving_shapes(bs.ModalData(modes, (0.0, 2.0), ("roof y", "hall y")))
    ((scene,),) = shapes.scenes.values()
    (mode,) = scene["modes"]  # the other has no shape
    assert mode["measured"] == [1.0, None]
    assert mode["moves"] == [[0.0] * 3, [0.0, 1.0, 0.0], [0.0] * 3]
    shapes.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text("utf-8") == shapes.page()


def test_a_result_keeps_its_scenes(tiny_ranking, tmp_path):
    stored = bs.save_result(
        tiny_ranking, tmp_path / "r", figures=partial(moving_shapes.save_scenes, tiny_ranking)
    )
    expected = plot_moving_shapes(tiny_ranking).page()
    for result in (stored, tmp_path / "r", str(tmp_path / "r"), bs.load_result(tmp_path / "r")):
        assert plot_moving_shapes(result).page() == expected
    assert "srcdoc" in plot_moving_shapes(stored)._repr_html_()
    plain = bs.save_result(tiny_ranking, tmp_path / "plain")
    with pytest.raises(ValueError, match="saved without figures"):
        plot_moving_shapes(plain)


# What the script needs of a browser, and what it draws there.
BROWSER = """
const drawn = [], later = [], on = {};
const pen = new Proxy({}, {
  get: (own, name) => own[name] ?? ((...given) => drawn.push([name, ...given])),
  set: (own, name, value) => { own[name] = value; return true; },
});
const made = (kind) => ({
  kind, children: [], style: {}, given: {}, on: {}, clientWidth: 400, clientHeight: 300,
  appendChild(child) { this.children.push(child); },
  set textContent(text) { this.text = text; if (!text) { this.children = []; } },
  get textContent() { return this.text; },
  setAttribute(name, value) { this.given[name] = value; },
  addEventListener(kind, act) { this.on[kind] = act; },
  getContext: () => pen, setPointerCapture() {},
});
const box = made("div");
box.querySelector = () => ({ textContent: SCENES });
const document = { createElement: made, querySelectorAll: () => [box] };
const window = {
  devicePixelRatio: 1, matchMedia: () => ({ matches: CALM, addEventListener() {} }),
  addEventListener(kind, act) { on[kind] = act; },
};
const getComputedStyle = () => ({ getPropertyValue: () => "#000000" });
const requestAnimationFrame = (act) => later.push(act);
"""
# The filled dots of a picture, which are the model at its sensors.
FRAMES = """
const dots = () => drawn.splice(0).filter((call) => call[0] === "arc" && call[3] === 3.5);
const canvas = box.children.find((each) => each.kind === "canvas");
const frames = [dots()];
for (const time of [0, 900]) { if (later.length) { later.pop()(time); frames.push(dots()); } }
for (const key of ["ArrowLeft", "Home"]) {
  canvas.on.keydown({ key, preventDefault() {} });
  frames.push(dots());
}
canvas.on.keydown({ key: " ", preventDefault() {} });
const [first] = box.children;
first.children[0].children[1].on.click();
const stills = box.children.find((each) => each.className === "stills");
on.beforeprint();
console.log(JSON.stringify({
  frames, playing: later.length, note: box.children.find((each) => each.className === "note").text,
  stills: stills.children.map((each) => each.children[1].text),
}));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
@pytest.mark.parametrize("calm", [False, True])
def test_the_script_moves_and_turns_shapes_and_prints_them_still(calm):
    """One sensor at the top of a column of half height 1, moving along x by 1."""
    mode = {"title": "mode 1", "note": "1 Hz", "moves": [[0, 0, 0], [1, 0, 0]], "model": [1],
            "measured": [None], "half": [None]}  # fmt: skip
    scene = {
        "name": "", "nodes": [[0, 0, -1], [0, 0, 1]], "lines": [[0, 1]], "faces": [],
        "sensors": [{"name": "top", "at": [0, 0, 1], "along": [1, 0, 0]}],
        "modes": [mode, {**mode, "title": "mode 2", "note": "2 Hz"}],
    }  # fmt: skip
    head = f"const SCENES = {json.dumps(json.dumps([scene]))}, CALM = {json.dumps(calm)};"
    done = subprocess.run(
        ["node", "-e", head + BROWSER + moving_shapes.asset("js") + FRAMES],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    shown = json.loads(done.stdout)
    still, *moving = [np.array(frame[-1][1:3]) for frame in shown["frames"] if frame]
    # Turned by 0.5 and tilted by 0.35, a displacement of 0.28 along x is seen from there.
    half = 0.28, np.cos(0.35) + 0.14
    scale = min(400 / half[0], 300 / half[1]) / 2.1
    right, away = 0.28 * np.cos(0.5), -0.28 * np.sin(0.5)
    expected = np.array([200 + scale * right, 150 - scale * (np.cos(0.35) + away * np.sin(0.35))])
    np.testing.assert_allclose(still, expected, atol=0.01)
    if calm:
        assert shown["playing"] == 1  # since the space bar was pressed
        turned, back = moving
    else:
        whole, opposite, turned, back = moving
        np.testing.assert_allclose(whole, expected, atol=0.01)
        # Half a period later the displacement is opposite.
        mirrored = [200 - scale * right, 150 - scale * (np.cos(0.35) - away * np.sin(0.35))]
        np.testing.assert_allclose(opposite, mirrored, atol=0.01)
    assert np.linalg.norm(turned - back) > 1.0
    assert shown["note"] == "mode 2: 2 Hz"
    assert shown["stills"] == ["mode 1: 1 Hz", "mode 2: 2 Hz"]


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
    points, (_, faces) = np.array(list(cube.nodes.values())), moving_shapes.numbered(cube)
    edges = points[moving_shapes.outline(points, faces)]
    assert len(edges) == 12 * 2
    # On an edge of the cube, two coordinates are those of its sides.
    np.testing.assert_array_equal(np.isin(edges, (0.0, 2.0)).all(axis=1).sum(axis=1), 2)


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
    assert len(moving_shapes.outline(points, faces)) == 8
    folded = points.copy()
    folded[[2, 5, 8], 2] = 1.0  # by 45°
    assert len(moving_shapes.outline(folded, faces)) == 10


def test_places_are_drawn_on_the_faces_of_a_structure(cube):
    with figures_for_files():
        ax = moving_shapes.axes_in_space("cube", np.array(list(cube.nodes.values())), 0.1, cube)
        ax.figure.draw_without_rendering()
    faces, lines = ax.collections
    assert faces.get_alpha() < 0.2
    assert len(lines._segments3d) == 24
