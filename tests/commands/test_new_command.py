"""Example studies run unchanged, the guide is opened, and first screens stay word for word."""

import ast
import shlex
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from code_blocks import ROOT
from conftest import assert_one_line_error, succeeded

from bayes_ssi.commands.new import KINDS
from bayes_ssi.studies.ranking.study import load_study


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_study_runs(run, kind):
    assert "bayes-ssi rank mine.py" in succeeded(run("new", "mine", "--kind", kind)).output
    assert "No warnings." in succeeded(run("check", "mine.csv")).output
    study = load_study("mine.py")
    one, each = study.model_classes
    assert study.mass_unit == "t"
    assert [p.name for p in one.parameters] == ["k"]
    assert [p.name for p in each.parameters] == ["k1", "k2", "k3"]
    for candidate in study.model_classes:
        candidate.check_structure()
    # The second storey is 20 % softer: this, and not the nominal building, fits.
    actual = each.log_likelihood(np.array([[1.0, 0.8, 1.0], [1.0, 1.0, 1.0]]))
    assert actual[0] > actual[1] + 10.0


@pytest.mark.parametrize(
    "name", ["2 storeys ü", "it's", 'a"""b', "back\\slash", "$HOME;ls", "v1.2"]
)
def test_suggested_commands_are_quoted_for_a_shell(run, name):
    suggested = [shlex.split(line) for line in succeeded(run("new", name)).stdout.splitlines()[1:]]
    assert suggested == [["bayes-ssi", "check", f"{name}.csv"], ["bayes-ssi", "rank", f"{name}.py"]]
    assert run(*suggested[0][1:]).exit_code == 0
    load_study(f"{name}.py")
    written = ast.get_docstring(ast.parse(Path(f"{name}.py").read_text("utf-8")))
    assert shlex.split(written.splitlines()[-1].removeprefix("Run it with: ")) == suggested[1]


def test_nothing_is_overwritten(run):
    Path("mine.csv").write_text("precious")
    done = run("new", "mine.py")
    assert_one_line_error(done, "Error: mine.csv, line 1: columns must be separated by")
    assert Path("mine.csv").read_text() == "precious"
    assert not Path("mine.py").exists()
    assert run("new", "none/mine").exit_code == 2
    for name in (".", "a\tb"):
        assert_one_line_error(run("new", name), f"study: {name!r} is not a file name")
    assert_one_line_error(run("new", "other", "--kind", "bridge"), "'bridge' is not one of")


def test_a_study_of_modes_that_are_there(run):
    text = "# band_hz,0,9\nlabel,frequency_hz,floor 1,floor 3\n1,1.1,0.4,1\n2,2.9,1,-0.5\n3,4,1,0\n"
    Path("mine.csv").write_text(text)
    assert "are named 'floor 1', 'floor 3', and say" in succeeded(run("new", "mine")).output
    assert Path("mine.csv").read_text() == text
    assert load_study("mine.py").model_classes[0].data.frequencies_hz.tolist() == [1.1, 2.9, 4.0]
    assert run("new", "mine").stderr == "Error: mine.py: exists already and is not overwritten\n"


def test_the_guide_is_opened_and_its_path_printed(run, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr("bayes_ssi.commands.guide.files", lambda _: tmp_path)
    assert_one_line_error(run("guide"), "the guide is not built", "pip install")
    page = tmp_path / "guide" / "html" / "index.html"
    page.parent.mkdir(parents=True)
    page.touch()
    assert run("guide", "--no-browser").stdout.strip() == str(page)
    assert opened == []
    assert run("guide").stdout.strip() == str(page)
    assert opened == [page.as_uri()]


SCREENS = Path(__file__).with_name("first_screens")
STUDY = ROOT / "model_classes" / "shear_building.py"
COMMANDS = {
    "new": ("new", "tower"),
    "check": ("check", STUDY.with_name("data") / "case_c.csv"),
    "calibrate": ("calibrate", STUDY, "--class", "3", "--starts", 4),
    "sensitivities": ("sensitivities", STUDY, "--class", "3"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_first_screen(run, monkeypatch, name):
    monkeypatch.delenv("COLUMNS", raising=False)
    done = run(*COMMANDS[name])
    assert (done.exit_code, done.stderr) == (0, "")
    printed = "".join(f"{line.rstrip()}\n" for line in done.stdout.splitlines())
    assert printed == (SCREENS / f"{name}.txt").read_text("utf-8")
