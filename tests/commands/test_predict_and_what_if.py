"""``bayes-ssi predict`` and ``what-if``: what they print, save and refuse."""

import json
import shutil

import matplotlib as mpl
import numpy as np
import pytest
from conftest import TINY_STUDY, assert_one_line_error, succeeded
from whole_tables import rows_of_csv as rows

import bayes_ssi as bs

mpl.use("Agg")

AT2 = "a\nb\nACCELERATION IN UNITS OF G\nNPTS= 4, DT= .5 SEC\n0. .1 .2 -.1\n"


@pytest.fixture
def saved(tiny_result):
    return tiny_result.directory


@pytest.fixture
def predict(run, saved, tmp_path, no_drawings):  # noqa: ARG001
    """Runs the command with few draws and without figures, saving in ``out``."""

    def call(*options, result=saved, out=tmp_path / "out"):
        return run("predict", result, "--draws", 40, "--out", out, *options)

    return call


@pytest.mark.usefixtures("no_drawings")
def test_from_elsewhere_the_study_and_its_data_are_found(run, tiny_ranking, tmp_path, monkeypatch):
    """Paths started where the result was made, a directory above it."""
    (tmp_path / "studies").mkdir()
    text = 'open("data.txt").close()\n' + TINY_STUDY
    (tmp_path / "studies" / "tiny.py").write_text(text, "utf-8")
    (tmp_path / "data.txt").touch()
    (tmp_path / "results").mkdir()
    out = tmp_path / "results" / "tiny"
    bs.save_result(tiny_ranking, out, study_file="studies/tiny.py")
    assert run("predict", out, "--draws", 5, "--transfer", "none").exit_code == 0
    monkeypatch.chdir(out)
    assert run("predict", ".", "--draws", 5, "--out", tmp_path / "p").exit_code == 0


def test_modes_alone_of_no_more_draws_than_are_stored(predict, saved, tmp_path):
    n_stored = max(len(each.values) for each in bs.load_result(saved).posteriors)
    result = predict("--draws", 10**8, "--class", "one k", "--transfer", "none")
    assert f"{n_stored} stored draws; nothing was sampled" in result.stdout
    assert f"(!) --draws 100000000: no more than {n_stored} draws are stored." in result.stdout
    assert "Peak" not in result.stdout
    assert sorted(path.stem for path in (tmp_path / "out").glob("*.csv")) == [
        "frequencies", "mode_shapes",
    ]  # fmt: skip


def test_without_options(run, tiny_ranking, tmp_path, monkeypatch):
    monkeypatch.delattr("bayes_ssi.inference.posterior_sampling.sample.sample_target")
    (tmp_path / "tiny.py").write_text(TINY_STUDY, "utf-8")
    out = tmp_path / "result"
    bs.save_result(tiny_ranking, out, study_file=str(tmp_path / "tiny.py"))
    done = succeeded(run("predict", out))
    text = " ".join(done.stdout.split())
    for words in (
        "Two storeys: 1000 stored draws; nothing was sampled.",
        "average: draws in proportion to probability,",
        "Damping: 2 % in all modes, assumed, since none was identified.",
        "Transfer functions: from the ground's acceleration, 1943 frequencies from 0 to 3 Hz.",
        "Natural frequencies (Hz) before and after updating, 90 % band",
        "Peak acceleration, absolute value, 90 % band",
        f"Saved in {out / 'predictions'}: 4 tables and 1 figure.",
    ):
        assert words in text
    assert max(map(len, done.stdout.split("Natural")[1].split("Saved in")[0].splitlines())) <= 80
    assert sorted(path.name for path in (out / "predictions").iterdir()) == [
        "figures", "frequencies.csv", "mode_shapes.csv", "peaks.csv", "predictions.json",
        "transfer_functions.csv",
    ]  # fmt: skip
    assert {row["place"] for row in rows(out / "predictions" / "peaks.csv")} == {"floor 2"}
    record = json.loads((out / "predictions" / "predictions.json").read_text("utf-8"))
    assert (record["damping"], record["draws"]) == (0.02, 1000)
    # A result that holds predictions is still one.
    assert bs.load_predictions(out).n_draws == 1000


def test_all_options(predict, saved, tmp_path):
    for name, unit in (("first", "G"), ("second", "CM/S2")):
        (tmp_path / f"{name}.AT2").write_text(AT2.replace("OF G", f"OF {unit}"), "utf-8")
    files = [tmp_path / f"{name}.AT2" for name in ("first", "second")]
    done = predict(
        "--class", "one k", "--class", "average", "--quantity", "drift", "--at", "ground:floor 1",
        "--at", "floor 1:floor 2", "--damping", "0.01,0.03", "--transfer", "floor 2",
        "--frequencies", 0.5, 2.0, "--record", files[0], "--record", files[1],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    for words in ("Damping: 1, 3 % mode by mode, as given.", "from a force at 'floor 2'",
                  "Record first: 4 samples, 0.5 s apart; peak 0.2 g.", "90 % band"):  # fmt: skip
        assert words in done.stdout
    output = bs.Output("drift", (("ground", "floor 1"), ("floor 1", "floor 2")))
    own = bs.load_predictions(saved, n_draws=40).of("one k")
    histories = own.time_histories(bs.read_ground_motion(files[0]), output, (0.01, 0.03))
    expected = np.quantile(np.abs(histories.draws).max(-1), [0.05, 0.5, 0.95], axis=0)
    actual = [row for row in rows(tmp_path / "out" / "peaks.csv")
             if (row["model_class"], row["of"]) == ("one k", "time history: first")]  # fmt: skip
    assert [row["place"] for row in actual] == list(output.labels)
    for column, numbers in zip(("low", "median", "high"), expected, strict=True):
        np.testing.assert_allclose([float(row[column]) for row in actual], numbers, rtol=1e-6)
    transfer = rows(tmp_path / "out" / "transfer_functions.csv")
    at = np.array([float(row["frequency_hz"]) for row in transfer[:10]])
    assert at[0] == 0.5
    band = own.transfer_functions(at, output, (0.01, 0.03), force_at="floor 2").band()
    np.testing.assert_allclose([float(r["high"]) for r in transfer[:10]], band.high[0], rtol=1e-5)


def test_modes_alone_of_a_structure_without_masses(predict, monkeypatch):
    """Modes of a function, or of matrices without ``influence``."""

    def unknown(*_):
        raise TypeError("its masses are not known; give influence=")

    monkeypatch.setattr("bayes_ssi.structures.lumped.LumpedStructure.modal_model", unknown)
    done = succeeded(predict())
    assert "No transfer functions: how ground motion acts on the degrees of freedom" in done.stdout
    assert_one_line_error(predict("--transfer", "ground", "--overwrite"), "give influence=")


def test_long_time_histories_are_announced(predict, tmp_path, monkeypatch):
    (tmp_path / "quake.AT2").write_text(AT2)
    monkeypatch.setattr("bayes_ssi.results.predictions.posterior_draws.ARRAY_SIZE", 40 * 4 - 1)
    done = predict("--record", tmp_path / "quake.AT2")
    assert "40 time histories of 4 samples take a while; fewer --draws" in done.stderr


def test_warnings_about_damping_and_records(predict, tmp_path):
    (tmp_path / "quake.AT2").write_text(AT2.replace(".2", "200."), "utf-8")
    out = predict("--damping", 0.5, "--record", tmp_path / "quake.AT2").stdout
    assert "(!) damping is 0.5, a fraction: 50 % of critical damping" in out
    assert "(!) record quake: its peak, 200 g" in out
    assert "carry frequencies up to 1 Hz; mode 2 of the structure, at 1.6" in out
    out = predict("--damping", 1e-5, "--overwrite").stdout
    assert "(!) The frequencies may miss the top" in out


def test_nothing_is_overwritten_silently(predict, tmp_path):
    assert predict().exit_code == 0
    before = (tmp_path / "out" / "peaks.csv").read_text("utf-8")
    again = ("--damping", 0.1)
    assert_one_line_error(predict(*again), "out: exists already", "--overwrite")
    assert (tmp_path / "out" / "peaks.csv").read_text("utf-8") == before
    assert predict(*again, "--overwrite").exit_code == 0
    assert (tmp_path / "out" / "peaks.csv").read_text("utf-8") != before
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").write_text("all of it", "utf-8")
    assert_one_line_error(predict("--overwrite", out=precious), "is not overwritten")
    assert (precious / "thesis.txt").is_file()


def test_a_failure_leaves_nothing_behind(predict, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device", "figure.png")

    monkeypatch.setattr("bayes_ssi.plots.prediction_plots.save_prediction_figures", fail)
    assert_one_line_error(predict(), "figure.png: No space left on device")
    assert not (tmp_path / "out").exists()
    assert list(tmp_path.glob(".out*")) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--record", "nowhere.AT2"), ("nowhere.AT2: No such file",)),
        (("--damping", 0), ("damping must be", "strictly between 0 and 1", "0.0")),
        (("--damping", "0.02,0.03,0.04"), ("one for each of the 2 modes", "3 ratios")),
        (("--damping", "two"), ("--damping", "'two'")),
        (("--at", "roof"), ("place 'roof'", "'floor 1', 'floor 2'")),
        (("--transfer", "roof"), ("place 'roof'", "'floor 1', 'floor 2'")),
        (("--quantity", "drift", "--at", "floor 1"), ("LOWER:UPPER", "'floor 1'")),
        (("--class", "two k"), ("no model class 'two k'", "'one k', 'each k'")),
        (("--configuration", "bare"), ("without a name", "'bare'")),
        (("--frequencies", 3, 1), ("band", "3.0 and 1.0")),
        (("--transfer", "none", "--frequencies", 1, 3), ("--frequencies", "--transfer is none")),
        (("--unit", "g"), ("--unit", "--record")),
        (("--dt", 0.1), ("--dt", "--record")),
        (("--study", "nowhere.py"), ("nowhere.py: no such file",)),
    ],
)
def test_bad_options(predict, tmp_path, options, words):
    assert_one_line_error(predict(*options), *words)
    assert not (tmp_path / "out").exists()


def test_a_result_that_is_incomplete(predict, saved, tmp_path):
    copy = shutil.copytree(saved, tmp_path / "copy")
    (copy / "comparison.json").unlink()
    assert_one_line_error(predict(result=copy), str(copy))


def test_the_change_is_shown(run, saved, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    done = succeeded(run("what-if", saved, "--prior", "k=Normal(1, 0.2)", "--weight", "one k=3"))
    assert "Changed: prior of 'k': LogNormal(median=1.0, cov=0.3) → Normal(" in done.stdout
    assert "Changed: prior weight of 'one k': 1 → 3." in done.stdout
    assert "'one k' is the most probable class before and after." in done.stdout
    assert all(len(line) <= 60 for line in done.stdout.splitlines() if "─" in line)


def test_where_the_draws_do_not_say_the_exit_code_is_3(run, saved):
    done = run("what-if", saved, "--prior", "k=LogNormal(5, 0.05)")
    assert done.exit_code == 3, done.output
    assert "(!) 'one k': the draws do not cover the changed class: Pareto k is" in done.stdout
    assert "tiny.py, and run, with another --out: bayes-ssi" in " ".join(done.stdout.split())


def test_a_record(run, saved):
    done = run("what-if", saved, "--detection", "0.9", "--json")
    rows = json.loads(done.stdout)["answer"]["classes"]
    assert {row["name"] for row in rows} == {"one k", "each k"}
    assert all(row["problem"] == "" for row in rows)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ("nothing is changed; give a prior",)),
        (("--prior", "k"), ("--prior: must be NAME=DISTRIBUTION", "'k'")),
        (("--prior", "k=Gamma(1, 2)"), ("--prior", "choose from Normal, LogNormal")),
        (("--prior", "k=Normal(1, -2)"), ("--prior: Normal: sd must be positive",)),
        (("--prior", "k=Normal(1, 2)", "--prior", "k=Normal(1, 3)"), ("'k' is given twice",)),
        (("--weight", "one k=x"), ("--weight: 'x' is not a number",)),
        (("--weight", "one k=0"), ("prior weight of 'one k'", "positive")),
        (("--spurious", "0"), ("expected_spurious_modes must be positive",)),
    ],
)
def test_changes_that_are_refused(run, saved, options, words):
    assert_one_line_error(run("what-if", saved, *options), *words)
