"""The likelihood over all pairings against explicit pairings, one by one, and what is inferred."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

import bayes_ssi as bs
from bayes_ssi.inference.likelihood.pairings import (
    LEAST_PROBABILITY,
    MOST_DRAWS,
    InferredPairing,
    PairingShare,
)
from bayes_ssi.report.tables.ranking_tables import pairing_notes

NAN = math.nan
FACTOR = 0.004 * np.random.default_rng(0).standard_normal((16, 16))


def matchings(labels, n_modes):
    """Every pairing of identified modes with model modes."""
    for numbers in itertools.product(range(n_modes + 1), repeat=len(labels)):
        paired = [number for number in numbers if number]
        if len(set(paired)) == len(paired):
            yield {label: i for label, i in zip(labels, numbers, strict=True) if i}


def over_every_pairing(model, data, values):
    """Log of the sum of the likelihoods of explicit pairings."""
    terms = []
    for pairing in matchings(data.labels, model.structure.n_modes):
        test = replace(model.configuration(), data=data, pairing=pairing)
        one = replace(model, configurations=(test,))
        columns = [model.parameter_names.index(name) for name in one.parameter_names]
        terms.append(one.log_likelihood(values[:, columns]))
    return logsumexp(terms, axis=0)


@pytest.fixture
def partial_data():
    """Some shapes missing or partial, and identification errors that differ between modes."""
    modes = (
        bs.IdentifiedMode("1", 0.98, [0.33, 0.59, NAN], frequency_cov=0.004, shape_sd=0.03),
        bs.IdentifiedMode("2a", 2.60, [0.67, 0.24, -0.70], shape_sd=0.1),
        bs.IdentifiedMode("x", 3.0, frequency_cov=0.02),
        bs.IdentifiedMode("3", 3.98, [NAN, 0.74, NAN]),
    )
    return bs.ModalData(modes, (0.5, 4.1), ("floor 1", "floor 2", "floor 3"))


INFERRED = bs.ErrorModel(*(
    size * bs.Parameter(name, bs.LogNormal(1.0, 0.5)) for name, size in (("a", 0.02), ("b", 0.06))
))  # fmt: skip


@pytest.mark.parametrize("structure", ["rigid", "augmented"])
@pytest.mark.parametrize(
    ("data", "error", "identification"),
    [
        ("case_c", bs.ErrorModel(0.01, 0.05), ()),
        ("case_c", INFERRED, ()),
        ("frequencies", bs.ErrorModel(0.01, 0.05), ()),
        ("partial_data", bs.ErrorModel(0.01, 0.05), (0.5, 3.0)),
        ("partial_data", bs.ErrorModel(), (0.999, 1e-4)),
        ("joint", INFERRED, ()),
    ],
)
def test_it_is_the_sum_over_every_pairing(
    request, structure, data, error, identification, case_c, partial_data
):
    """Of joint errors, with the part of each mode alone."""
    modes = {
        "case_c": case_c,
        "frequencies": case_c.without_shapes(),
        "partial_data": partial_data,
        "joint": replace(case_c, covariance=FACTOR @ FACTOR.T),
    }[data]
    identification = bs.IdentificationModel(*identification)
    model = bs.ModelClass(
        "any", request.getfixturevalue(structure), modes, error, pairing="any",
        identification=identification,
    )  # fmt: skip
    z = 0.5 * np.random.default_rng(0).standard_normal((4, len(model.parameters)))
    values = model.values(z)
    if modes.covariance is not None:
        mode_of = np.r_[np.arange(4), np.repeat(np.arange(4), 3)]
        modes = replace(modes, covariance=modes.covariance * np.equal.outer(mode_of, mode_of))
    expected = over_every_pairing(model, modes, values)
    np.testing.assert_allclose(model.log_likelihood(values), expected, rtol=1e-11)


class Crossing(bs.Structure):
    """Two oscillators that know nothing of each other: one at 2 Hz, the other at f."""

    f = bs.Parameter("f", bs.Uniform(1.0, 3.0))
    parameters = (f,)
    degrees_of_freedom = ("x", "y")
    n_modes = 2

    def modes(self, values):
        f = values[:, 0]
        frequencies = np.column_stack([np.full(len(f), 2.0), f])
        order = np.argsort(frequencies, axis=1)
        return bs.Modes(np.sort(frequencies, axis=1), np.eye(2)[:, order].swapaxes(0, 1))


@pytest.fixture
def crossing_data():
    of_x = bs.IdentifiedMode("of x", 2.0, [1.0, 0.05])
    of_y = bs.IdentifiedMode("of y", 2.01, [0.05, 1.0])
    return bs.ModalData((of_x, of_y), (0.0, 4.0), ("x", "y"))


@pytest.mark.parametrize("pairing", ["any", {"of x": 1, "of y": 2}])
def test_modes_may_change_places(crossing_data, fixed_error, pairing):
    """Just below and just above the crossing the structure is the same but for the numbering.

    Modes at a crossing turn freely: no numbering is worse.
    """
    model = bs.ModelClass("c", Crossing(), crossing_data, fixed_error, pairing=pairing)
    below, above = model.log_likelihood(np.array([[2.0 - 1e-9], [2.0 + 1e-9]]))
    assert below == pytest.approx(above, abs=1e-5)


def test_the_pairing_follows_modes_that_change_places(crossing_data, fixed_error):
    of_x, of_y = crossing_data.modes
    for f, expected in ((1.8, {"of x": 2, "of y": 1}), (2.2, {"of x": 1, "of y": 2})):
        data = replace(crossing_data, modes=(of_x, replace(of_y, frequency_hz=f)))
        free = bs.ModelClass("any", Crossing(), data, fixed_error, pairing="any")
        assert free.likelihoods[0].inferred_pairing(np.array([[f]])).best == expected


def test_where_the_structure_has_no_modes_there_is_no_likelihood(crossing_data, fixed_error):
    model = bs.ModelClass("any", Crossing(), crossing_data, fixed_error, pairing="any")
    values = np.array([[2.1], [NAN], [2.2]])
    assert np.isneginf(model.log_likelihood(values)).tolist() == [False, True, False]
    assert np.isnan(model.likelihoods[0].log_density(values)).tolist() == [False, True, False]


def test_parameters_are_those_of_everything_that_could_be_paired(rigid, case_c, partial_data):
    error = bs.ErrorModel(0.01, bs.Parameter("s", bs.LogNormal(0.05, 1.0)))

    def names(data):
        return bs.ModelClass("any", rigid, data, error, pairing="any").parameter_names

    assert names(case_c) == names(partial_data) == ("k1", "k2", "k3", "s")
    assert names(case_c.without_shapes()) == ("k1", "k2", "k3")


def test_a_pairing_that_is_neither_any_nor_a_mapping_is_refused(rigid, case_c, fixed_error):
    with pytest.raises(TypeError, match=r"^model class 'm': pairing must map .*'any', got 'some'"):
        bs.ModelClass("m", rigid, case_c, fixed_error, pairing="some")


def test_classes_that_differ_in_their_pairing_alone_become_one(model_classes):
    classes = list(model_classes.values())
    study = bs.Study("s", classes, description="why").with_any_pairing()
    assert study.names == ("1-a or 1-b or 2", "3")
    assert [candidate.pairing for candidate in study.model_classes] == ["any", "any"]
    assert study.prior_weights is None
    assert (study.name, study.description) == ("s", "why")
    weights = {"1-a": 1.0, "1-b": 2.0, "2": 3.0, "3": 4.0}
    study = bs.Study("s", classes, prior_weights=weights).with_any_pairing()
    assert study.prior_weights == {"1-a or 1-b or 2": 6.0, "3": 4.0}


@pytest.mark.parametrize(
    ("descriptions", "merged"),
    [
        (("wall as mass; 2a first", "wall as mass; 2b first", ""), "wall as mass, any pairing"),
        (("2a first", "2b first", "2b first"), "2a first - or 2b first"),
        (("wall; rigid", "", ""), "wall; rigid"),
    ],
)
def test_a_merged_class_is_described_by_its_structure(model_classes, descriptions, merged):
    each = zip(("1-a", "1-b", "2"), descriptions, strict=True)
    classes = [replace(model_classes[name], description=text) for name, text in each]
    (candidate,) = bs.Study("s", classes).with_any_pairing().model_classes
    assert candidate.description == merged


def test_classes_that_differ_in_anything_else_stay_apart(rigid, case_c, fixed_error):
    pairing = {"1": 1}
    wide = bs.ErrorModel(0.02, 0.05)
    alert = bs.IdentificationModel(0.99)
    classes = [
        bs.ModelClass("a", rigid, case_c, fixed_error, pairing=pairing),
        bs.ModelClass("error", rigid, case_c, wide, pairing=pairing),
        bs.ModelClass("p_D", rigid, case_c, fixed_error, pairing=pairing, identification=alert),
        bs.ModelClass("data", rigid, case_c.without_shapes(), fixed_error, pairing=pairing),
        bs.ModelClass("b", rigid, case_c, fixed_error, pairing={"1": 2}),
    ]
    assert bs.Study("s", classes).with_any_pairing().names == ("a or b", "error", "p_D", "data")


def test_the_probability_of_a_pairing_is_its_share_of_the_likelihood(rigid, case_c, fixed_error):
    """At draws about where the mass-only structure fits best; of many draws some serve."""
    model = bs.ModelClass("any", rigid, case_c, fixed_error, pairing="any")
    values = np.random.default_rng(4).normal([0.95, 1.1, 0.92], [0.05, 0.06, 0.04], (200, 3))
    inferred = model.likelihoods[0].inferred_pairing(values)
    whole = model.log_likelihood(values)
    assert len(inferred.pairings) > 1
    for share in inferred.pairings:
        test = replace(model.configuration(), pairing=share.pairing)
        one = replace(model, configurations=(test,)).log_likelihood(values)
        assert share.probability == pytest.approx(np.exp(one - whole).mean(), rel=1e-9)
    probabilities = [share.probability for share in inferred.pairings]
    assert probabilities == sorted(probabilities, reverse=True)
    assert inferred.best == inferred.pairings[0].pairing
    assert sum(probabilities) <= 1.0 + 1e-12
    assert tuple(inferred.of_modes) == ("1", "2a", "2b", "3")
    for probabilities in inferred.of_modes.values():
        assert sum(probabilities.values()) == pytest.approx(1.0, abs=4 * LEAST_PROBABILITY)
        assert set(probabilities) <= {0, 1, 2, 3}
        assert min(probabilities.values()) >= LEAST_PROBABILITY
    many = np.tile(values, (2 * MOST_DRAWS // len(values), 1))
    assert model.likelihoods[0].inferred_pairing(many).best == inferred.best


def test_data_that_the_structure_cannot_explain_are_spurious(rigid, fixed_error):
    far_off = bs.ModalData((bs.IdentifiedMode("x", 30.0),), (20.0, 40.0))
    model = bs.ModelClass("any", rigid, far_off, fixed_error, pairing="any")
    inferred = model.likelihoods[0].inferred_pairing(np.ones((10, 3)))
    assert inferred.best == {}
    assert inferred.of_modes == {"x": {0: pytest.approx(1.0)}}


def test_sampling_infers_the_pairing(tiny_study, tiny_ranking, tmp_path):
    """The tiny study's single-stiffness class over all pairings; what is inferred is stored."""
    study = tiny_study.only(["one k"]).with_any_pairing()
    ranking = bs.rank(study, 7, bs.SamplingSettings(0.05, searches=1, effective_sample_size=400))
    (posterior,) = ranking.posteriors
    (modes,) = posterior.configurations
    assert modes.pairing == modes.inferred_pairing.best == {"1": 1, "2": 2}
    assert modes.inferred_pairing.pairings[0].probability > 0.99
    given = tiny_ranking.posteriors[0].evidence.log_evidence
    assert posterior.evidence.log_evidence == pytest.approx(given, abs=0.05)
    assert tiny_ranking.posteriors[0].configurations[0].inferred_pairing is None
    assert pairing_notes(tiny_ranking.posteriors[0]) == []
    bs.save_result(ranking, tmp_path / "r")
    (loaded,) = bs.load_result(tmp_path / "r").posteriors
    assert loaded.configurations == posterior.configurations


def test_notes_begin_with_what_is_most_probable(make_posterior):
    """Of model modes 1, 2 and 3 and none; what rounds to 0.000 is left out."""
    shares = (PairingShare({"1": 1}, 0.6), PairingShare({"1": 3}, 0.2995), PairingShare({}, 0.1))
    inferred = InferredPairing(shares, {"1": {0: 0.1, 1: 0.6, 2: 0.0005, 3: 0.2995}})
    ((_, items),) = pairing_notes(make_posterior("A", inferred=inferred))
    assert items[0].startswith("identified mode 1 is model mode 1 with probability 0.6")
    places = [items[0].index(name) for name in ("model mode 1", "model mode 3", "spurious")]
    assert places == sorted(places)
    assert "model mode 2" not in items[0]
    assert items[3].startswith("every identified mode spurious: probability 0.1")
