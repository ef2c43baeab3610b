"""``bayes-ssi merge``, and commands that use modes whose identification failed: exit codes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import TINY_STUDY, assert_one_line_error, succeeded
from identified_records import identified
from searches import by_count

import bayes_ssi as bs


@pytest.fixture
def files(tmp_path):
    """Two setups of one mode, joined by sensor b."""
    for name, sensors, shape, frequency in (
        ("one", ("a", "b"), [0.6, 0.8], 1.000),
        ("two", ("b", "c"), [0.8, -0.6], 1.002),
    ):
        mode = bs.IdentifiedMode("1", frequency, shape, frequency_cov=0.002, shape_sd=0.01)
        bs.write_modal_data(bs.ModalData((mode,), (0.5, 2.0), sensors), tmp_path / f"{name}.csv")
    return tmp_path / "one.csv", tmp_path / "two.csv"


def test_setups_become_one_file(run, files, tmp_path):
    out = tmp_path / "merged.csv"
    done = succeeded(run("merge", *files, "--out", out, "--json"))
    modes = bs.read_modal_data(out)
    assert modes.sensors == ("a", "b", "c")
    (mode,) = modes.modes
    np.testing.assert_allclose(mode.shape / mode.shape[1], [0.75, 1.0, -0.75], rtol=1e-9)
    assert mode.frequency_cov == pytest.approx(0.002 / np.sqrt(2.0))
    (row,) = json.loads(done.stdout)["modes"]
    assert row["labels"] == {"one.csv": "1", "two.csv": "1"}
    # ln(1.002) over 0.002 √2
    assert row["frequency_scatter"]["ratio"] == pytest.approx(np.log(1.002) / 0.002 / np.sqrt(2.0))
    assert_one_line_error(run("merge", *files, "--out", out), "merged.csv exists")


def test_files_that_disagree_end_with_3_and_are_written(run, files, tmp_path):
    files[1].write_text(files[1].read_text().replace("1.002", "1.02"))
    out = tmp_path / "merged.csv"
    done = run("merge", *files, "--out", out)
    assert done.exit_code == 3
    assert "Failed check: mode '1' at 1.01 Hz: the tests' frequencies scatter by 7.0" in done.stdout
    assert out.exists()


def test_a_file_given_twice_is_refused(run, files):
    assert_one_line_error(run("merge", files[0], files[0]), "one.csv: given twice")


def test_bands_that_overlap_become_one_in_a_new_folder(run, files, tmp_path):
    files[1].write_text(files[1].read_text().replace("0.5,2.0", "0.9,3.0"))
    out = tmp_path / "new" / "merged.csv"
    done = run("merge", *files, "--out", out)
    assert (done.exit_code, "Band: 0.5 to 3 Hz." in done.stdout) == (0, True)
    assert bs.read_modal_data(out).band_hz == (0.5, 3.0)
    files[1].write_text(files[1].read_text().replace("0.9,3.0", "2.5,3.0").replace("1.002", "2.6"))
    words = "no modes were sought from 2 to 2.5 Hz, below the band of two.csv"
    assert_one_line_error(run("merge", *files), words)


def test_failed_checks_of_an_identification_end_with_3(run, files):
    modes = bs.read_modal_data(files[0])
    files[0].unlink()
    failed = identified("one.npz", doubts=("the methods differ",))
    bs.write_modal_data(replace(modes, identifications=(failed,)), files[0])
    done = run("merge", *files)
    assert done.exit_code == 3
    assert "Failed check: identified from one.npz: the methods differ" in done.stdout


CHECK = "identified from tower.csv: chi-square of the spectra is 109 times their freedom"
NOT_IDENTIFIED = (
    "identified from tower.csv: the record shows a mode at 2.5 Hz that is not identified (two "
    "modes share its peak): a model class that has it counts as missing it, and its probability is "
    "too low"
)
WORDS = "2 checks of the identified modes failed"


@pytest.fixture(scope="module")
def path(tmp_path_factory, tiny_study):
    """The tiny study, its modes read from a file whose identification failed."""
    directory = tmp_path_factory.mktemp("study")
    doubt, missed = CHECK.removeprefix("identified from tower.csv: "), "two modes share its peak"
    failed = identified("tower.csv", doubts=(doubt,), not_identified=((2.5, missed),))
    data = replace(tiny_study.model_classes[0].data, identifications=(failed,))
    bs.write_modal_data(data, directory / "modes.csv")
    begin, end = TINY_STUDY.index("modes = bs.ModalData("), TINY_STUDY.index("error = bs.")
    read = f"modes = bs.read_modal_data({str(directory / 'modes.csv')!r})\n"
    (directory / "tiny.py").write_text(TINY_STUDY[:begin] + read + TINY_STUDY[end:], "utf-8")
    return directory / "tiny.py"


@pytest.fixture(scope="module")
def ranking(path):
    return bs.rank(bs.load_study(path), seed=7)


def flat(text):
    return " ".join(text.split())


def says_both(done):
    words = flat(done.stdout)
    return done.exit_code == 3 and all(each in words for each in (WORDS, CHECK, NOT_IDENTIFIED))


def test_rank_with_failed_data(run, path, ranking, monkeypatch):
    posteriors = list(ranking.posteriors)
    monkeypatch.setattr("bayes_ssi.studies.questions.sample_all", lambda *_, **__: posteriors)
    done = run("rank", path, "--seed", 7, "--workers", 1)
    assert says_both(done)
    assert flat(done.stdout).index(WORDS) < done.stdout.index("The most probable")
    assert "one k (!)" not in done.stdout  # no check of a class failed


def test_search_with_failed_data(run, path, fake_sampling):
    fake_sampling(by_count(0.0, 12.0))
    assert says_both(run("search", path, "--class", "one k", "--most", "1"))


def test_check_and_calibrate_with_failed_data(run, path):
    done = run("check", path.parent / "modes.csv")
    assert says_both(done)
    assert "No warnings" not in done.stdout
    record = json.loads(run("check", path.parent / "modes.csv", "--json").stdout)
    assert record["failed_checks"] == [CHECK, NOT_IDENTIFIED]
    assert record["remarks"] == []
    assert says_both(run("calibrate", path, "--class", "one k", "--starts", 4))


@pytest.mark.parametrize("command", [("what-if", "--spurious", "2"), ("predict", "--draws", "20")])
def test_of_a_result_with_failed_data(run, path, ranking, tmp_path, command):
    """Where it was accepted, they are said and no failure."""
    for accepted in (False, True):
        out = tmp_path / str(accepted)
        bs.save_result(ranking, out, study_file=str(path), accept_failed_checks=accepted)
        done = run(command[0], out, *command[1:])
        said = f"{WORDS} (accepted when the result was saved)" in flat(done.stdout)
        assert (done.exit_code == 0 and said) if accepted else says_both(done)
