"""The section "from records to modes", and the agreement of sensors in closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from html_page import of_two_storeys, page_of
from identified_records import identified
from matplotlib.figure import Figure

import bayes_ssi as bs
from bayes_ssi.inference.model_class.configuration import failed_data_checks
from bayes_ssi.measurements.modes.identification_summary import EstimatedMode, Peak
from bayes_ssi.report.page_content import auto_mac, co_mac
from bayes_ssi.structures.modal import comac
from bayes_ssi.studies.ranking.comparison import Check

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
        modes = (bs.IdentifiedMode("1", 1.0), bs.IdentifiedMode("2a", 2.4001))
        data = bs.ModalData(modes, (0.0, 4.0), identifications=records)
        result = of_two_storeys(
            make_posterior, data, (0.0, -1.0), {"both": {"1": 1, "2a": 2}, "first": {"1": 1}},
            frequencies_hz=np.full((4, 250, 2), [1.0, 2.5]),
        )  # fmt: skip
        checks = [Check("data", words) for words in failed_data_checks(result.tests)]
        return replace(result, comparison=result.comparison.with_checks(checks))

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
    assert kept.figures == (str(tmp_path / "r" / "data.figures" / "1_singular_values.png"),)
    text = bs.write_report(tmp_path / "r").read_text("utf-8")
    assert text.count("<figure ") == 1
    assert "Singular values of the record" in text


def test_modes_of_unknown_origin_have_no_such_section(ranking, tmp_path):
    assert "From records to modes" not in page_of(ranking(), tmp_path / "r").text
    assert not list((tmp_path / "r").glob("*identification*"))


def turned(degrees):
    angle = np.radians(degrees)
    return np.array([np.cos(angle), np.sin(angle)])


def data_of(shapes, sensors=("a", "b")):
    modes = tuple(bs.IdentifiedMode(str(i), float(i), shape) for i, shape in enumerate(shapes, 1))
    return bs.ModalData(modes, (0.0, 10.0), sensors)


def test_auto_mac_is_the_squared_cosine_of_the_angle_between_shapes():
    found = auto_mac(data_of([turned(0), turned(60), None, turned(75)]))
    assert found["labels"] == ["1", "2", "4"]
    cosines = np.cos(np.radians([[0, 60, 75], [60, 0, 15], [75, 15, 0]]))
    np.testing.assert_allclose(found["matrix"], cosines**2, atol=1e-12)
    assert "cannot tell apart modes 2 and 4 (MAC 0.93): their" in found["sentence"]
    apart = auto_mac(data_of([turned(0), turned(60), turned(100)]))
    words = "tell all modes apart: the most alike are 2 and 3 (MAC 0.59)."
    assert apart["sentence"].endswith(words)
    # Shapes that cannot be compared.
    assert auto_mac(data_of([turned(0), None])) is None
    found = auto_mac(data_of([[1.0, np.nan], [np.nan, 1.0]]))
    assert found["sentence"] == "No two modes were measured at a common sensor."


def test_comac_of_two_modes_is_a_squared_cosine():
    """Of rows (cos α, sin α) and (cos β, sin β), of any signs: cos²(α - β)."""
    shapes, others = np.array([turned(20), turned(45)]), np.array([turned(50), turned(45)])
    others[:, 1] *= -1.0
    np.testing.assert_allclose(comac(shapes, others), [np.cos(np.radians(30)) ** 2, 1.0])


def test_sensors_at_odds_with_the_model_are_named():
    """Modes 1 and 2 of the data are the model's 2 and 1."""
    measured = [0.8, 0.6], [0.6, -0.8]
    scatter = 1.0 + 0.01 * np.random.default_rng(5).normal(size=(400, 2, 2))
    draws = scatter * [[0.6, 0.8], [-0.8, 0.6]]
    modes = SimpleNamespace(pairing={"1": 2, "2": 1})
    found = co_mac(data_of([*measured, None]), modes, draws)
    assert found["sentence"].startswith("No sensor is at odds with the model: the smallest is 1")
    # Where the model moves b in one mode alone: the share of that mode, 0.6², in what is measured.
    draws[:, 1, 0] = 0.0
    found = co_mac(data_of([*measured, None]), modes, draws)
    (name, three), (other, _) = found["rows"]
    assert (name, other) == ("b", "a")
    np.testing.assert_allclose(three, 0.36)
    assert found["sentence"] == "Model and measurement are at odds at b (0.36)."
    assert co_mac(data_of([measured[0], None]), modes, draws) is None
    # A test of one sensor: its model has no shapes, for a single component says nothing of them.
    assert co_mac(data_of([[1.0], [1.0]], ("a",)), modes, np.full((20, 1, 2), np.nan)) is None


def test_sensors_that_no_paired_mode_was_measured_at_have_no_comac():
    shapes = [np.array([0.6, 0.8, np.nan]), np.array([0.8, -0.6, np.nan]), [0.0, 0.0, 1.0]]
    draws = np.stack([np.array([[0.6, 0.8, 0.3], [0.8, -0.6, 0.1]]).T] * 20)
    modes = SimpleNamespace(pairing={"1": 1, "2": 2})
    found = co_mac(data_of(shapes, ("a", "b", "c")), modes, draws)
    assert {name for name, _ in found["rows"]} == {"a", "b"}
    for _, three in found["rows"]:
        np.testing.assert_allclose(three, 1.0)
