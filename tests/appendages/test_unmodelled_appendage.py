"""A ranking warns of an appendage that no class models, and of nothing else."""

import re
from dataclasses import replace

import pytest
from conftest import MODEL_CLASSES, kept_study
from searches import COARSE, exact_modes

import bayes_ssi as bs
from bayes_ssi.results.answer import first_screen
from bayes_ssi.studies.appendages import unmodelled as module
from bayes_ssi.studies.appendages.baselines import choose_baselines
from bayes_ssi.studies.appendages.unmodelled import appendage_checks, hidden_appendages

QUICK = bs.SamplingSettings(log_evidence_error=0.1, searches=2, effective_sample_size=400)
pytestmark = pytest.mark.usefixtures("screening_for_appendages")


@pytest.fixture
def screened_once(monkeypatch):
    """The hypotheses of a test are screened once, however often they are asked for."""
    known, screened = {}, module._screened

    def remembered(classes, *others):
        names = tuple(made.name for made in classes)
        if names not in known:
            known[names] = screened(classes, *others)
        return known[names]

    monkeypatch.setattr(module, "_screened", remembered)


def ranked(study, *names, settings=QUICK):
    chosen = kept_study(study)
    return bs.rank(chosen.only(names) if names else chosen, settings=settings)


def test_nothing_is_said_where_the_best_class_has_the_appendage(monkeypatch):
    """Approach 3: no further appendage would change a parameter by more than its interval."""
    monkeypatch.setattr(module, "PLACES_NEAR_A_MODE", 2)
    comparison = ranked("shear_building", "3", settings=COARSE).comparison
    assert not comparison.unmodelled_appendage
    assert not comparison.hidden_appendage


@pytest.mark.usefixtures("screened_once")
def test_what_an_appendage_would_change_that_shows_no_second_mode(monkeypatch):
    """f1, f2a and f3 alone: nothing is spurious, and k2 is 13 % too stiff (true value 1)."""
    (first, *_) = kept_study("shear_building").model_classes
    modes = tuple(mode for mode in first.data.modes if mode.label != "2b")
    made = replace(first, configurations=(
        replace(first.configurations[0], data=replace(first.data, modes=modes)),))  # fmt: skip
    ranking = bs.rank(bs.Study("f1, f2a and f3", [made]), settings=QUICK)
    assert ranking.comparison.failed_checks == ()
    near = {each.label: each for each in hidden_appendages(ranking, bs.Run())}
    before, (low, middle, high) = near["2a"].changed["k2"]
    assert before == pytest.approx(1.13, abs=0.01)
    assert low < 1.0 < high
    assert middle < 1.09
    assert list(near) == ["1", "2a"]
    assert near["2a"].probability > near["1"].probability > 0.0
    said = ranking.comparison.hidden_appendage
    assert said == " ".join(map(str, near.values()))
    assert said in " ".join(first_screen(ranking).split())
    # Of one that is improbable nothing is said, whatever it would change.
    monkeypatch.setattr(module, "_nats", lambda *_: -7.0)
    assert hidden_appendages(ranking, bs.Run()) == []
    monkeypatch.setattr(module, "_nats", lambda *_: -1.0)
    assert [each.label for each in hidden_appendages(ranking, bs.Run())] == ["1", "2a"]


@pytest.mark.usefixtures("screened_once")
def test_a_test_of_torsion_alone_has_no_places_of_appendages():
    """Bending and torsion are configurations; the structure of the latter has other places."""
    k, kt = (bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in ("k", "kt"))
    both = ((100.0 * k,) * 2, (121.0 * k,) * 2, (1e6,) * 2)
    bending = bs.ShearBuilding3D((1.0,) * 2, (1.0,) * 2, *both)
    torsion = bs.ShearBuilding((1.0,) * 2, (300.0 * kt,) * 2)

    def test(name, structure):
        frequencies = structure.modes(structure.prior_medians()).frequencies_hz[0]
        seen = [hz for hz in frequencies.tolist() if hz < 6.0]
        modes = tuple(bs.IdentifiedMode(f"{name} {i}", hz) for i, hz in enumerate(seen, 1))
        pairing = {mode.label: i for i, mode in enumerate(modes, 1)}
        return bs.Configuration(name, structure, bs.ModalData(modes, (0.0, 6.0)), pairing=pairing)

    tests = [test("bending", bending), test("torsion", torsion)]
    made = bs.ModelClass("frame", configurations=tests, error=bs.ErrorModel(0.01))
    ranking = bs.rank(bs.Study("frame", [made]), settings=COARSE)
    assert {each.label.split()[0] for each in hidden_appendages(ranking, bs.Run())} <= {"bending"}
    near = module._places_near(choose_baselines(ranking.study), made, ranking.posteriors[0])
    assert list(near) == ["bending 1", "bending 2", "bending 3", "bending 4"]


def test_a_known_appendage_elsewhere_does_not_silence_the_warning():
    (bare,) = kept_study("bare_building").model_classes
    antenna = bare.structure.with_element(bs.Pendulum(3, 0.01, 7.5, label="antenna"))
    made = replace(bare, configurations=(replace(bare.configurations[0], structure=antenna),))
    comparison = bs.rank(bs.Study("with an antenna", [made]), settings=COARSE).comparison
    assert comparison.unmodelled_appendage.startswith("modes '2a' and '2b'")


@pytest.mark.usefixtures("no_drawings")
def test_the_warning_comes_first_and_fails(run):
    """The paper's numerical study: 1-a fits perfectly with stiffnesses that are 10 % off."""
    result = run("rank", MODEL_CLASSES / "shear_building.py", "--class", "1-a", "--class", "2",
                 "--error", "0.1", "--out", "out")  # fmt: skip
    assert result.exit_code == 3
    warning = result.stdout.index("(!) The data look as if an appendage split a mode")
    assert warning < result.stdout.index("log evidence")
    assert "the answer may be among wrong" in " ".join(result.stdout.split())
    stored = bs.load_result("out").comparison
    assert stored.best.name == "1-a"
    text = stored.unmodelled_appendage
    assert text.startswith("modes '2a' and '2b' (15 % apart, MAC 0.92) look like one that")
    assert "most probably an infill between floors 1 and 2" in text
    assert text.endswith("ask with a search for appendages")
    assert stored.failed_checks == (text,)


def test_a_spurious_mode_is_no_appendage(monkeypatch):
    """A bare building's own modes, and one that has nothing to do with it."""
    (bare,) = kept_study("bare_building").model_classes
    data = exact_modes(bare.structure, bare.data.sensors, (0.0, 6.0))
    odd = bs.IdentifiedMode("odd", 1.7, (0.9, -0.3, 0.3))
    data = replace(data, modes=(data.modes[0], odd, *data.modes[1:]))
    monkeypatch.setattr(module, "hidden_appendages", lambda *_: [])
    ranking = bs.rank(bs.Study("one", [replace(bare, data=data)]), settings=COARSE)
    assert set(ranking.posteriors[0].configurations[0].pairing) == {"1", "2", "3"}
    assert not ranking.comparison.unmodelled_appendage


def test_a_mode_that_looks_split_is_said_without_screening_where_that_is_slow(monkeypatch):
    monkeypatch.setattr(module, "is_cheap", lambda _: False)
    ranking = ranked("bare_building", settings=COARSE)
    (check,) = appendage_checks(ranking, bs.Run())
    assert check.words.endswith("which 'bare frame' lacks; ask with a search for appendages")
    # Either of two modes may be the spurious one.
    said = " ".join(first_screen(ranking).split())
    assert re.search(r"in the most probable pairing \(probability 0\.5\d+\), and takes", said)


def test_a_class_with_an_appendage_is_no_rival_without_any():
    """Searched from the bare frame, "3 M3+" would beat it by carrying what is searched."""
    chosen = choose_baselines(kept_study("steel_frame"), ["2 M3"])
    assert [each.name for each in chosen.classes] == ["2 M3"]
    names = {each.name for each in chosen.rivals}
    assert names
    assert not any("+" in name for name in names)
