"""Output of the commands in a terminal, in a pipe and for a program."""

import io
import json
import os
import re
import sys

import numpy as np
import pytest
from conftest import assert_one_line_error
from scipy.signal import lfilter

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.commands.terminal import lines_of_progress
from bayes_ssi.inference.sampling.result import SamplingResult


def test_quiet_prints_errors_and_failed_checks_alone(run, tiny_study_file, tmp_path, monkeypatch):
    assert "no such file" in run("rank", tmp_path / "none.py", "--quiet").stderr
    monkeypatch.setattr(SamplingResult, "failed_checks", ["the ensembles differ"])
    result = run("rank", tiny_study_file, "--class", "one k", "--quiet", "--out", tmp_path / "r")
    assert (result.exit_code, result.stdout) == (3, "")
    assert result.stderr == "(!) 1 failed check: 'one k': the ensembles differ\n"


@pytest.mark.usefixtures("coarse_command")
def test_a_ranking_as_json(run, tiny_study_file, tmp_path):
    result = run("rank", tiny_study_file, "--json", "--out", tmp_path / "r")
    printed, stored = json.loads(result.stdout), bs.load_result(tmp_path / "r")
    assert printed["directory"] == str(tmp_path / "r")
    best, row = stored.comparison.best, printed["classes"][0]
    assert (row["name"], row["log_evidence"]) == (best.name, best.log_evidence)
    assert sum(each["probability"] for each in printed["classes"]) == pytest.approx(1.0)
    parameter = printed["parameters"]["one k"][0]
    assert parameter["mean"] == pytest.approx(float(np.mean(stored.posterior("one k").values)))
    assert printed["pairings"]["one k"] == {"": {"1": 1, "2": 2}}


def test_fits_and_data_as_json(run, tiny_study_file, tmp_path):
    printed = json.loads(run("calibrate", tiny_study_file, "--class", "each k", "--json").stdout)
    (fit,) = printed["calibrations"]
    # Unit frequencies at unit factors: the fit is exact.
    assert fit["minima"][0]["values"] == pytest.approx([1.0, 1.0], abs=1e-3)
    path = tmp_path / "modes.csv"
    path.write_text("# band_hz, 0, 3\nlabel,frequency_hz\n1,0.618\n")
    printed = json.loads(run("check", path, "--json").stdout)
    assert printed["modes"][0]["frequency_hz"] == 0.618
    assert printed["remarks"] == ["mode '1': no shape; only its frequency is used"]


PRINTING = """
import os
import numpy as np
import bayes_ssi as bs

print("a study that prints")
os.system("echo and starts programs that do")

def modes(k):
    print("model at", k)
    os.write(1, b"from below Python")
    return np.array([k]), np.ones((1, 1))

k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
structure = bs.FunctionStructure(modes, {"k": k}, n_modes=1, sensors=("roof",))
data = bs.ModalData((bs.IdentifiedMode("1", 1.1, [1.0]),), (0.0, 3.0), ("roof",))
error = bs.ErrorModel(frequency_cov=0.02, shape_sd=0.05)
study = bs.Study("prints", [bs.ModelClass("a", structure, data, error, pairing={"1": 1})])
"""


def test_standard_output_is_the_record_alone(tmp_path, monkeypatch, capfd):
    """Also where libraries and new processes print, which know no ``sys.stdout``."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "prints.py").write_text(PRINTING, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", "prints.py", "--json", "--starts", "2"])
    printed = capfd.readouterr()
    assert ended.value.code in (0, 3), printed.err
    assert "calibrations" in json.loads(printed.out)
    for words in ("a study that prints", "programs that do", "model at", "from below Python"):
        assert words in printed.err


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("rank", "none.py"), "none.py: no such file"),
        (("search", "none.py"), "none.py: no such file"),
        (("calibrate", "none.py"), "none.py: no such file"),
        (("check", "none.csv"), "none.csv"),
        (("predict", "none"), "none: not a result directory"),
        (("report", "none"), "none: not a result directory"),
        (("rank", "none.py", "--seed", "x"), "'x' is not a valid integer"),
        (("rank", "--seeds", "1"), "No such option"),
    ],
)
def test_an_error_is_a_record_too(run, command, words):
    result = run(*command, "--json")
    assert_one_line_error(result, words)
    assert words in json.loads(result.stdout)["error"]


def test_output_that_nobody_reads_or_that_does_not_fit(tmp_path, monkeypatch, capsys):
    rows = "".join(f"{i},{1 + i / 1000}\n" for i in range(100))  # more than a buffer, as JSON
    path = tmp_path / "modes.csv"
    path.write_text("# band_hz, 0, 9\nlabel,frequency_hz\n" + rows, encoding="utf-8")
    reader, writer = os.pipe()
    os.close(reader)
    for output, code, said in (
        (writer, 1, ""), ("/dev/full", 2, "Error: output: No space left on device\n"),
    ):  # fmt: skip
        # What is left in its buffer is not written either, when the file is closed.
        with open(output, "w", encoding="utf-8") as file:
            monkeypatch.setattr("sys.stdout", file)
            with pytest.raises(SystemExit) as ended:
                main(["check", str(path), "--json"])
        assert (ended.value.code, capsys.readouterr().err) == (code, said)


def test_an_error_line_is_never_a_page_long(run, tmp_path):
    path = tmp_path / "modes.csv"
    path.write_text(f"# band_hz, 0, 9\nlabel,frequency_hz\n1,{'x' * 100_000}\n", "utf-8")
    result = run("check", path)
    assert_one_line_error(result, "line 3: frequency_hz", "is not a number")
    assert len(result.stderr) < 2100


def test_colours_and_the_time_left_are_for_terminals_only(run, tiny_study_file, monkeypatch):
    arguments = ("calibrate", tiny_study_file, "--class", "one k", "--starts", 8)
    piped = run(*arguments)
    assert "\x1b" not in piped.stdout + piped.stderr
    assert piped.stderr == ""
    assert "Minima of 'one k'" in piped.stdout
    monkeypatch.setenv("FORCE_COLOR", "1")  # as rich is told of a terminal
    shown = run(*arguments)
    assert "\x1b[" in shown.stdout
    assert re.search(r"one k.*left", shown.stderr)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rank", "study.py", "--only", "a"), "--only is now --class"),
        (("search", "study.py", "--baseline", "a"), "--baseline is now --class"),
        (("hierarchy", "r", "--at", 3), "--at is now --next"),
        (("identify", "record.csv", "--at", 3), "--at is now --mode"),
        (("predict", "r", "--band", 1, 2), "--band is now --frequencies"),
    ],
)
def test_an_option_of_another_name_is_named(run, arguments, words):
    assert_one_line_error(run(*arguments), words)


@pytest.mark.parametrize(("encoding", "column"), [("ascii", "shape +/-"), ("cp1252", "shape ±")])
def test_output_of_any_encoding_and_closed_standard_error(tmp_path, monkeypatch, encoding, column):
    path = tmp_path / "modes.csv"
    path.write_text("# band_hz, 0, 9\nlabel,frequency_hz,σ≈1\n1,1.5,1\n", encoding="utf-8")
    written = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(written, encoding, write_through=True))
    monkeypatch.setattr("sys.stderr", None)
    with pytest.raises(SystemExit) as ended:
        main(["check", str(path)])
    sys.stderr.close()  # that it was given
    assert ended.value.code == 0
    printed = written.getvalue().decode(encoding)
    assert column in printed
    assert "Sensors: sd~1." in printed


def test_modes_are_written_before_they_are_printed(tmp_path, run, monkeypatch):
    samples = np.random.default_rng(0).standard_normal((2, 2000))
    samples = lfilter([1.0], [1.0, -1.9, 0.98], samples)
    np.savez(tmp_path / "a.npz", a=samples, rate_hz=20.0, unit="g", sensors=["a", "b"])

    def closed(*_):
        raise BrokenPipeError

    monkeypatch.setattr("bayes_ssi.commands.terminal.show", closed)
    run("identify", tmp_path / "a.npz", "--band", 0.3, 1, "--out", tmp_path / "m.csv")
    assert bs.read_modal_data(tmp_path / "m.csv").modes


def test_a_log_says_every_minute_what_is_done_and_how_long_is_left(capsys):
    """A fifth in 70 s leaves four times as long; a class is at 0.1 + 0.35/2 after half a step."""
    clock = [0.0]
    show = lines_of_progress(lambda: clock[0])
    show("all hypotheses", "screening 200", 0.0)
    for at, done in ((50.0, 0.15), (70.0, 0.2), (100.0, 0.3)):
        clock[0] = at
        show("all hypotheses", "screening 200", done)
    show("one", "searches", 0.0)
    clock[0] = 200.0
    show("one", "compression of the prior", 0.5)
    show("one", "evidence", 1.0)
    assert capsys.readouterr().err.splitlines() == [
        "all hypotheses, screening 200: 20 % done, about 5 min left",
        "one: 28 % done, about 4 min left",
        "sampled one",
    ]
