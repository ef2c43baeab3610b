"""``bayes-ssi merge`` from files of modes to one, and its exit codes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import assert_one_line_error
from identified_records import identified

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
    done = run("merge", *files, "--out", out, "--json")
    assert done.exit_code == 0
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
