"""The section "from records to modes": what was identified, and what classes make of it."""

from dataclasses import replace

import numpy as np
import pytest
from html_page import page_of
from identified_records import identified
from matplotlib.figure import Figure

import bayes_ssi as bs
from bayes_ssi.inference.model_class.configuration import failed_data_checks
from bayes_ssi.measurements.modes.identification_summary import EstimatedMode, Peak
from bayes_ssi.studies.ranking.comparison import Check
from bayes_ssi.studies.ranking.study import Ranking

RECORD = identified(
    "<tower>.csv",
    modes=(
        EstimatedMode(1.0, 0.002, 0.02, 0.003, 0.004),
        EstimatedMode(2.4, 0.001, 0.02, 0.003, 0.005),
        EstimatedMode(2.9, 0.001, 0.02, 0.003, 0.005),
    ),
    peaks=(
        Peak((1.0,), (0,), 0.0001, None, 0.05, 1.25),
        Peak((2.4, 2.9), (1, 2), 0.97, None, 0.15, 1.56),
    ),
    remarks=("sensor 'x': clipped",),
    doubts=("mode at 2.9 Hz: the methods differ",),
)


@pytest.fixture
def ranking(make_posterior):
    """Two classes with modes at 1 and 2.5 Hz; of the peak with two modes, one is in the data."""

    def ranking(*records):
        k = bs.Parameter("k", bs.LogNormal(40.0, 0.3))
        modes = (bs.IdentifiedMode("1", 1.0), bs.IdentifiedMode("2a", 2.4001))
        data = bs.ModalData(modes, (0.0, 4.0), identifications=records)
        building = bs.ShearBuilding((1.0, 1.0), (k, k))
        classes = [
            bs.ModelClass(name, building, data, bs.ErrorModel(0.02, 0.05), pairing=pairing)
            for name, pairing in (("both", {"1": 1, "2a": 2}), ("first", {"1": 1}))
        ]
        posteriors = tuple(
            make_posterior(each.name, -i, names=each.parameter_names, pairing=each.pairing,
                           data_digest=data.digest, frequencies_hz=np.full((4, 250, 2), [1.0, 2.5]))
            for i, each in enumerate(classes)
        )  # fmt: skip
        compared, study = bs.compare(posteriors), bs.Study("records", classes)
        result = Ranking(study, posteriors, compared, 0, bs.SamplingSettings())
        checks = [Check("data", words) for words in failed_data_checks(result.tests)]
        return replace(result, comparison=compared.with_checks(checks))

    return ranking


pytestmark = pytest.mark.usefixtures("no_drawings")


def rows_of(page):
    return [[" ".join(cell.split()) for cell in row] for row in page.rows]


def test_the_identification_is_shown_with_what_classes_make_of_its_peaks(ranking, tmp_path):
    page = page_of(ranking(RECORD), tmp_path / "r")
    for words in (
        "<tower>.csv: acceleration (m/s2) at 2 sensors (x, y), 600 s at 50 Hz.",
        "The Bayesian FFT is quoted; its spectral model, with independent loads, explains the "
        "record.",
        "mode at 2.9 Hz: the methods differ",
        "sensor 'x': clipped",
    ):
        assert words in page.text
    rows = rows_of(page)
    assert ["2a", "2.4", "0.1 %", "2 %", "0.3 %", "0.005"] in rows
    checks = {row[0].split()[0]: row[1:] for row in rows if row[2:3] and " " in row[2]}
    assert checks["whiteness:"] == ["1.02", "at most 1.25", "passed"]
    assert checks["length"] == ["6", "at least 1", "passed"]
    # The second model mode, 2.5 Hz, is nearer to the peak than could be told apart.
    assert ["1 (1 Hz)", "0.0001", "0.05", "1 → mode 1", "1 → mode 1"] in rows
    assert [
        "2a (2.4 Hz), left out (2.9 Hz)", "0.9700", "0.15", "2a → mode 2; 2.9 Hz left out",
        "2a spurious; 2.9 Hz left out; mode 2 (2.5 Hz) missed",
    ] in rows  # fmt: skip


def test_what_one_method_leaves_open_is_said(ranking, tmp_path):
    peaks = tuple(replace(peak, probability_of_two=None) for peak in RECORD.peaks)
    doubtful = replace(RECORD, whiteness=2.0, cycles_of_decay=0.5, peaks=peaks)
    other = replace(RECORD, whiteness=2.0, method="NExT-ERA")
    shown = page_of(ranking(RECORD, doubtful, other), tmp_path / "r").text
    parts = shown.split("Modes were sought from 0 to 4 Hz.")[1:]
    for words in ("does not explain the record", "failed: damping and shape left out", "not known"):
        assert [words in part for part in parts] == [False, True, False], words
    assert "NExT-ERA is quoted, near the modes of the Bayesian FFT." in parts[2]


def test_modes_that_are_not_identified_are_said_and_phases_with_the_peaks(ranking, tmp_path):
    peaks = (RECORD.peaks[0], replace(RECORD.peaks[1], probability_of_phases=0.25))
    seen = replace(RECORD, peaks=peaks, not_identified=((3.6, "its fit is not settled"),))
    page = page_of(ranking(seen), tmp_path / "r")
    section = page.text[page.text.index("Identified modes with the standard") :]
    assert "3.6 Hz: its fit is not settled" in section
    rows = rows_of(page)
    assert ["1 (1 Hz)", "0.0001", "not known", "0.05", "1 → mode 1", "1 → mode 1"] in rows
    assert [row[1:4] for row in rows if row[0] == "2a (2.4 Hz), left out (2.9 Hz)"] == [
        ["0.9700", "0.2500", "0.15"]
    ]
    first_screen = page.text[: page.text.index("What these numbers mean")]
    assert "3.6 Hz that is not identified (its fit is not settled)" in first_screen


def test_the_first_screen_says_what_failed_before_the_ranking(ranking, tmp_path):
    failed, sound = ranking(RECORD), ranking(replace(RECORD, doubts=()))
    check = "identified from <tower>.csv: mode at 2.9 Hz: the methods differ"
    assert failed.comparison.failed_checks == (check,)
    assert check in failed.study.model_classes[0].data.warnings()
    shown = page_of(failed, tmp_path / "r").text
    first_screen = shown[: shown.index("What these numbers mean")]
    assert "1 check of the identified modes failed: modes may be wrong or missing" in first_screen
    assert check in first_screen
    assert "All checks passed" not in shown
    assert sound.comparison.failed_checks == ()
    assert "All checks passed" in page_of(sound, tmp_path / "sound").text


def test_figures_are_copied_to_the_result(ranking, tmp_path):
    drawn = tmp_path / "drawn"
    drawn.mkdir()
    Figure(figsize=(2.5, 1.0)).savefig(drawn / "singular_values.png")
    gone = str(drawn / "shapes.png")
    with_figures = replace(RECORD, figures=(str(drawn / "singular_values.png"), gone))
    bs.save_result(ranking(with_figures), tmp_path / "r")
    (drawn / "singular_values.png").unlink()
    (kept,) = bs.load_result(tmp_path / "r").data.identifications
    own = tmp_path / "r" / "data.figures" / "1_singular_values.png"
    assert kept.figures == (str(own),)
    text = bs.write_report(tmp_path / "r").read_text("utf-8")
    assert text.count("<figure ") == 1
    assert "Singular values of the record" in text


def test_modes_of_unknown_origin_have_no_such_section(ranking, tmp_path):
    shown = page_of(ranking(), tmp_path / "r").text
    assert "From records to modes" not in shown
    assert not list((tmp_path / "r").glob("*identification*"))
