"""The studies with finite-element programs against beams computed otherwise, and a search."""

import json
import math
import runpy

import numpy as np
import pytest
from code_blocks import ROOT

import bayes_ssi as bs
from bayes_ssi.plots.figure_style import figures_for_files
from bayes_ssi.plots.place_plots import plot_places
from bayes_ssi.results.stored_result import load_result

STUDIES = ROOT / "model_classes" / "finite_elements"


def study(name, package, extra):
    """The study, where the program that it needs is there."""
    reason = f'needs {package}: pip install "bayes_ssi[{extra}]"'
    try:
        __import__(package)
    except Exception as error:  # noqa: BLE001 - openseespy raises what it likes
        pytest.skip(f"{reason} ({type(error).__name__}: {error})")
    return bs.load_study(STUDIES / name)


def test_beam_by_scikit_fem():
    plain, at_tip, anywhere = study("beam_on_a_support.py", "skfem", "fem").model_classes
    # β_1 L = 1.875104, β_2 L = 4.694091: f = (βL)²/(2π) √(EI/(ρAL⁴)).
    root = math.sqrt(210e9 * 0.012**2 / 12.0 / (7850.0 * 3.0**4)) / (2.0 * math.pi)
    expected = np.array([1.8751041, 4.6940911, 7.8547574]) ** 2 * root
    bare = plain.structure.modes(np.ones((1, 1))).frequencies_hz[0, :3]
    np.testing.assert_allclose(bare, expected, rtol=1e-3)
    # A support so stiff that the tip is held: tan βL = tanh βL.
    held = at_tip.structure.modes(np.array([[1e9]])).frequencies_hz[0, :2]
    np.testing.assert_allclose(held, np.array([3.9266023, 7.0685828]) ** 2 * root, rtol=1e-3)
    # At the tip, both structures are the same.
    same = anywhere.structure.modes(np.array([[2e4, 3.0]])).frequencies_hz
    np.testing.assert_allclose(same, at_tip.structure.modes(np.array([[2e4]])).frequencies_hz)
    with pytest.raises(ValueError, match="at support = 1, place = 4: the support at 4 m is not on"):
        anywhere.structure.modes(np.array([[1.0, 4.0]]))


@pytest.mark.parametrize("end", [(3.0, 0.0, 0.0), (0.0, 0.0, 3.0), (1.0, -2.0, 2.0)])
def test_beams_of_the_footbridge_bend_as_cantilevers_do(end):
    """At the tip: F L / (E A) along it, F L³ / (3 E I) across; a rigid motion needs no force."""
    bridge = runpy.run_path(str(STUDIES / "footbridge.py"))
    section = area, inertia, same, _ = (2e-3, 3e-6, 3e-6, 4.8e-6)
    assert inertia == same
    stiffness, mass = bridge["beam"](section, [(0.0, 0.0, 0.0), end])
    assert mass == pytest.approx(7850.0 * 2e-3 * 3.0)
    along = np.array(end) / 3.0
    flexibility = np.linalg.inv(stiffness[6:, 6:])[:3, :3]
    expected = 3.0 / (210e9 * area) * np.outer(along, along)
    expected += 27.0 / (3.0 * 210e9 * inertia) * (np.eye(3) - np.outer(along, along))
    np.testing.assert_allclose(flexibility, expected, atol=1e-9 * expected.max())
    for axis in np.eye(3):
        turned = np.concatenate([np.zeros(3), axis, np.cross(axis, end), axis])
        np.testing.assert_allclose(stiffness @ turned, 0.0, atol=1e-9 * stiffness.max())


def test_the_data_of_the_footbridge_are_what_the_script_makes(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["make", str(tmp_path)])
    runpy.run_path(str(ROOT / "runs" / "make_footbridge.py"), run_name="__main__")
    assert "pipe: 607.7 kg at 2.2648 Hz" in capsys.readouterr().out
    data = ROOT / "model_classes" / "data"
    made, kept = (bs.read_modal_data(at / "footbridge.csv") for at in (tmp_path, data))
    np.testing.assert_allclose(made.frequencies_hz, kept.frequencies_hz, atol=1.01e-4)
    np.testing.assert_allclose(made.unit_shapes, kept.unit_shapes, atol=2e-4)
    name = "footbridge_candidates.csv"
    assert bs.read_candidates(tmp_path / name) == bs.read_candidates(data / name)


TRUE_PLACE, TRUE_MASS, TRUE_HZ = "pendulum bottom left 8 z", 607.7, 2.2648


@pytest.mark.usefixtures("coarse_command", "no_motions")
def test_the_pipe_on_the_footbridge(run, tmp_path, monkeypatch):
    """At one of three places that the sensors can tell apart."""
    # Mistakes in the data are sought elsewhere.
    monkeypatch.setattr("bayes_ssi.studies.ranking.checks.with_hints", lambda _, found, *__: found)
    candidates, out = tmp_path / "places.csv", tmp_path / "r"
    places = ("bottom left 8 z", "bottom right 4 z", "top right 4 y")
    rows = "".join(f"{place},{place}\n" for place in places)
    candidates.write_text(f"name,place\n{rows}", encoding="utf-8")
    result = run("search", STUDIES / "footbridge.py", "--candidates", candidates, "--most", 1,
                 "--error", 0.5, "--accept-failed-checks", "--out", out, "--verbose")  # fmt: skip
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "Appendages by place, averaged over all hypotheses" in text
    assert "Priors of masses are relative to the median modal mass, 2.062e+04 kg." in text
    record = load_result(out).search
    true, second, _ = record.places_by_probability
    assert true.place.name == TRUE_PLACE
    assert true.is_observed
    assert second.probability < 1e-3 < 0.99 < true.probability
    assert true.place.coordinates == (20.0, 0.0, 0.0)
    assert true.place.direction == (0.0, 0.0, 1.0)
    low, _, high = true.amounts["mass"]
    assert low < TRUE_MASS < high
    low, _, high = true.amounts["frequency_hz"]
    assert low < TRUE_HZ < high
    assert len(record.geometry.nodes) == 52
    assert json.loads((out / "search.json").read_text(encoding="utf-8"))["geometry"]["unit"] == "m"
    with figures_for_files():
        ax = plot_places(record)
    title = ax.figure.get_suptitle()
    assert title.startswith(f"Most probable: {TRUE_PLACE}, ")
    assert title.endswith(" (m)")  # behind the spans of x, y and z
