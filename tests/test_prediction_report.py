"""Answers from a stored result: tables, CSV files and figures."""

import csv

import matplotlib as mpl
import numpy as np
import pytest
from rich.console import Console

from bayes_ssi.ground_motion import GroundMotion
from bayes_ssi.prediction_figures import save_prediction_figures
from bayes_ssi.prediction_report import (
    Question,
    answer,
    frequency_table,
    peak_table,
    save_tables,
)
from bayes_ssi.response import Output
from bayes_ssi.results import save_result
from bayes_ssi.stored_predictions import load_predictions

mpl.use("Agg")

OUTPUT = Output("acceleration", ("floor 1", "floor 2"))
FREQUENCIES = np.linspace(0.2, 2.5, 24)


@pytest.fixture
def predicted(tiny_ranking, tmp_path, tiny_study_file):
    saved = save_result(tiny_ranking, tmp_path / "result", study_file=str(tiny_study_file))
    return load_predictions(saved.directory, n_draws=60)


@pytest.fixture
def question():
    motion = GroundMotion(np.random.default_rng(0).standard_normal(64), 0.05)
    return Question(OUTPUT, 0.02, FREQUENCIES, motion, level=0.9)


@pytest.fixture
def answers(predicted, question):
    return [answer(predicted, name, question) for name in ("average", "one k")]


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def printed(table):
    console = Console(width=80)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def test_csv_files_hold_the_bands(predicted, question, answers, tmp_path):
    files = save_tables(predicted, answers, tmp_path / "out")
    assert [path.name for path in files] == [
        "frequencies.csv", "peaks.csv", "time_histories.csv", "transfer_functions.csv",
    ]  # fmt: skip
    average = predicted.average()
    found = rows(tmp_path / "out" / "transfer_functions.csv")
    assert len(found) == 2 * 2 * 24
    band = average.transfer_functions(FREQUENCIES, OUTPUT, 0.02).band(0.9)
    second_place = [
        row for row in found if (row["model_class"], row["place"]) == ("average", "floor 2")
    ]
    for column, expected in zip(("low", "median", "high"), band, strict=True):
        np.testing.assert_allclose(
            [float(row[column]) for row in second_place], expected[1], rtol=1e-5
        )
    found = rows(tmp_path / "out" / "time_histories.csv")
    assert len(found) == 2 * 2 * 64
    assert float(found[1]["time_s"]) == 0.05
    peaks = rows(tmp_path / "out" / "peaks.csv")
    band = average.peak_responses(question.motion, OUTPUT, 0.02).band(0.9)
    assert float(peaks[1]["high"]) == pytest.approx(band.high[1], rel=1e-5)
    modes = rows(tmp_path / "out" / "frequencies.csv")
    assert [(row["model_class"], row["mode"], row["share"]) for row in modes] == [
        ("average", "1", "1"), ("average", "2", "1"), ("one k", "1", "1"), ("one k", "2", "1"),
    ]  # fmt: skip
    with pytest.raises(FileExistsError):
        save_tables(predicted, answers, tmp_path / "out")


def test_without_a_ground_motion_there_are_transfer_functions_only(predicted, tmp_path):
    question = Question(Output("drift", (("ground", "floor 1"),)), 0.02, FREQUENCIES)
    found = answer(predicted, "each k", question)
    assert found.time_histories is found.peaks is None
    files = save_tables(predicted, [found], tmp_path / "out")
    assert [path.name for path in files] == ["frequencies.csv", "transfer_functions.csv"]
    assert "ground to floor 1" in printed(peak_table([found]))
    drawn = save_prediction_figures(tmp_path / "out", predicted.stored.data, [found])
    assert "time_histories" not in {path.stem for path in drawn}


def test_tables_fit_a_terminal(predicted, answers):
    frequencies = printed(frequency_table(predicted, answers))
    peaks = printed(peak_table(answers))
    assert max(map(len, (frequencies + peaks).splitlines())) <= 80
    median = predicted.average().frequencies_hz("1").quantile(0.5)
    assert f"{median:.4g}" in frequencies
    assert peaks.count("floor 2") == 2


def test_figures(predicted, answers, tmp_path):
    drawn = save_prediction_figures(tmp_path, predicted.stored.data, answers)
    assert [path.stem for path in drawn] == [
        "transfer_functions", "time_histories", "mode_shapes", "mac", "frequency_change",
    ]  # fmt: skip
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)


@pytest.mark.parametrize(
    ("damping", "frequencies", "level", "message"),
    [
        (0.0, FREQUENCIES, 0.9, "damping must be"),
        ((0.02, 1.0), FREQUENCIES, 0.9, "damping must be"),
        (0.02, [], 0.9, "frequencies_hz must be"),
        (0.02, FREQUENCIES, 1.0, "level must lie"),
    ],
)
def test_questions_that_make_no_sense(damping, frequencies, level, message):
    with pytest.raises(ValueError, match=message):
        Question(OUTPUT, damping, frequencies, level=level)


def test_unknown_classes_and_places(predicted, question):
    with pytest.raises(ValueError, match="no model class 'x'; choose from 'one k', 'each k'"):
        answer(predicted, "x", question)
    roof = Question(Output("displacement", ("roof",)), 0.02, FREQUENCIES)
    with pytest.raises(ValueError, match=r"place 'roof': .* choose from 'floor 1', 'floor 2'"):
        answer(predicted, "average", roof)
