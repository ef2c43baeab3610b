"""Responses predicted from a stored result: tables, CSV files and figures."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from whole_tables import assert_every_cell_is_whole, printed
from whole_tables import rows_of_csv as rows

import bayes_ssi as bs
from bayes_ssi.plots.prediction_plots import save_prediction_figures
from bayes_ssi.report.tables.prediction_tables import frequency_table, peak_table
from bayes_ssi.results.predictions.requested_predictions import (
    ResponseRequest,
    default_damping,
    default_frequencies,
    default_output,
    predict_responses,
    save_predictions,
)

mpl.use("Agg")

OUTPUT = bs.Output("acceleration", ("floor 1", "floor 2"))
FREQUENCIES = np.linspace(0.2, 2.5, 24)


@pytest.fixture(scope="module")
def predicted(tiny_result):
    return bs.load_predictions(tiny_result.directory, n_draws=60)


@pytest.fixture(scope="module")
def response_request():
    rng = np.random.default_rng(0)
    motions = tuple(bs.GroundMotion(rng.standard_normal(64), 0.05, name) for name in ("a", "b"))
    return ResponseRequest(OUTPUT, 0.02, FREQUENCIES, motions=motions)


@pytest.fixture(scope="module")
def responses(predicted, response_request):
    return [predict_responses(predicted, name, response_request) for name in ("average", "one k")]


@pytest.fixture
def out(tmp_path):
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


def test_responses_hold_the_bands_of_all_places(predicted, response_request, responses):
    average = predicted.of()
    for motion in response_request.motions:
        draws = average.time_histories(motion, OUTPUT, 0.02)
        np.testing.assert_allclose(
            responses[0].histories[motion.name].curves, draws.band(0.9), rtol=1e-9, atol=1e-12
        )
        peaks = np.quantile(np.abs(draws.draws).max(-1), [0.05, 0.5, 0.95], axis=0)
        np.testing.assert_allclose(responses[0].histories[motion.name].peaks, peaks, rtol=1e-9)
    draws = average.transfer_functions(FREQUENCIES, OUTPUT, 0.02)
    np.testing.assert_allclose(responses[0].transfer.curves, draws.band(0.9), rtol=1e-9)
    highest = np.quantile(draws.draws.max(-1), [0.05, 0.5, 0.95], axis=0)
    np.testing.assert_allclose(responses[0].transfer.peaks, highest, rtol=1e-9)


def test_transfer_functions_from_a_force(predicted):
    response_request = ResponseRequest(OUTPUT, 0.02, FREQUENCIES, force_at="floor 1")
    actual = predict_responses(predicted, "one k", response_request)
    own = predicted.of("one k")
    expected = own.transfer_functions(FREQUENCIES, OUTPUT, 0.02, force_at="floor 1")
    np.testing.assert_allclose(actual.transfer.curves, expected.band(0.9), rtol=1e-9)
    assert response_request.transfer_name == "acceleration / force at floor 1"
    assert response_request.transfer_unit == "1/mass"


def test_csv_files_hold_the_bands(responses, out):
    save_predictions(out, responses)
    assert sorted(path.name for path in out.iterdir()) == [
        "frequencies.csv", "mode_shapes.csv", "peaks.csv", "time_histories.csv",
        "transfer_functions.csv",
    ]  # fmt: skip
    actual = rows(out / "transfer_functions.csv")
    assert len(actual) == 2 * 2 * 24
    actual = rows(out / "time_histories.csv")
    assert len(actual) == 2 * 2 * 2 * 64
    assert [actual[i]["record"] for i in (0, -1)] == ["a", "b"]
    assert float(actual[1]["time_s"]) == 0.05
    peaks = [row for row in rows(out / "peaks.csv") if row["model_class"] == "average"]
    assert [(row["of"], row["unit"], row["place"]) for row in peaks] == [
        (of, unit, place)
        for of, unit in (("transfer function: acceleration / ground acceleration", "-"),
                         ("time history: a", "m/s²"), ("time history: b", "m/s²"))
        for place in OUTPUT.places
    ]  # fmt: skip
    assert float(peaks[3]["high"]) == pytest.approx(
        responses[0].histories["a"].peaks.high[1], rel=1e-6
    )
    modes = rows(out / "frequencies.csv")
    assert [(row["model_class"], row["mode"], row["share"]) for row in modes] == [
        ("average", "1", "1"), ("average", "2", "1"), ("one k", "1", "1"), ("one k", "2", "1"),
    ]  # fmt: skip
    # Before updating, at stiffness factors of 1: 1/φ and φ Hz.
    assert [float(row["before_hz"]) for row in modes[:2]] == pytest.approx([0.6180340, 1.6180340])
    shapes = [row for row in rows(out / "mode_shapes.csv") if row["model_class"] == "one k"]
    # The shape (1, φ), scaled to a largest component of 1.
    assert [float(row["median"]) for row in shapes[:2]] == pytest.approx([0.6180340, 1.0])
    with pytest.raises(FileExistsError):
        save_predictions(out, responses)


def test_what_is_not_asked_for_is_not_computed(predicted, out, monkeypatch):
    monkeypatch.setattr("bayes_ssi.plots.figure_style.save_figure", lambda _, path: path)
    ground_to_1 = bs.Output("drift", (("ground", "floor 1"),))
    actual = predict_responses(predicted, "each k", ResponseRequest(ground_to_1, 0.02, FREQUENCIES))
    assert actual.histories == {}
    save_predictions(out, [actual])
    assert not (out / "time_histories.csv").exists()
    assert "ground to floor 1" in "\n".join(printed(peak_table([actual])))
    drawn = save_prediction_figures(out / "figures", [actual])
    assert "time_histories" not in {path.stem for path in drawn}
    actual = predict_responses(predicted, "each k", ResponseRequest(OUTPUT, 0.02))
    assert actual.transfer is None
    drawn = save_prediction_figures(out / "again", [actual])
    assert drawn == []


def test_tables(predicted, responses):
    tables = frequency_table(responses), peak_table(responses)
    for table in tables:
        assert_every_cell_is_whole(table, 60)
    frequencies, peaks = ("\n".join(printed(table)) for table in tables)
    median = predicted.of().frequencies_hz("1").band().median
    assert f"{median:.4g}" in frequencies
    assert "0.618" in frequencies  # before
    assert peaks.count("floor 2") == 2 * 3


def test_figures(responses, tmp_path):
    drawn = save_prediction_figures(tmp_path / "figures", responses)
    assert [path.stem for path in drawn] == [
        "transfer_functions", "time_histories_1", "time_histories_2",
    ]  # fmt: skip
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)
    with pytest.raises(FileExistsError):
        save_prediction_figures(tmp_path / "figures", responses)


def test_defaults(predicted):
    average = predicted.of()
    assert default_output(average, "acceleration").places == ("floor 2",)
    assert default_output(average, "drift").places == (("ground", "floor 2"),)
    ratio, source = default_damping(predicted.data)
    assert (ratio, "assumed" in source) == (0.02, True)
    first, second = predicted.data.modes
    modes = replace(first, damping=0.01), replace(second, damping=0.03)
    ratio, source = default_damping(replace(predicted.data, modes=modes))
    assert (ratio, "identified" in source) == (pytest.approx(0.02), True)


def test_without_a_request_transfer_functions_at_the_top_are_predicted(predicted):
    of_default = bs.predict_responses(predicted)
    request = of_default.request
    assert request.output == default_output(predicted.of(), "acceleration")
    draws = predicted.of().transfer_functions(
        default_frequencies(predicted.data, request.damping), request.output, request.damping
    )
    np.testing.assert_allclose(of_default.transfer.curves.median, draws.band(0.9).median)
    assert of_default.histories == {}


def test_the_top_moves_along_with_the_ground(predicted, monkeypatch):
    structure = type(predicted.model_classes["one k"].structure)
    plain = structure.modal_model

    def one_direction(self, values):
        return plain(self, values)._replace(influence=np.array([1.0, 0.0]))

    monkeypatch.setattr(structure, "modal_model", one_direction)
    assert default_output(predicted.of(), "acceleration").places == ("floor 1",)

    def unknown(*_):
        raise TypeError("no masses")

    monkeypatch.setattr(structure, "modal_model", unknown)
    assert default_output(predicted.of(), "acceleration").places == ("floor 2",)


def test_default_frequencies_meet_every_peak(predicted):
    actual = default_frequencies(predicted.data, 0.02)
    assert (actual[0], actual[-1]) == predicted.data.band_hz
    # An oscillator's amplification at the first frequency, between its neighbours: 1/(2ζ) ± 0.2 %.
    lowest = predicted.data.modes[0].frequency_hz
    ratio = (actual[np.abs(actual - lowest).argmin()] + 0.5 * (actual[1] - actual[0])) / lowest
    assert 0.04 / np.hypot(1 - ratio**2, 0.04 * ratio) > 0.99
    assert len(default_frequencies(predicted.data, 1e-6)) == 6000
    for band in ((2.0, 1.0), (-1.0, 1.0), (0.0, np.inf), (np.nan, 1.0)):
        with pytest.raises(ValueError, match="band: must be two frequencies"):
            default_frequencies(predicted.data, 0.02, band)


def test_requests_need_frequencies_and_motions_of_different_names():
    with pytest.raises(ValueError, match="frequencies_hz must be"):
        ResponseRequest(OUTPUT, 0.02, [])
    motion = bs.GroundMotion([0.0, 1.0], 0.1, "quake")
    with pytest.raises(ValueError, match="two ground motions are named 'quake'"):
        ResponseRequest(OUTPUT, 0.02, motions=(motion, motion))
