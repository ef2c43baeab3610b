"""``bayes-ssi identify`` from files to a CSV of modes, and its exit codes."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import FLOORS, assert_one_line_error, succeeded
from identified_records import identified
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.measurements.modes.identification_summary import Peak
from bayes_ssi.measurements.records import modal_identification
from bayes_ssi.results.identification_answer import identification_answer

pytestmark = pytest.mark.usefixtures("once")
BAND = ["--band", "0.6", "4.6"]


@pytest.fixture(scope="module")
def once():
    """The same sensors are identified once for a band and modes, whatever is then asked for."""
    known, identify = {}, modal_identification.identify

    def remembered(record, band, **options):
        key = repr((record.sensors, band, options))
        if key not in known:
            known[key] = identify(record, band, **options)
        return known[key]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(modal_identification, "identify", remembered)
        yield


def test_the_ground_is_no_sensor_of_the_modes(tmp_path):
    """Two floors on a shaken ground, with all figures: the ground is in none of them."""
    rng = np.random.default_rng(4)
    n, rate = 6000, 20.0
    at_hz = np.fft.rfftfreq(2 * n, 1.0 / rate)
    lines = np.fft.rfft(rng.standard_normal(n), 2 * n)
    lines[0] = 0.0
    shapes, amplification = np.array([[0.526, 0.851], [0.851, -0.526]]), 1.0
    for f, shape in zip((1.0, 2.62), shapes, strict=True):
        beta = f / np.maximum(at_hz, 1e-9)
        h = 1.0 / (1.0 - beta**2 - 0.04j * beta)
        amplification = amplification - np.outer(shape * shape.sum(), h)
    samples = np.fft.irfft(np.vstack([lines, amplification * lines]), 2 * n)[:, :n]
    samples += 0.01 * samples.std(1, keepdims=True) * rng.standard_normal(samples.shape)
    names = ("ground", "floor 1", "floor 2")
    known = {"sensors": names, "rate_hz": rate, "quantity": "acceleration", "unit": "m/s2"}
    np.savez(tmp_path / "shaken.npz", samples=samples, **known)
    figures, out = tmp_path / "figures", tmp_path / "modes.csv"
    record = tmp_path / "shaken.npz"
    result = run(record, "--band", 0.5, 4, "--figures", figures, "--out", out, "--compare")
    assert result.exit_code == 0, result.output
    assert {path.stem for path in figures.iterdir()} >= {"complexity", "shapes", "singular_values"}
    modes = bs.read_modal_data(out)
    assert modes.sensors == ("floor 1", "floor 2")
    np.testing.assert_allclose(modes.frequencies_hz, [1.0, 2.62], rtol=0.01)
    assert (np.abs(modes.unit_shapes * shapes.T).sum(0) ** 2 > 0.99).all()
    assert "clocks" not in result.output


def run(*arguments):
    return CliRunner().invoke(main, ["identify", *map(str, arguments)])


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    rng = np.random.default_rng(0)
    record = simulated_record(with_infill(), FLOORS, rng, duration_s=300.0, rate_hz=20.0)
    path = tmp_path_factory.mktemp("record") / "setup.npz"
    np.savez(path, samples=record.samples, sensors=FLOORS, rate_hz=20.0, unit="m/s2")
    return path


def test_another_method_writes_its_own_modes(path, tmp_path):
    for method, name in (("fdd", "FDD"), ("bayesian-fft", "Bayesian FFT")):
        out = tmp_path / f"{method}.csv"
        run(path, *BAND, "--quantity", "acceleration", "--method", method, "--out", out)
        data = bs.read_modal_data(out)
        assert data.identifications[0].method == name
        # Peaks of spectra have no errors.
        assert (data.modes[0].frequency_cov is None) == (method == "fdd")


def test_a_record_becomes_a_file_of_modes(path, tmp_path):
    out = tmp_path / "modes.csv"
    figures = tmp_path / "figures"
    to = ["--out", out, "--figures", figures]
    done = succeeded(run(path, *BAND, "--quantity", "acceleration", *to, "--json"))
    record = json.loads(done.stdout)
    assert [len(peak["frequencies_hz"]) for peak in record["peaks"]] == [1, 1, 1, 1]
    assert sorted(file.stem for file in figures.iterdir()) == [
        "complexity", "moving_shapes", "shapes", "singular_values", "stabilisation",
        "whitened_residuals",
    ]  # fmt: skip
    modes = bs.read_modal_data(out)
    assert modes.sensors == FLOORS
    assert modes.source == "identified from setup.npz"
    np.testing.assert_allclose(modes.frequencies_hz, [0.983, 2.604, 3.005, 3.984], rtol=0.02)
    np.testing.assert_array_equal(
        modes.frequencies_hz, [mode["frequency_hz"] for mode in record["modes"]]
    )
    covariance = np.array(record["covariance_of_log_frequencies_and_unit_shapes"])
    np.testing.assert_array_equal(covariance, modes.covariance)
    covs = [mode.frequency_cov for mode in modes.modes]
    np.testing.assert_allclose(covs, np.sqrt(covariance.diagonal()[:4]), rtol=1e-12)
    for option, there in (("--out", out), ("--figures", figures)):
        again = run(path, *BAND, "--quantity", "acceleration", option, there)
        assert_one_line_error(again, f"{there.name} exists")


def test_what_is_not_stated_is_asked_for_and_a_failed_check_ends_with_3(path):
    assert_one_line_error(
        run(path, *BAND, "--quantity", "velocity"), "unit of velocity must be one"
    )
    # One mode at two peaks: what it becomes is neither of them.
    wrong = run(path, "--band", 2.2, 3.5, "--mode", 2.8, "--quantity", "acceleration")
    assert wrong.exit_code == 3
    first, answer = wrong.stdout.lstrip().split("\n\n")[:2]
    assert first.startswith("(!) 1 check failed. Understand why before you use the modes.")
    assert "the record shows a mode at 2.8 Hz that is not identified" in " ".join(first.split())
    assert answer.startswith("1 mode at 2.6")
    assert "peak" not in answer


def peak(*frequencies, two=None, phases=1e-4):
    return Peak(frequencies, tuple(range(len(frequencies))), two, phases, 0.05, 1.2)


@pytest.mark.parametrize(
    ("peaks", "words"),
    [
        ((peak(1.0), peak(2.0, two=0.01)), "One mode explains every peak."),
        ((peak(1.0), peak(2.0, 2.1, two=0.99)), "At 2 and 2.1 Hz there are two modes and not one. "
         "One mode explains every other peak."),
        ((peak(2.0, two=0.4),), "Whether one mode or two are at 2 Hz, the record cannot tell."),
        ((peak(1.0), peak(2.0, two=0.4, phases=0.9)), "At 2 Hz the sensors move out of phase. "
         "One mode explains every other peak."),
        ((peak(2.0, phases=None),), "The spectra around 2 Hz are not explained."),
    ],
)  # fmt: skip
def test_the_answer_says_which_peaks_hold_more_than_one_mode(peaks, words):
    summary = identified("a.csv", peaks=peaks)
    found = SimpleNamespace(**vars(summary), quoted=summary.record, is_explained=True)
    assert identification_answer(found) == (
        "1 mode at 1 Hz, from 10 minutes of 2 sensors, with standard deviations of 0.2 % of "
        f"frequency. {words}"
    )


def test_the_first_screen_of_eight_modes_has_40_lines(path):
    done = run(path, *BAND, "--quantity", "acceleration")
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    # Four modes here, and four lines more.
    assert len(lines) + 4 <= 40
    assert lines[1].startswith("4 modes from 0.98")
    assert "chi-square" not in done.stdout
    verbose = run(path, *BAND, "--quantity", "acceleration", "--verbose").stdout
    assert verbose.count("Peak at") == 4
    assert "The record shows independent loads; chi-square" in verbose


def test_a_place_for_modes_is_made_or_refused_before_they_are_sought(path, tmp_path, monkeypatch):
    def identify(*_, **__):
        raise RuntimeError

    monkeypatch.setattr("bayes_ssi.measurements.records.modal_identification.identify", identify)
    stated = [path, *BAND, "--quantity", "acceleration"]
    new = tmp_path / "new" / "folder"
    assert isinstance(run(*stated, "--out", new / "modes.csv").exception, RuntimeError)
    assert new.is_dir()
    for option in ("--out", "--figures"):
        assert_one_line_error(run(*stated, option, path / "modes"), "setup.npz is not a directory")
