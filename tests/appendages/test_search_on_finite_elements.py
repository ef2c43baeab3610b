"""``bayes-ssi search`` on the footbridge with coordinates of its nodes."""

import json

import pytest
from code_blocks import ROOT

from bayes_ssi.plots.figure_style import figures_for_files
from bayes_ssi.plots.place_plots import plot_places
from bayes_ssi.results.stored_result import load_result

STUDY = ROOT / "model_classes" / "finite_elements" / "footbridge.py"
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
    result = run("search", STUDY, "--candidates", candidates, "--most", 1, "--error", 0.5,
                 "--accept-failed-checks", "--out", out, "--verbose")  # fmt: skip
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
    stored = json.loads((out / "search.json").read_text(encoding="utf-8"))
    assert stored["geometry"]["unit"] == "m"
    with figures_for_files():
        ax = plot_places(record)
    title = ax.figure.get_suptitle()
    assert title.startswith(f"Most probable: {TRUE_PLACE}, ")
    assert title.endswith(" (m)")  # behind the spans of x, y and z
