"""The command line: what it prints, where it writes, and how it ends."""

import json
import re
import subprocess
import sys
from importlib.metadata import version
from types import SimpleNamespace

import pytest
from conftest import assert_one_line_error, succeeded

from bayes_ssi.commands.calibrate import _conclusion
from bayes_ssi.inference.workers.run import Checkpoint
from bayes_ssi.results.stored_result import load_result

CSV = """\
# source, test of May
# band_hz, 0, 3
label,frequency_hz,floor 1,floor 2
1,0.618,0.5257,0.8507
2,1.618,0.8507,-0.5257
"""


def written(path, text=CSV):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def study_file(tiny_study_file):
    """The tiny study with pieces of its text replaced."""

    def write(*replacements):
        text = tiny_study_file.read_text(encoding="utf-8")
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        return written(tiny_study_file, text)

    return write


def test_rank(run, tiny_study_file, tmp_path):
    out = tmp_path / "result"
    result = succeeded(run("rank", tiny_study_file, "--seed", 7, "--out", out))
    assert result.stderr == "sampled one k\nsampled each k\n"
    for words in ("one k", "each k", f"Saved in {out}. Everything, with figures, on one page:"):
        assert words in result.stdout
    *screen, _, page = result.stdout.splitlines()
    assert page == f"bayes-ssi report {out}"
    assert max(map(len, screen)) <= 80
    assert len(screen) <= 40
    stored = load_result(out)
    assert stored.record.seed == 7
    assert stored.record.study_file == str(tiny_study_file)
    assert f"{stored.comparison.best.log_evidence:.3f}" in result.stdout
    assert [p.name for p in (out / "figures").iterdir()] == ["moving_shapes.json"]
    # No parameter is inferred by two classes.
    assert (out / "averaged_parameters.json").read_text("utf-8").strip() == "[]"


def test_where_results_go_by_default_and_the_wanted_error(run, tiny_study_file, tmp_path):
    assert run("rank", tiny_study_file, "--class", "one k", "--error", "0.2").exit_code == 0
    stored = load_result(tmp_path / "work" / "runs" / "results" / "tiny")
    assert stored.record.settings.log_evidence_error == 0.2


def test_a_failed_check_is_reported_with_exit_code_3(run, tiny_study_file, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_ssi.inference.sampling.result.ERROR_OVER_WANTED", 0.0)
    result = run("rank", tiny_study_file, "--class", "one k", "--out", tmp_path / "r")
    assert result.exit_code == 3
    assert "one k (!)" in result.stdout
    (failed,) = load_result(tmp_path / "r").comparison.failed_checks
    assert failed in " ".join(result.stdout.split())


def test_a_second_run_with_the_same_directory_is_refused_at_once(run, tiny_study_file, tmp_path):
    checkpoint = tmp_path / ".r.checkpoint"
    with Checkpoint(checkpoint).locked():
        result = run("rank", tiny_study_file, "--out", tmp_path / "r")
        assert [path.name for path in checkpoint.iterdir()] == ["lock"], "nothing was sampled"
    assert_one_line_error(result, "another run is using this checkpoint")
    assert not checkpoint.exists()


@pytest.mark.parametrize(
    ("out", "words"),
    [
        (".", "'.' is not the path of a new directory"),
        ("/", "'/' is not the path of a new directory"),
        ("", "'.' is not the path of a new directory"),
        ("..", "'..' is not the path of a new directory"),
        ("file/r", "file/r: cannot be created: "),
        ("file/r/s", "file is not a directory"),
    ],
)
@pytest.mark.parametrize("command", ["rank", "search"])
def test_directories_that_cannot_be(run, tiny_study_file, tmp_path, command, out, words):
    (tmp_path / "work" / "file").touch()
    assert_one_line_error(run(command, tiny_study_file, "--out", out), words)


def test_no_more_workers_than_cores(run, tiny_study_file, tmp_path, monkeypatch):
    monkeypatch.setattr("loky.cpu_count", lambda: 3)
    chosen = []

    def refuse(n_workers, **_):
        chosen.append(n_workers)
        raise ValueError("not sampled here")

    monkeypatch.setattr("bayes_ssi.studies.ranking.class_sampling.Workers", refuse)
    arguments = ("rank", tiny_study_file, "--out", tmp_path / "r", "--workers")
    assert "reduced" not in run(*arguments, 2).stderr
    assert run(*arguments, 1000).stderr.startswith("--workers 1000: reduced to 3, the number of")
    assert chosen == [2, 3]


def test_names_that_cannot_be_printed_are_refused_before_sampling(run, study_file):
    for name in ("a\nb", "\ud800"):
        path = study_file(('"one k"', ascii(name)))
        assert_one_line_error(run("rank", path), "ModelClass: name may not begin", repr(name))
        study_file((ascii(name), '"one k"'))
    path = study_file(('"Two storeys"', '"Two\\nstoreys"'))
    assert_one_line_error(run("rank", path), "Study: name may not begin or end")


def test_data_that_no_class_explains(run, study_file, tmp_path):
    """Two channels exchanged: the first line says so, and the exit code."""
    path = study_file(('("floor 1", "floor 2")', '("floor 2", "floor 1")'))
    result = run("rank", path, "--economical", "--error", 0.1, "--out", tmp_path / "result")
    assert result.exit_code == 3
    first = " ".join(result.stdout.split("model class")[0].split())
    explained = r".* 'each k': the data are not explained: mode '1': ([\d.]+) % off where 2 %"
    assert first.startswith("(!) The most probable class does not explain the data.")
    (off,) = re.match(explained, first).groups()
    assert float(off) == pytest.approx(6.0, abs=0.5)  # of few draws, for this wanted error
    words = "No other class explains them. Likely cause: channels 'floor 2' and 'floor 1' seem"
    assert words in first
    best = load_result(tmp_path / "result").posterior("each k").adequacy
    assert best.overall.p_value < 0.01
    assert [mode.label for mode in best.modes] == ["1", "2"]
    assert best.hints[0].gain > 10.0


def test_calibrate_says_what_is_not_unique(run, tiny_study_file):
    assert "not unique" not in run("calibrate", tiny_study_file).stdout
    result = run("calibrate", tiny_study_file, "--class", "each k", "--shape-weight", "0")
    assert "The fit is not unique" in result.stdout
    assert "'one k'" not in result.stdout
    fits = [SimpleNamespace(objective=each, distance=0.0) for each in (0.01, 0.02, 0.03)]
    made = SimpleNamespace(name="c", best=fits[0], before=fits[1], minima=fits, with_prior=False)
    assert "2 further minima fit less well. How" in _conclusion(made)
    fits[1].objective = 0.01
    assert "2 further minima were reached, of which some fit as well." in _conclusion(made)
    made.with_prior = True
    assert "2 further minima are less probable." in _conclusion(made)


def test_calibrate_says_what_is_not_determined(run, study_file):
    path = study_file(('pairing = {"1": 1, "2": 2}', 'pairing = {"1": 1}'))
    result = succeeded(run("calibrate", path, "--class", "each k", "--shape-weight", "0"))
    assert "1 direction(s) of the parameters undetermined" in result.stdout
    assert result.stdout.count("not determined") == 2
    with_prior = run("calibrate", path, "--class", "each k", "--with-prior", "--starts", 4)
    assert with_prior.stdout.startswith("Minima with the prior's pull of ")
    assert "not determined" not in with_prior.stdout


def test_calibrate_says_that_correlations_of_errors_do_not_count(run, study_file):
    path = study_file(("shape_sd=0.05)", "shape_sd=0.05, between_modes=0.5)"))
    options = ("calibrate", path, "--class", "each k", "--starts", 1)
    words = "has correlated prediction errors, but a calibration takes them for independent"
    assert words in " ".join(run(*options, "--with-prior").stdout.split())
    assert "correlated" not in run(*options).stdout, "no standard errors are shown"
    assert json.loads(run(*options, "--json").stdout)["calibrations"][0]["errors_are_correlated"]


def test_check_warns_of_doubtful_data(run, tmp_path):
    swapped = CSV.replace("1,0.618", "1,2.618").replace("0.8507,-0.5257", "0.8507,")
    result = succeeded(run("check", written(tmp_path / "swapped.csv", swapped)))
    assert "(!) mode '2': shape at one sensor only" in result.stdout
    assert "No warnings." not in result.stdout
    assert "No warnings." in run("check", written(tmp_path / "modes.csv")).stdout


PAIRING = 'pairing = {"1": 1, "2": 2}'
PRIOR = "bs.LogNormal(1.0, 0.3)"
BAD_STUDIES = {
    "unknown sensor": (('"floor 2")', '"roof")'), "sensor 'roof'", "'floor 1', 'floor 2'"),
    "unknown label": ((PAIRING, 'pairing = {"9": 1}'), "'9'", "choose from '1', '2'"),
    "improper prior": ((PRIOR, "bs.Uniform(0.5, math.inf)"), "Uniform: upper", "inf"),
    # One name for two parameters that are not equal: the second has another prior.
    "one name twice": (("study = ", 'k2 = bs.Parameter("k1", bs.LogNormal(2.0, 0.3))\nstudy = '),
                       "'each k'", "two different parameters are named 'k1'"),
    "raises": (("PHI = (", "PHI = 1 / 0\n("), "ZeroDivisionError"),
    "prints a traceback": (("PHI = (", "raise RuntimeError('a\\nb')\n("), "RuntimeError: a b"),
    "unlike data": (("study = ", "other = modes.without_shapes()\nstudy = "),
                    ("(K * k1, K * k2)), modes", "(K * k1, K * k2)), other"), "different data"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_STUDIES.values(), ids=BAD_STUDIES)
def test_bad_studies(run, study_file, case):
    replacements = [item for item in case if isinstance(item, tuple)]
    words = [item for item in case if isinstance(item, str)]
    path = study_file(*replacements)
    assert_one_line_error(run("rank", path), *words)
    assert not list(path.parent.glob("work/*")), "nothing is written"


@pytest.mark.parametrize("command", ["rank", "calibrate"])
@pytest.mark.parametrize("only", ["three", "one k,three", ","])
def test_unknown_class(run, tiny_study_file, command, only):
    assert_one_line_error(run(command, tiny_study_file, "--class", only), "no model class")


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("rank", ["--error", "0"]), ("rank", ["--error", "nan"]), ("rank", ["--error", "inf"]),
        ("calibrate", ["--shape-weight", "-1"]), ("calibrate", ["--starts", "0"]),
    ],
)  # fmt: skip
def test_options_out_of_range(run, tiny_study_file, command, options):
    assert_one_line_error(run(command, tiny_study_file, *options), "must be")


@pytest.mark.usefixtures("coarse_command")
def test_rank_over_all_pairings(run, study_file, tmp_path):
    old = "(K * k1, K * k2)), modes, error,\n                      pairing=pairing),"
    new = '(K * k, K * k)), modes, error,\n                      pairing={"1": 2, "2": 1}),'
    path = study_file((old, new))
    options = ("--any-pairing", "--accept-failed-checks", "--verbose", "--out", tmp_path / "r")
    result = succeeded(run("rank", path, *options))
    assert "Modes of 'one k or each k':" in result.stdout
    assert "identified mode 1 is model mode 1 with probability" in result.stdout
    (posterior,) = load_result(tmp_path / "r").posteriors
    assert posterior.configurations[0].inferred_pairing.best == {"1": 1, "2": 2}


def test_help_lists_commands_whole_in_the_order_of_work_and_the_version_is_printed(run):
    assert run("-h").stdout == run("--help").stdout
    lines = run("--help").stdout.split("Commands:")[1]
    assert "…" not in lines
    assert "..." not in lines
    assert re.findall(r"^  (\S+)", lines, re.M)[:3] == ["new", "import", "identify"]
    assert version("bayes_ssi") in run("--version").stdout
    command = [sys.executable, "-m", "bayes_ssi", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"bayes-ssi, version {version('bayes_ssi')}\n"


LARGE_STUDY = """
import scipy.sparse as sp
import bayes_ssi as bs

k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
springs = sp.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(400, 400))
full = bs.MatrixStructure((k, springs), sp.eye_array(400), n_modes=2)
data = bs.ModalData((bs.IdentifiedMode("1", 0.00125),), band_hz=(0.0, 0.002))
study = bs.Study("large", [
    bs.ModelClass(name, structure, data, pairing={"1": 1})
    for name, structure in (("full", full), ("again", full), ("reduced", full.reduced()))
])
"""


def test_slow_structures_are_named_before_they_are_sampled(run, tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise ValueError("not sampled here")

    monkeypatch.setattr("bayes_ssi.studies.questions.sample_all", refuse)
    study = tmp_path / "large.py"
    study.write_text(LARGE_STUDY, encoding="utf-8")
    lines = run("rank", study, "--out", "r").stderr.splitlines()
    assert lines[0].startswith("Slow: 'full', 'again': 400 degrees of freedom, solved in full")
    assert "Slow" not in "".join(lines[1:])
    assert "Slow" not in run("rank", study, "--out", "r", "--economical").stderr


def test_check_says_what_to_do_with_a_study_or_a_result(run, tiny_study_file, tmp_path):
    result = run("check", tiny_study_file)
    assert_one_line_error(result, "a study; check reads files of modes", "bayes-ssi rank")
    result = run("check", tmp_path)
    assert_one_line_error(result, "a directory; check reads files of modes", "bayes-ssi report")


def test_export_of_a_structure_without_nodes_writes_its_parameters(run, tiny_result, tmp_path):
    result = succeeded(run("export", tiny_result.directory, "--out", tmp_path / "updated"))
    assert "No modes at nodes are written: no degree of freedom is labelled" in result.stdout
    (written,) = (tmp_path / "updated").iterdir()
    assert written.read_text("utf-8").startswith("name,most_probable,mean")


def test_check_takes_the_band_of_modes_that_do_not_state_it(run, tmp_path):
    (tmp_path / "m.csv").write_text("Mode;Frequency [Hz];Damping [%];roof\n1;1,5;1,2;1\n")
    done = succeeded(run("check", tmp_path / "m.csv", "--band", 0, 6))
    assert "Band: 0 to 6 Hz. Sensors: roof." in done.output
    assert_one_line_error(run("check", tmp_path / "m.csv"), "m.csv: no band; add a line such as")
    (tmp_path / "r.csv").write_text("# rate_hz, 9\nA (g),A (g)\n1,2\n2,1\n3,3\n")
    words = "r.csv: record: two sensors are named 'A'; name all in their order (--sensor)"
    assert_one_line_error(run("check", tmp_path / "r.csv"), words)
    assert_one_line_error(run("check", tmp_path / "r.csv", "--band", 0, 6), "--band: applies to mo")
