"""The README is short, its code runs, and what it says is there."""

import re
import tomllib

import pytest
from code_blocks import README, ROOT, blocks, run_block
from documented_tables import differences, documented_tables, rows_of

import bayes_ssi as bs
from bayes_ssi.cli import main

BLOCKS = blocks(README)


def test_the_readme_is_short():
    assert len(README.read_text("utf-8").splitlines()) <= 150


def test_pictures_are_there():
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README.read_text("utf-8"))
    assert len(pictures) == 1
    assert (ROOT / pictures[0]).is_file()


def test_the_script_has_15_lines_and_finds_the_right_class(monkeypatch, capsys):
    (script,) = (block.text for block in BLOCKS if block.language == "python")
    assert len(script.strip().splitlines()) <= 15
    monkeypatch.chdir(ROOT)
    exec(compile(script, "README.md", "exec"), {})
    name, probability = capsys.readouterr().out.rsplit(maxsplit=1)
    assert name == "resonant infill"
    assert float(probability) > 0.9999


def test_the_table_is_what_the_command_prints(tmp_path, capsys):
    ((command, shown),) = documented_tables(README)
    assert list(shown) == ["3", "1-a", "2", "1-b"]
    own = [str(ROOT / command[-1]), "--json", "--out", str(tmp_path / "out")]
    main([*command[1:-1], *own], standalone_mode=False)
    now = rows_of(capsys.readouterr().out)
    assert list(differences(shown, now)) == []
    assert len(list(differences(shown, now | {"3": (now["3"][0] + 0.1, now["3"][1])}))) == 1
    assert len(list(differences(shown, dict(reversed(now.items()))))) == 1


@pytest.mark.usefixtures("coarse_command")
def test_an_own_study_takes_three_commands(tmp_path, monkeypatch):
    (own,) = (block for block in BLOCKS if block.text.startswith("bayes-ssi new"))
    assert len(own.commands) == 3
    monkeypatch.chdir(tmp_path)
    run_block(own)
    (report,) = re.findall(r"`(runs/results/\S+/report\.html)`", README.read_text("utf-8"))
    assert (tmp_path / report).is_file()


def test_the_example_of_a_data_file_is_read(tmp_path):
    (example,) = (block.text for block in BLOCKS if block.text.startswith("# source"))
    (tmp_path / "modes.csv").write_text(example, "utf-8")
    data = bs.read_modal_data(tmp_path / "modes.csv")
    assert data.labels == ("1", "2a", "2b")
    assert data.band_hz == (0.0, 6.0)
    assert [mode.n_measured for mode in data.modes] == [3, 2, 0]


def test_one_version_is_stated():
    """By the project, by how to cite it, and by the newest entry of its changes."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    (cited,) = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.M)
    newest = re.search(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)[1]
    assert project == cited == newest


def test_the_files_that_are_named_are_there():
    for page in (README, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"):
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
            assert (ROOT / link).exists(), link


def test_the_tests_run_by_ci_are_those_of_the_readme():
    (command,) = re.findall(r"pytest -n.*", README.read_text("utf-8"))
    assert command in (ROOT / ".ci" / "run").read_text("utf-8")
