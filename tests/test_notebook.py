"""How objects show themselves, and the notebook, from two records to what changed."""

import re
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import bayes_ssi as bs
from bayes_ssi.foundations.displayed import Displayed

NOTEBOOK = Path(__file__).parents[1] / "model_classes" / "hidden_tank.ipynb"
# As conftest's screen_quickly does in this process; and sampling is coarse.
QUICKLY = """
from functools import partial
import bayes_ssi as bs
from bayes_ssi.studies import questions
from bayes_ssi.studies.search import family_search
family_search.screened_hypotheses = partial(family_search.screened_hypotheses, most_full=0)
coarse = bs.SamplingSettings(0.1, searches=1, effective_sample_size=400)
bs.SamplingSettings = questions.SamplingSettings = lambda **_: coarse
"""


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """The outputs of every cell of code: MIME type → text."""
    folder = tmp_path_factory.mktemp("notebook") / "model_classes"
    folder.mkdir()
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert len(notebook.cells) <= 40
    notebook.cells.insert(0, nbformat.v4.new_code_cell(QUICKLY))
    for cell in notebook.cells:
        cell.source = cell.source.replace("n_tests=100", "n_tests=50, n_draws=100")
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": folder}}).execute()
    return {
        cell.source: [output.get("data", {"text/plain": output.get("text")})
                      for output in cell.outputs]
        for cell in notebook.cells if cell.cell_type == "code"
    }  # fmt: skip


def of_cell(executed, begin):
    (outputs,) = (value for source, value in executed.items() if source.startswith(begin))
    return outputs


def numbers(executed, begin):
    """The rows of a cell's last table: its index → the numbers in it."""
    table = of_cell(executed, begin)[-1]["text/html"]
    rows = re.findall(r"<tr>\s*<th>(.+?)</th>(.*?)</tr>", table, re.S)
    return {name: [float(each) for each in re.findall(r"-?\d+\.\d+", row)] for name, row in rows}


def test_tables_and_progress_in_a_notebook(executed):
    (study,) = of_cell(executed, "k1, k2, k3")
    assert study["text/plain"] == "<Study 'Which mode is the second one?': 2 model classes>"
    assert study["text/html"].count("<tr>") == 2
    progress, ranking = of_cell(executed, "fits = bs.rank")
    # Last, whether an appendage on the most probable class explains the data as well.
    assert [line.split(":")[0] for line in progress["text/plain"].splitlines()] == [
        "fit to mode 2", "fit to mode 3", "all hypotheses",
    ]  # fmt: skip
    assert ranking["text/html"].index("fit to mode 2") < ranking["text/html"].index("fit to mode 3")


def test_the_story_begins_with_a_wrong_fit_and_its_warning(executed):
    for row in numbers(executed, "def intervals").values():
        *fits, true = row
        for median, low, high in (fits[:3], fits[3:]):
            assert low < median < high
            assert not low <= true <= high
    (words,) = of_cell(executed, "print(fits.summary())")
    assert words["text/plain"].startswith("(!) The data look as if an appendage split a mode")
    assert words["text/plain"].index("the answer may be among wrong") < words["text/plain"].index(
        "The most probable of the 2 model classes is: class 'fit to mode 2'"
    )


def test_the_story_ends_with_what_is_true(executed):
    (plan,) = (each for each in of_cell(executed, "mass = bs.Par") if "layout" in str(each))
    assert "says most about which of the 4 model classes holds is floor 1" in plan["text/plain"]
    for begin in ("found = bs.identify", "found_after = bs.identify"):
        rows = numbers(executed, begin)
        assert len(rows) == 4
        for identified, error, *_, true in rows.values():
            assert abs(identified / true - 1.0) < 3.0 * error
    (words,) = of_cell(executed, "print(search.summary())")
    assert (
        "It is most probably a pendulum at floor 3 (probability above 0.99" in words["text/plain"]
    )
    for low, _, high, true in numbers(executed, "place = search").values():
        assert low < true < high
    (words,) = of_cell(executed, "print(changes.summary())")
    lost = (
        r"Most probably it is k1 \(probability above 0.9999\), which lost \S+ % \((\S+) to (\S+)\)"
    )
    low, high = map(float, re.search(lost, words["text/plain"]).groups())
    assert low < 15.0 < high
    words = of_cell(executed, "bare = both_tests")[-1]["text/plain"]
    low, high = map(float, re.search(lost, words).groups())
    assert high < 15.0
    assert words.startswith("(!) The most probable class does not explain the data.")


def test_pictures_moving_shapes_and_the_report_of_the_story(executed):
    pictures = [source for source, outputs in executed.items()
                if any("image/png" in output for output in outputs)]  # fmt: skip
    assert len(pictures) == sum(source.count("bs.plots.plot_") for source in executed) - 1
    (moving,) = of_cell(executed, "bs.plots.plot_moving_shapes")
    assert moving["text/html"].startswith("<iframe srcdoc=")
    assert "report.html" in of_cell(executed, "result = ")[-1]["text/plain"]


def test_a_line_and_a_table(tiny_ranking):
    study, ranking = tiny_ranking.study, tiny_ranking
    shown = [study, ranking, ranking.comparison, *ranking.posteriors, *study.model_classes]
    shown += [study.model_classes[0].configurations[0].data]
    shown += [bs.Record(np.eye(2, 40), 10.0, ("a", "b"), "acceleration", "m/s2")]
    for one in shown:
        assert isinstance(one, Displayed)
        assert repr(one).startswith(f"<{type(one).__name__} ")
        assert len(repr(one)) < 160
        assert len(str(one).splitlines()) == 2 + len(one.to_frame())


def test_public_names_are_all_that_is_completed():
    names = dir(bs)
    assert [name for name in names if name.startswith("_")] == ["__version__"]
    assert set(names) == {*bs.__all__, "__version__", "plots"}
    assert re.match(r"\d+\.\d+", bs.__version__)
