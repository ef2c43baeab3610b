"""The map of hidden appendages that nobody would notice."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import MODEL_CLASSES, kept_study, succeeded

import bayes_ssi as bs
from bayes_ssi.plots.figure_style import figures_for_files
from bayes_ssi.plots.place_plots import plot_blind_spots
from bayes_ssi.studies.appendages import hidden_cases as module

STUDY = MODEL_CLASSES / "bare_building.py"
# Of a uniform three-storey building of unit masses, with its first mode at 1 Hz.
STIFFNESS = (np.pi / np.sin(np.pi / 14.0)) ** 2
FLOORS = module._Test(("floor 1", "floor 2", "floor 3"), (0.0, 6.0))


@pytest.fixture(scope="module")
def spots():
    """A pendulum of a tenth of a floor's mass on floor 2, at the third of four frequencies."""
    all_cases = module._cases

    def cases(*arguments):
        return (each for each in all_cases(*arguments) if 2.0 < each[0].frequency_hz < 7.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "MASSES", (0.1,))
        patch.setattr(module, "ROUGH", replace(module.ROUGH, economical=True))
        patch.setattr(module, "_cases", cases)
        return bs.blind_spots(
            kept_study("bare_building"), candidates=[bs.Candidate("2", 2)], n_frequencies=4
        )


def modes_with_pendulum(stiffness, mass, hz):
    """Frequencies and shapes (m, 3) of three equal floors, a pendulum on the second, by hand."""
    k, a = stiffness, mass * (2.0 * np.pi * hz) ** 2
    of_frame = [[2 * k, -k, 0, 0], [-k, 2 * k + a, -k, -a], [0, -k, k, 0], [0, -a, 0, a]]
    half = np.diag([1.0, 1.0, 1.0, mass**-0.5])
    values, vectors = np.linalg.eigh(half @ of_frame @ half)
    return np.sqrt(values) / (2.0 * np.pi), (half @ vectors)[:3].T


def real_of(hz, shapes):
    """Modes of frequencies (m,) and shapes (m, 3) at the floors."""
    return module._Real(hz, dict(zip(FLOORS.sensors, shapes.T, strict=True)))


def test_the_table_has_the_modes_of_the_structure_with_the_appendage(spots):
    hz, shapes = modes_with_pendulum(STIFFNESS, 0.1, 3.0)
    data = real_of(hz, shapes).table(FLOORS, 3, {"frequency_cov": 0.01})
    assert data.labels == ("1", "2", "4")
    assert data.frequencies_hz == pytest.approx(hz[[0, 1, 3]])
    assert spots.frequencies_hz == pytest.approx(
        [np.sin(i * np.pi / 14.0) / np.sin(np.pi / 14.0) for i in (1, 3, 5)]
    )


@pytest.mark.parametrize(("own", "missed"), [(0, [1, 2]), (1, [2, 3]), (2, [3])])
def test_modes_that_may_be_missed_bracket_the_structures_own(own, missed):
    """An appendage's eigenvalues and the structure's interlace; one is above the band."""
    hz, shapes = modes_with_pendulum(STIFFNESS, 0.1, 5.9)
    bare = np.sqrt(STIFFNESS) / np.pi * np.sin(np.array([1, 3, 5]) * np.pi / 14.0)
    assert hz[own] < bare[own] < hz[own + 1]
    real = real_of(hz, shapes)
    assert real.pair(own, FLOORS) == missed
    assert real.pair(own, FLOORS._replace(band_hz=(0.0, 9.0))) == [own + 1, own + 2]


def test_modes_that_hardly_move_a_sensor_are_not_in_the_table():
    shapes = np.outer([1.0, 0.04, 0.06], np.ones(3))
    assert real_of(np.array([1.0, 2.0, 3.0]), shapes).seen(FLOORS) == [1, 3]


def test_what_the_appendage_does_to_the_stiffness_and_where_nothing_is_said(spots):
    blind = {(case.missed, case.parameter): case for case in spots.blind}
    assert set(blind) == {(3, "k2")}
    case = blind[3, "k2"]
    assert case.frequency_hz == pytest.approx(0.4914 * (7.5 / 0.4914) ** (2 / 3), rel=1e-3)
    assert case.error > 0.1
    said = [case for case in spots.cases if case.warning]
    assert {case.missed for case in said} >= {0}
    assert all(abs(case.error) > module.WRONG for case in said)
    assert spots.n_tried == 1
    assert list(spots.remedies) == ["a band to 9.38 Hz"]


def test_the_structure_carries_the_appendage_besides_its_own_mass():
    study = kept_study("bare_building")
    baselines = module.choose_baselines(study, candidates=[bs.Candidate("2", 2)])
    (best,) = baselines.classes
    (scale,) = {each.mass for each in baselines.scales.values()}
    own = best.structure.modes(best.structure.prior_medians()).frequencies_hz[0]
    for case, real in module._cases(baselines, FLOORS, (), own, 3):
        by_hand, shapes = modes_with_pendulum(STIFFNESS, case.mass / scale, case.frequency_hz)
        assert real.frequencies_hz == pytest.approx(by_hand, rel=1e-6)
        macs = np.sum(real.shapes(FLOORS).T * shapes, axis=1) ** 2
        lengths = np.sum(real.shapes(FLOORS) ** 2, axis=0) * np.sum(shapes**2, axis=1)
        assert macs == pytest.approx(lengths, rel=1e-6)


def test_the_papers_analyst_is_wrong_and_warned_or_has_a_blind_spot(monkeypatch):
    """k = 0.917, 1.131, 0.901 where all are 1 (paper, approach 1-a).

    Section 3.1: an infill between floors 1 and 2 as mass, whose other mode is not identified.
    """
    (rigid, *_) = kept_study("shear_building").model_classes
    modes = [mode for mode in rigid.data.modes if mode.label != "2b"]
    shapes = np.array([mode.unit_shape for mode in modes])
    real = real_of(np.array([mode.frequency_hz for mode in modes]), shapes)
    best, case = rigid.with_any_pairing("rigid"), module.HiddenCase("infill 1-2", 0.075, 2.8, 0)
    monkeypatch.setattr(module, "ROUGH", replace(module.ROUGH, economical=True))
    judged = module._judged(best, FLOORS, (case, real))
    assert judged.parameter == "k2"
    assert judged.error == pytest.approx(0.131, abs=0.015)
    assert judged.warning.startswith("If an appendage that no mode of the table shows")
    assert not judged.is_blind
    monkeypatch.setattr(module, "appendage_checks", lambda *_: ())
    assert module._judged(best, FLOORS, (case, real)).is_blind


def test_a_study_of_several_classes_and_medians_of_zero_are_refused():
    (bare,) = kept_study("bare_building").model_classes
    other = replace(bare, name="other", error=bs.ErrorModel(frequency_cov=0.02, shape_sd=0.05))
    with pytest.raises(ValueError, match="of one model class; choose one of 'bare frame', 'other'"):
        bs.blind_spots(bs.Study("two", [bare, other]))
    terms = [(1.0, 400.0 * np.eye(3)), (bs.Parameter("k1", bs.Uniform(-1.0, 1.0)), np.eye(3))]
    structure = bs.MatrixStructure(terms, np.eye(3), n_modes=3, labels=FLOORS.sensors)
    softer = replace(bare, configurations=[replace(bare.configurations[0], structure=structure)])
    with pytest.raises(ValueError, match="the prior median of 'k1' is zero, and relative errors"):
        bs.blind_spots(bs.Study("one", [softer]))


def test_the_command_prints_and_saves_the_map(run, tmp_path, spots, monkeypatch):
    above = replace(spots.cases[0], frequency_hz=7.5, error=0.0, warning="")
    spots = replace(spots, cases=(*spots.cases, above))
    monkeypatch.setattr(module, "blind_spots", lambda *_, **__: spots)
    done = succeeded(run("blind-spots", STUDY, "--out", tmp_path / "map"))
    printed = " ".join(done.stdout.split())
    n = len(spots.cases)
    assert f"1 of {n} cases ({100 / n:.1f} %) leave a parameter off by more than 10 %" in printed
    assert "1 of them where one mode of the two is not in the table. The worst: k2 +" in printed
    assert "Removed of 1 blind spots that were tried again: by a band to 9.38 Hz" in printed
    assert len(json.loads((tmp_path / "map" / "blind_spots.json").read_text("utf-8"))["cases"]) == n
    assert (tmp_path / "map" / "blind_spots.png").stat().st_size > 1000
    with figures_for_files():
        (cells,) = plot_blind_spots(spots).axes[0].collections
    first = spots.cases[0].frequency_hz
    edges = first * (7.5 / first) ** np.array([-0.5, 0.5, 1.5])  # halfway between the frequencies
    np.testing.assert_allclose(cells.get_coordinates()[0, :, 0], edges)
