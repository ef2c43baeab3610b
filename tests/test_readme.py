"""The README's Python runs as it stands, and says what the package does."""

import re
import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from click.testing import CliRunner
from scipy.io import savemat

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.ranking.study import load_study
from bayes_ssi.results.save import save_result

ROOT = Path(__file__).parent.parent
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)


def test_the_readme_has_a_script_of_at_most_15_lines():
    assert len(BLOCKS[0].strip().splitlines()) <= 15


def test_all_blocks_are_run():
    assert len(BLOCKS) == 2


def test_the_script_runs_as_it_stands(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    exec(compile(BLOCKS[0], "README.md", "exec"), {})
    name, probability = capsys.readouterr().out.rsplit(maxsplit=1)
    assert name == "resonant infill"
    assert float(probability) > 0.9999


def test_the_finite_element_model_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    """A chain of unit masses, with three springs side by side between them."""
    n = 1300
    spring = sp.diags_array([-np.ones(n - 1), np.r_[np.full(n - 1, 2.0), 1.0], -np.ones(n - 1)],
                            offsets=[-1, 0, 1])  # fmt: skip
    parts = {"K_rest": 0.2, "K_columns": 0.3, "K_slab": 0.5}
    arrays = {key: sp.csc_array(1e6 * share * spring) for key, share in parts.items()}
    savemat(tmp_path / "frame.mat", {**arrays, "M": sp.csc_array(sp.eye_array(n))})
    monkeypatch.chdir(tmp_path)
    exec(compile(BLOCKS[1], "README.md", "exec"), {})
    found = np.array(capsys.readouterr().out.strip(" []\n").split(), dtype=float)
    expected = 1e3 / np.pi * np.sin((2 * np.arange(1, 5) - 1) * np.pi / (4 * n + 2))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_the_example_of_a_prediction_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    text = (ROOT / "README.md").read_text("utf-8")
    (example,) = re.findall(r"```py\n(.*?)```", text, re.DOTALL)
    study_file = ROOT / "model_classes" / "shear_building.py"
    ranking = bs.rank(load_study(study_file).only(["3"]))
    monkeypatch.chdir(tmp_path)
    save_result(ranking, "runs/results/shear_building", study_file=str(study_file))
    lines = ["a record", "of nobody", "UNITS OF G", "NPTS= 4, DT= .5 SEC", "0. .1 .2 -.1"]
    Path("quake.AT2").write_text("\n".join(lines), "utf-8")
    exec(compile(example, "README.md", "exec"), {})
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("3 Band(low=")
    assert second.startswith("average Band(low=")
    (example,) = re.findall(r"```\n(import arviz.*?)```", text, re.DOTALL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # arviz 0.23 announces version 1 at every import
        exec(compile(example, "README.md", "exec"), {})
    assert {"k1", "ks"} <= {line.split()[0] for line in capsys.readouterr().out.split("\n") if line}

    (command,) = re.findall(r"^bayes-ssi (predict .*)$", text, re.MULTILINE)
    done = CliRunner().invoke(main, shlex.split(command))
    assert done.exit_code == 0, done.output
    assert Path("runs/results/shear_building/predictions/peaks.csv").is_file()


def test_the_example_of_a_data_file_is_read(tmp_path):
    (example,) = re.findall(
        r"```\n(# source.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL
    )
    (tmp_path / "modes.csv").write_text(example, "utf-8")
    data = bs.read_modal_data(tmp_path / "modes.csv")
    assert data.labels == ("1", "2a", "2b")
    assert data.band_hz == (0.0, 6.0)
    assert [mode.n_measured for mode in data.modes] == [3, 2, 0]


@pytest.mark.usefixtures("coarse_command", "no_figures")
def test_an_own_study_takes_three_commands(run):
    text = (ROOT / "README.md").read_text("utf-8")
    (block,) = re.findall(r"```sh\n(bayes-ssi new .*?)```", text, re.DOTALL)
    commands = [shlex.split(line)[1:] for line in block.splitlines()]
    assert len(commands) == 3
    for command in commands:
        extra = ["--accept-failed-checks"] if command[0] == "rank" else []  # it samples coarsely
        done = run(*command, *extra)
        assert done.exit_code == 0, done.output
    assert f"`{commands[-1][-1]}/report/report.html`" in text
    assert Path(commands[-1][-1], "report", "report.html").is_file()
