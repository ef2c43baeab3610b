"""How objects show themselves, and the README's study as a notebook."""

import re
import shutil
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import bayes_ssi as bs
from bayes_ssi.foundations.displayed import Displayed

STUDIES = Path(__file__).parents[1] / "model_classes"


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """The outputs of every cell of code: MIME type → text."""
    folder = tmp_path_factory.mktemp("notebook")
    shutil.copy(STUDIES / "shear_building.py", folder)
    shutil.copytree(STUDIES / "data", folder / "data")
    notebook = nbformat.read(STUDIES / "shear_building.ipynb", as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": folder}}).execute()
    return {
        cell.source: [output.get("data", {"text/plain": output.get("text")})
                      for output in cell.outputs]
        for cell in notebook.cells if cell.cell_type == "code"
    }  # fmt: skip


def of_cell(executed, begin):
    (outputs,) = (value for source, value in executed.items() if source.startswith(begin))
    return outputs


def test_tables_in_a_notebook(executed):
    (study,) = of_cell(executed, "import bayes_ssi")
    assert study["text/plain"] == (
        "<Study 'Shear building with a resonant infill': 4 model classes>"
    )
    assert study["text/html"].count("<tr>") == 4
    (data,) = of_cell(executed, "study.model_classes[0]")
    assert "<td>2b</td>" in data["text/html"]


def test_progress_and_a_ranking_in_a_notebook(executed):
    progress, ranking = of_cell(executed, "ranking = bs.rank")
    # Last, whether an appendage on the most probable class explains the data as well.
    assert sorted(progress["text/plain"].splitlines()) == [
        *(f"{name}: evidence 100 %" for name in ("1-a", "1-b", "2", "3")),
        "all hypotheses: screening 3 100 %",
    ]
    assert ranking["text/html"].index("<td>3</td>") < ranking["text/html"].index("<td>1-a</td>")


def test_words_pictures_and_frames_in_a_notebook(executed):
    (words,) = of_cell(executed, "print(ranking.summary())")
    assert words["text/plain"].startswith("The most probable of the 4 model classes is: infill")
    for begin in ("%matplotlib inline", "bs.plots.plot_corner"):
        assert "image/png" in of_cell(executed, begin)[-1]
    (frame,) = of_cell(executed, "print(ranking.to_frame")
    (summary,) = of_cell(executed, "import arviz")
    assert re.findall(r"<th>(k1|k2|k3|ks)</th>", summary["text/html"]) == ["k1", "k2", "k3", "ks"]
    assert "image/png" in of_cell(executed, "az.plot_trace")[-1]
    compared = of_cell(executed, "table = az.compare")[-1]["text/html"]
    assert compared.index("<th>log_evidence</th>") < compared.index("<th>3</th>")
    assert re.search(r"<th>3</th>.*?<td>16\.\d+</td>\s*</tr>", compared, re.S)
    assert re.match(r"name,log_evidence,probability\n3,16\.\d+,0\.99999", frame["text/plain"])


def test_a_line_and_a_table(tiny_ranking):
    ranking = tiny_ranking
    study = ranking.study
    shown = [study, ranking, ranking.comparison, *ranking.posteriors, *study.model_classes]
    shown += [study.model_classes[0].configurations[0].data]
    shown += [bs.Record(np.eye(2, 40), 10.0, ("a", "b"), "acceleration", "m/s2")]
    for one in shown:
        assert isinstance(one, Displayed)
        assert repr(one).startswith(f"<{type(one).__name__} ")
        assert len(repr(one)) < 160
        assert len(str(one).splitlines()) == 2 + len(one.to_frame())


def test_a_prior_is_shown_by_its_quantiles(tiny_ranking):
    posterior = tiny_ranking.posteriors[0]
    for candidate in tiny_ranking.study.model_classes:
        if candidate.name == posterior.name:
            medians = [p.prior.quantile(0.5) for p in candidate.parameters]
    np.testing.assert_allclose(posterior.prior_quantiles[:, 1], medians, rtol=1e-12)


def test_public_names_are_all_that_is_completed():
    names = dir(bs)
    assert [name for name in names if name.startswith("_")] == ["__version__"]
    assert set(names) == {*bs.__all__, "__version__", "plots"}
    assert re.match(r"\d+\.\d+", bs.__version__)
