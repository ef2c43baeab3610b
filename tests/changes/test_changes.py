"""Between two tests: whether anything changed, where and by how much; and what would be seen."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import FLOORS, assert_one_line_error, assert_refused, succeeded
from searches import COARSE as OF_FEW
from searches import exact_modes

import bayes_ssi as bs
from bayes_ssi.report.tables.layout import MOST_PLACES
from bayes_ssi.report.tables.search_tables import search_notes
from bayes_ssi.results.search_answer import further_sentences, search_sentences, search_verdict
from bayes_ssi.structures.changed_structure import ChangedStructure, Loss
from bayes_ssi.studies.changes import visible_loss
from bayes_ssi.studies.changes.change_search import change_record, without_influence
from bayes_ssi.studies.changes.changes_family import choose_changes, moved_alike, risen
from bayes_ssi.studies.changes.kinds_of_change import AppearedAppendage, ChangePlace, element_places
from bayes_ssi.studies.changes.visible_loss import (
    log_bayes_factor,
    simulated_tests,
    smallest_loss,
    smallest_losses,
)
from bayes_ssi.studies.search.family_search import FamilySearch, screened_hypotheses

pytestmark = pytest.mark.usefixtures("quick_screening")
COARSE = replace(OF_FEW, particles=100)  # for up to a dozen parameters
K = (2.0 * np.pi) ** 2
NAMES = ("k1", "k2", "k3")
PRIOR = bs.LogNormal(1.0, 0.1)
BUILDING = bs.ShearBuilding((1.0,) * 3, [K * bs.Parameter(name, PRIOR) for name in NAMES])
ERROR = bs.ErrorModel(bs.Parameter("frequency_cov", bs.LogNormal(0.01, 0.5)), 0.01)


def identified(structure=BUILDING, stiffnesses=None, rng=None, labels=("1", "2", "3")):
    """The modes of the building, or of it with elements; with errors if ``rng`` is given."""
    sizes = {"frequency_cov": 0.002, "shape_sd": 0.01}
    data = exact_modes(structure, FLOORS, (0.0, 3.0), values=stiffnesses, **sizes)
    scatter = np.zeros((len(labels), 4)) if rng is None else rng.standard_normal((len(labels), 4))
    modes = [
        replace(mode, label=label, frequency_hz=mode.frequency_hz * (1.0 + 0.002 * own[0]),
                shape=mode.unit_shape + 0.01 * own[1:])
        for mode, label, own in zip(data.modes, labels, scatter, strict=True)
    ]  # fmt: skip
    return replace(data, modes=tuple(modes))


def model_class(**tests):
    """The building with these tests: name → modes, of which "new" is no mode of the building."""
    configurations = []
    for name, data in tests.items():
        own = [label for label in data.labels if label != "new"]
        pairing = {label: i for i, label in enumerate(own, 1)}
        configurations.append(bs.Configuration(name, BUILDING, data, pairing=pairing))
    return bs.ModelClass("building", error=ERROR, configurations=configurations)


SAME = identified()
TWO = model_class(a=SAME, b=SAME)


def test_changes_of_a_reduced_model_are_those_of_the_whole():
    """A chain of twelve masses in three groups of springs, the second 20 % softer afterwards."""
    springs, floors = np.eye(12) - np.eye(12, k=-1), tuple(f"floor {i}" for i in range(1, 13))
    groups = springs.T.reshape(12, 3, 4).swapaxes(0, 1) * 4.0 * np.sqrt(K)
    terms = [(bs.Parameter(name, PRIOR), g @ g.T) for name, g in zip(NAMES, groups, strict=True)]
    sensors = floors[3::4]
    whole = bs.MatrixStructure(terms, np.eye(12), up_to_hz=3.0, sensors=sensors, labels=floors)
    sizes = {"frequency_cov": 0.002, "shape_sd": 0.01}
    tests = {
        name: exact_modes(whole, sensors, (0.0, 3.0), 3, (1.0, k2, 1.0), **sizes)
        for name, k2 in (("before", 1.0), ("after", 0.8))
    }
    pairing = {"1": 1, "2": 2, "3": 3}
    one = bs.ChangeSettings(number_weights=(1.0, 1.0), losses_only=True)
    answers = []
    for structure in (whole, whole.reduced()):
        made = [bs.Configuration(*test, pairing=pairing) for test in
                ((name, structure, data) for name, data in tests.items())]  # fmt: skip
        chain = bs.ModelClass("chain", error=ERROR, configurations=made)
        answers.append(
            bs.changes(chain, ["before"], ["after"], one, settings=COARSE, visible=False).record
        )
    of_whole, of_reduced = (
        {row.name: row.log_evidence for row in record.hypotheses} for record in answers
    )
    assert max(of_whole, key=of_whole.get) == "k2"
    assert of_reduced == pytest.approx(of_whole, abs=0.05)
    of_whole, of_reduced = (record.place("k2").amounts["loss, k2"] for record in answers)
    assert of_reduced == pytest.approx(of_whole, abs=0.002)
    assert of_reduced[0] < 0.2 < of_reduced[2]


@pytest.fixture(scope="module")
def of_second_storey():
    """Storey 2 lost 30 % of its stiffness."""
    rng = np.random.default_rng(1)
    before, after = (identified(stiffnesses=(1.05, k2, 1.0), rng=rng) for k2 in (0.95, 0.665))
    tests = model_class(before=before, after=after)
    one = bs.ChangeSettings(number_weights=(1.0, 1.0), losses_only=True)
    return bs.changes(tests, ["before"], ["after"], one, settings=COARSE, visible=False)


def test_the_storey_that_lost_stiffness_is_found_and_how_much(of_second_storey):
    record = of_second_storey.record
    assert record.probability_of_any > 0.99
    assert [change.place.name for change in record.hypotheses[0].features] == ["k2"]
    assert record.place("k2").probability > 0.9
    assert sum(each.probability for each in record.hypotheses) == pytest.approx(1.0)
    ((low, middle, high),) = record.place("k2").amounts.values()
    assert low < 0.3 < high
    assert middle == pytest.approx(0.3, abs=0.03)


def test_the_share_of_errors_is_inferred_and_said(of_second_storey):
    low, _, high = of_second_storey.record.shared
    assert 0.0 < low < high < 1.0
    words = of_second_storey.summary()
    assert "That something changed between 'before' and 'after' is virtually certain" in words
    assert "would be taken for a change" in words
    further = " ".join(further_sentences(of_second_storey.record))
    assert "of the errors of the model, which is wrong in the same way before and after" in further
    assert "not considered" not in further  # losses alone were asked for


def changed_by(*elements, labels=("1", "2", "3"), rng_seed=1):
    """Modes of the building with elements on it, with errors."""
    structure = BUILDING
    for element in elements:
        structure = structure.with_element(element)
    return identified(structure, rng=np.random.default_rng(rng_seed), labels=labels)


WITH_NEW = changed_by(bs.Pendulum(3, 0.05, 1.2), labels=("1", "2", "new", "3"))


def screened_changes(after, before=None, losses_only=False, structure=BUILDING):
    """The hypotheses of one change, by probability, from their approximate evidences."""
    tests = model_class(a=before or changed_by(rng_seed=2), b=after)
    settings = bs.ChangeSettings(number_weights=(1.0, 1.0), losses_only=losses_only)
    tests = tests.with_structures(lambda *_: structure)
    family = choose_changes(bs.Study("s", [tests]), ["a"], ["b"], settings)
    hypotheses, levels = screened_hypotheses(family, 0, bs.Run(), most_full=0)
    none = SimpleNamespace(posteriors=(), comparison=SimpleNamespace(classes=()))
    return change_record(family, FamilySearch(none, tuple(hypotheses.values()), tuple(levels)))


def test_exactly_the_same_modes_show_no_change():
    record = screened_changes(SAME, SAME, losses_only=True)
    assert record.probability_of_any < 0.05
    assert record.hypotheses[0].name == "nothing changed"
    assert "That nothing changed" in search_verdict(record)
    # Where it would be is said from a hundredth on.
    is_said = "If anything changed, it is most probably" in " ".join(search_sentences(record, None))
    assert is_said == (record.probability_of_any >= 0.01)


def test_a_common_loss_is_no_change():
    """Three per cent of all stiffnesses, as by temperature; exact modes."""
    # Considered since all frequencies fell alike.
    record = screened_changes(identified(stiffnesses=(0.97, 0.97, 0.97)), SAME, losses_only=True)
    assert record.hypotheses[0].name == "all in common"
    assert record.probability_of_any < 0.2
    (common,) = [each for each in record.places if each.place.is_common]
    ((low, _, high),) = common.amounts.values()
    assert low < 0.03 < high
    words = " ".join(search_sentences(record, None))
    assert "counts as no change" in words
    assert "All 3 frequencies that both sides have fell by 1.5 to 1.5 %" in words


def test_a_mass_that_came_is_found_as_one():
    """A tenth of a floor's mass on floor 2."""
    record = screened_changes(changed_by(bs.AddedMass(0.1, [(2, 1.0)])))
    assert record.hypotheses[0].name == "mass on floor 2"
    assert record.kinds["a mass"] > 0.9
    assert "An appendage that came or went was not" in " ".join(further_sentences(record))
    ((low, _, high),) = record.place("mass on floor 2").amounts.values()
    assert low < 0.1 < high
    assert high - low < 0.08


def test_an_appendage_that_appeared_is_found_by_the_mode_that_is_new():
    """Five hundredths of a floor's mass at 1.2 Hz, beside the second mode."""
    record = screened_changes(WITH_NEW)
    assert record.hypotheses[0].name == "appendage on floor 3, mode new"
    assert record.kinds["an appendage"] > 0.99
    ((low, _, high),) = record.place("appendage on floor 3, mode new").amounts.values()
    assert low < 0.05 < high


def test_frequencies_that_no_loss_mass_or_appendage_explains_are_something_else():
    """The highest rises by a fifth, the lowest falls by a fifth; shapes are as they were."""
    same = changed_by()
    modes = [
        replace(mode, frequency_hz=factor * mode.frequency_hz)
        for mode, factor in zip(same.modes, (0.8, 1.0, 1.2), strict=True)
    ]
    record = screened_changes(replace(same, modes=tuple(modes)))
    assert record.hypotheses[0].name == "something else"
    assert record.kinds["something else"] > 0.99
    ((low, _, high), *_, (_, _, highest)) = record.place("something else").amounts.values()
    assert low < 0.2 < high
    assert highest < -0.15


def test_the_mode_of_an_appendage_is_one_more_in_order_of_frequency():
    both = model_class(a=SAME, b=WITH_NEW)
    family = choose_changes(bs.Study("s", [both]), ["a"], ["b"])
    places = {each.name: each for each in family.features["building"]}
    assert {"mass on floor 1", "mass gone from floor 3", "something else"} <= places.keys()
    place = places["appendage on floor 1, mode new"]
    made = family.hypothesis(family.classes[0], (place,), "one")
    assert made.configurations[0].pairing == {"1": 1, "2": 2, "3": 3}
    assert made.configurations[1].pairing == {"1": 1, "2": 2, "new": 3, "3": 4}
    # The other way round, it stood there before.
    back = choose_changes(bs.Study("s", [both]), ["b"], ["a"])
    place = next(e for e in back.features["building"] if e.name.startswith("appendage gone"))
    made = back.hypothesis(back.classes[0], (place,), "gone")
    assert [len(test.structure.appendages) for test in made.configurations] == [1, 0]


def test_a_mass_on_a_node_moves_in_all_its_directions():
    x, y = (bs.Parameter(name, PRIOR) for name in ("x", "y"))
    terms, top = [(x, np.diag([40.0, 0.0])), (y, np.diag([0.0, 90.0]))], ["top x", "top y"]
    frame = bs.MatrixStructure(terms, np.eye(2), labels=top, n_modes=2)
    (mass,) = [e for e in element_places(frame, top, {False: (), True: ()}) if not e.has_gone]
    assert (mass.name, mass.ends) == ("mass on top", ("top x", "top y"))


@pytest.mark.parametrize(
    ("factors", "alike"),
    [
        ((0.97, 0.97, 0.97), True),  # all frequencies fall by 1.5 %
        ((1.05, 1.05, 1.05), True),
        ((1.0, 0.8, 1.0), False),  # by 1.5, 8.6 and 2.2 %
        ((1.0, 1.0, 1.0), False),
    ],
)
def test_frequencies_that_move_alike_are_noticed(factors, alike):
    tests = model_class(a=SAME, b=identified(stiffnesses=factors))
    assert moved_alike(risen(tests, ["a"], ["b"])) is alike
    family = choose_changes(bs.Study("s", [tests]), ["a"], ["b"])
    assert any(each.is_common for each in family.features["building"]) is alike


def test_losses_multiply_parameters_of_the_tests_after():
    places, study = {"lower": ("k1", "k2")}, bs.Study("s", [TWO])
    joined = choose_changes(study, ["a"], ["b"], joined=places)
    apart = choose_changes(study, ["a"], ["b"], places=places)
    for family, losses in ((joined, (0.2,)), (apart, (0.2, 0.1))):
        made = family.hypothesis(family.classes[0], (family.features["building"][0],), "lower")
        before, after = (test.structure for test in made.configurations)
        assert before is BUILDING
        ours = after.modes(np.array([[1.1, 1.2, 1.3, *losses]])).frequencies_hz
        left = [1.1 * (1.0 - losses[0]), 1.2 * (1.0 - losses[-1]), 1.3]
        assert ours == pytest.approx(BUILDING.modes(np.array([left])).frequencies_hz, rel=1e-12)


def test_a_covariate_gives_every_test_its_part_of_the_common_loss():
    """Degrees 10 and 14 before, 24 and 6 after: the one farthest from 12 is 12 away."""
    degrees = {"a": 10, "b": 14, "c": 24, "d": 6}
    settings = bs.ChangeSettings(common_sd=0.03, covariate=degrees, losses_only=True)
    study = bs.Study("s", [model_class(**dict.fromkeys("abcd", SAME))])
    family = choose_changes(study, ["a", "b"], ["c", "d"], settings)
    assert family.amounts == pytest.approx({"a": -1 / 6, "b": 1 / 6, "c": 1.0, "d": -0.5})
    made = family.hypothesis(family.classes[0], (family.features["building"][-1],), "common")
    left = [test.structure.left(np.array([[1.0, 1.0, 2.0, 0.06]])) for test in made.configurations]
    assert np.concatenate(left)[:, 2] == pytest.approx([2.02, 1.98, 1.88, 2.06])


def test_a_place_without_influence_is_said():
    idle = bs.AddedMass(1e-15 * bs.Parameter("idle", PRIOR), [(1, 1.0)])
    tests = TWO.with_structures(lambda *_: BUILDING.with_element(idle))
    family = choose_changes(bs.Study("s", [tests]), ["a"], ["b"])
    assert {place.name for place in without_influence(family)} == {"idle"}


def test_two_places_that_do_the_same_are_named_together():
    """The stiffness of storey 1 is a product: a loss of either factor is one of the other."""
    a, b, *others = [bs.Parameter(name, bs.LogNormal(1.0, 0.05)) for name in ("a", "b", "k2", "k3")]
    structure = bs.ShearBuilding((1.0,) * 3, [K * a * b, *(K * each for each in others)])
    lost = identified(stiffnesses=(0.8, 1.0, 1.0))
    record = screened_changes(lost, SAME, losses_only=True, structure=structure)
    (change,) = record.hypotheses[0].features
    (other,) = record.place(change.place.name).alike
    assert {change.place.name, other} == {"a", "b"}
    assert "The data do not tell" in " ".join(search_sentences(record, None))


def test_a_changed_structure_asks_the_other_one_at_what_is_left():
    class Approximate(type(BUILDING)):
        is_approximate = True

        def accuracy(self, values, n_modes=None):
            del n_modes
            return values

    other = Approximate(BUILDING.masses, BUILDING.stiffnesses)
    changed = ChangedStructure(other, (Loss("k2", bs.Parameter("loss", bs.Uniform(0, 1)), 0.5),))
    assert changed.is_approximate
    assert changed.is_cheap
    assert changed.accuracy(np.array([[1.0, 2.0, 3.0, 0.5]])).tolist() == [[1.0, 1.5, 3.0]]
    assert changed.exact is changed


@pytest.mark.parametrize(
    ("tests", "before", "after", "options", "message"),
    [
        (TWO, ["x"], ["b"], {}, "no configuration 'x'; choose from 'a', 'b'"),
        (TWO, ["a"], ["a"], {}, "configuration 'a' cannot be both before and after"),
        (TWO, [], ["a"], {}, "give one configuration or more before"),
        (model_class(a=SAME, b=identified(labels=("m1", "m2", "m3"))), ["a"], ["b"], {},
         "no paired mode has the same label before and after"),
        (TWO, ["a"], ["b"], {"left_out": ["m"]}, "no parameter 'm'; choose from 'k1', 'k2', 'k3'"),
        (TWO, ["a"], ["b"], {"left_out": NAMES}, "every parameter is left out"),
        (TWO, ["a"], ["b"], {"joined": {"p": ["k1"]}, "places": {"q": ["k1"]}},
         "parameter 'k1' is named twice"),
        (TWO, ["a"], ["b"], {"joined": {"k3": ["k1", "k2"]}}, "place 'k3' is named twice"),
        (TWO.with_any_pairing("any"), ["a"], ["b"], {}, "has pairing 'any', for which tests"),
        (TWO, ["a"], ["b"],
         {"change_settings": bs.ChangeSettings(common_sd=0.1, covariate={"a": 1.0})},
         "covariate: no value of test 'b'"),
        (TWO, ["a"], ["b"],
         {"change_settings": bs.ChangeSettings(common_sd=0.1, covariate={"a": 1.0, "b": 1.0})},
         "it is the same in all tests"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(tests, before, after, options, message):
    assert_refused(message, bs.changes, tests, before, after, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"loss": bs.Uniform(0.0, 1.5)}, "a loss of 1.5 would leave a negative stiffness"),
        ({"common_sd": 1.5}, "common_sd must be between 0 and 1, got 1.5"),
        ({"covariate": {"a": 1.0}}, "a covariate needs common_sd"),
        ({"number_weights": (1.0,)}, "ChangeSettings: number_weights must be two or more"),
    ],
)
def test_settings_that_cannot_be_are_refused(options, message):
    assert_refused(message, bs.ChangeSettings, **options)


def test_independent_errors_allow_any_pairing():
    settings = bs.ChangeSettings(shared=None, losses_only=True)
    family = choose_changes(bs.Study("s", [TWO.with_any_pairing("any")]), ["a"], ["b"], settings)
    assert not family.classes[0].error.is_correlated
    assert family.features["any"] == tuple(ChangePlace(name, (name,)) for name in NAMES)


def test_errors_that_the_class_shares_already_are_kept():
    own = replace(TWO, error=replace(ERROR, between_tests=0.5))
    assert choose_changes(bs.Study("s", [own]), ["a"], ["b"]).classes[0].error.between_tests == 0.5


STUDY = """
import sys
sys.path.insert(0, {tests!r})
import bayes_ssi as bs
from test_changes import identified, model_class
tests = model_class(a=identified(), b=identified(stiffnesses=(1.0, 0.7, 1.0)))
study = bs.Study("two tests", [tests])
"""


@pytest.fixture
def study_file(tmp_path, request):
    path = tmp_path / "two_tests.py"
    path.write_text(STUDY.format(tests=str(request.path.parent)), encoding="utf-8")
    return path


@pytest.mark.usefixtures("coarse_command", "no_drawings")
def test_the_command_saves_a_result_that_report_and_what_if_read(run, study_file, tmp_path):
    out = tmp_path / "r"
    arguments = ("changes", study_file, "--from", "a", "--to", "b", "--most", 1, "--workers", 1,
                 "--losses-only")  # fmt: skip
    result = succeeded(run(*arguments, "--out", out, "--accept-failed-checks"))
    shown = " ".join(result.stdout.split())
    for words in ("Changes from a to b", "lost or added (%)", "Most probably it is k2"):
        assert words in shown
    stored = bs.load_result(out)
    assert stored.search.place("k2").probability > 0.9
    assert stored.search.to_frame()["name"][0] == "k2"
    assert bs.write_report(out).read_text(encoding="utf-8").count("<h2") > 3
    changed = bs.what_if(out, bs.ChangedSettings(priors={"loss, k2": bs.Uniform(0.1, 0.9)}))
    narrower = next(each for each in changed.classes if each.name == "k2")
    gained = narrower.log_evidence_after.log_evidence - narrower.log_evidence_before.log_evidence
    assert gained == pytest.approx(-np.log(0.8), abs=0.05)
    again = stored.search.model_class(bs.load_study(study_file), "k2")
    assert again.parameter_names == stored.posterior("k2").parameter_names


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--from", "x", "--to", "b"), "no configuration 'x'"),
        (("--from", "a", "--to", "b", "--loss", "0", "2"), "negative stiffness"),
        (("--from", "a", "--to", "b", "--place", "p"),
         "--place: must be NAME=PARAMETER,…, got 'p'"),
    ],
)  # fmt: skip
def test_the_command_refuses_bad_input(run, study_file, options, message):
    assert_one_line_error(run("changes", study_file, *options), message)


# At the prior medians, in a band that holds the modes with large errors.
MODES = exact_modes(BUILDING, FLOORS, (0.0, 9.0), frequency_cov=0.002, shape_sd=0.01)


def test_nine_in_ten_are_above_where_the_normal_distribution_has_them():
    """Log odds of ½ (x/s + n)² - 8 with normal n: nine in ten exceed 2 from s (√20 + 1.2816) on."""
    s, rng = 0.05, np.random.default_rng(0)
    losses = np.geomspace(0.15, 0.5, 4000)
    log_odds = 0.5 * (losses / s + rng.standard_normal(4000)) ** 2 - 8.0
    smallest = smallest_loss(losses, log_odds, 2.0, -8.0)
    assert smallest == pytest.approx(s * (np.sqrt(20.0) + 1.2816), rel=0.01)


def test_a_loss_that_no_test_would_show_has_no_smallest():
    losses, rng = np.linspace(0.1, 0.9, 50), np.random.default_rng(0)
    assert smallest_loss(losses, rng.normal(-3.0, 0.5, 50), 2.0, -5.0) is None


def test_simulated_tests_share_the_errors_that_the_class_says():
    """Frequencies of 10 % error, of which 96 % is shared: 2 % differences times the root of two."""
    same = model_class(a=MODES, b=MODES)
    same = replace(same, error=replace(ERROR, frequency_cov=0.1, shape_sd=0.1, between_tests=0.96))
    z, rng = np.zeros(3), np.random.default_rng(1)
    hz, shapes = [], []
    for _ in range(400):
        before, after = simulated_tests(same, z, rng)
        hz.append([test.data.mode("1").frequency_hz for test in (before, after)])
        shapes.append([test.data.mode("1").shape for test in (before, after)])
    logs = np.log(hz)
    assert logs.std() == pytest.approx(np.sqrt(0.1**2 + 0.002**2), rel=0.1)
    apart = np.sqrt(2.0 * (0.04 * 0.1**2 + 0.002**2))
    assert np.diff(logs, axis=1).std() == pytest.approx(apart, rel=0.1)
    of_shapes = np.sqrt(2.0 * (0.04 * 0.1**2 + 0.01**2))
    assert np.diff(shapes, axis=1).std() == pytest.approx(of_shapes, rel=0.1)
    exact = np.sin(np.arange(1.0, 4.0) * np.pi / 7.0)  # at its median
    mean = np.abs(np.mean(shapes, axis=(0, 1)))
    np.testing.assert_allclose(mean, exact / np.linalg.norm(exact), atol=4.0 * 0.1 / 20.0)


def test_the_mode_of_an_appendage_takes_its_place_among_those_of_the_model():
    """Modes near 1, 2, 3 and 4 Hz, of which the third was not identified."""
    chain = bs.MatrixStructure(np.diag(K * np.arange(1.0, 5.0) ** 2), np.eye(4), n_modes=4)
    hz = {"1": 1.0, "2": 2.0, "new": 2.5, "4": 4.0}
    after = bs.ModalData([bs.IdentifiedMode(*each) for each in hz.items()], (0.0, 9.0))
    pairing = {"1": 1, "2": 2, "4": 4}
    test = bs.Configuration("after", chain, after, pairing=pairing)
    came = AppearedAppendage("tank", ("1",), mode="new")
    assert came.pairing_in(test, pairing, [test]) == {"1": 1, "2": 2, "4": 5, "new": 3}


def one_storey():
    """Two equal tests of one frequency."""
    building = bs.ShearBuilding((1.0,), [K * bs.Parameter("k1", PRIOR)])
    data = exact_modes(building, (), (0.0, 9.0), frequency_cov=0.002).without_shapes()
    both = [bs.Configuration(name, building, data, pairing={"1": 1}) for name in "ab"]
    error = bs.ErrorModel(0.01, between_tests=0.9)
    return bs.ModelClass("building", error=error, configurations=both)


LOSSES = bs.ChangeSettings(losses_only=True)


def test_the_smallest_visible_loss_is_said_where_nothing_changed():
    result = bs.changes(one_storey(), ["a"], ["b"], LOSSES, settings=COARSE)
    smallest = result.record.place("k1").smallest_visible
    assert 0.01 < smallest < 0.2
    assert result.record.scale == 100.0  # of losses in %
    many = replace(result.record, places=result.record.places * 20)
    assert f"{20 - MOST_PLACES} less probable places are in the saved result." in search_notes(many)
    said = f"would have shown with probability 0.9 are {100.0 * smallest:.2g} % in k1;"
    assert said in " ".join(result.summary().split())


def test_losses_beyond_the_smallest_visible_are_seen_and_smaller_ones_are_not(monkeypatch):
    """As 60 more tests of that loss say: 0.9 ± 0.04, and ± 0.05 for the scatter of the smallest."""
    family = choose_changes(bs.Study("s", [one_storey()]), ["a"], ["b"], LOSSES)
    family.features["building"] = family.features["building"][:1]
    hypotheses, _ = screened_hypotheses(family, 0, bs.Run(), most_full=0)
    (nothing,) = [each for key, each in hypotheses.items() if not key.features]
    ((place, smallest),) = smallest_losses(family, nothing, 0, bs.Run()).items()
    assert 0.01 < smallest < 0.2
    unchanged, screened, baseline = nothing.model_class, nothing.screened, nothing.key.baseline
    changed = family.hypothesis(unchanged, (place,), place.name)
    one, none = (family.prior_weight(baseline, number, 0) for number in (1, 0))
    odds = 9.0 * none / one
    rng = np.random.default_rng(99)
    draws = rng.choice(screened.z, 60, p=screened.weights)

    def share_shown(loss, n):
        factors = [log_bayes_factor(changed, unchanged, z, loss, rng, {}) for z in draws[:n]]
        return np.mean(np.array(factors) > np.log(odds))

    assert share_shown(smallest, 60) == pytest.approx(0.9, abs=3.0 * np.hypot(0.04, 0.05))
    assert share_shown(0.5 * smallest, 20) < 0.35
    # Of tests so precise that all losses which are tried first show, one without scatter.
    monkeypatch.setattr(visible_loss, "log_bayes_factor", lambda *of: 1e5 * of[3] ** 2)
    (smallest,) = smallest_losses(family, nothing, 0, bs.Run()).values()
    assert smallest == pytest.approx(math.sqrt(math.log(odds) / 1e5), rel=0.1)
