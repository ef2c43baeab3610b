"""A first look at many hypotheses on a finite-element model, against screening each of them."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from chains import spring_chain
from scipy.special import logsumexp
from searches import exact_modes

import bayes_ssi as bs
from bayes_ssi.studies.appendages.baselines import Baselines, choose_baselines
from bayes_ssi.studies.search.approximate_evidence import FULL, QUICK, Screened, ToScreen, screen
from bayes_ssi.studies.search.common_likelihood import common_log_likelihoods, in_common
from bayes_ssi.studies.search.family import Hypothesis, Key
from bayes_ssi.studies.search.family_search import screened_hypotheses
from bayes_ssi.studies.search.ladder import SHARE_LEFT_OUT, looks_at, screen_best

N, PLACES = 40, (12, 24, 30, 38)

TRUE = PLACES.index(30)


class Chain(NamedTuple):
    """Baselines of a search, hypotheses of one pendulum, and what screening gives."""

    baselines: Baselines
    hypotheses: list[ToScreen]
    screened: list[Screened]


@pytest.fixture(scope="module")
def chain():
    """A chain of springs with one pendulum, at most.

    The data have one at degree of freedom 30, in resonance with the second mode.
    """
    factors = [4000.0 * bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.1)) for i in (1, 2)]
    model = bs.MatrixStructure(
        [*zip(factors, spring_chain(N, 2), strict=True)], np.eye(N),
        labels=[str(i) for i in range(N)], sensors=["6", "15", "26", "39"], n_modes=4,
    )  # fmt: skip
    frequencies = model.modes(np.array([[1.05, 0.9]])).frequencies_hz[0]
    carrying = model.with_element(bs.Pendulum("30", 0.8, float(frequencies[1])))
    band = (0.0, float(1.1 * carrying.modes(np.array([[1.05, 0.9]])).frequencies_hz[0, 3]))
    data = exact_modes(carrying, model.degrees_of_freedom, band, 4, (1.05, 0.9))
    error = bs.ErrorModel(frequency_cov=0.003, shape_sd=0.02)
    baseline = bs.ModelClass("chain", model.reduced(), data, error, pairing="any")
    candidates = [bs.Candidate(str(i), str(i)) for i in PLACES]
    settings = bs.SearchSettings(number_weights=(1.0, 1.0))
    chosen = choose_baselines(bs.Study("chain", [baseline]), None, candidates, options=settings)
    chosen.features["chain"] = tuple(chosen.appendages("chain"))  # no other motion

    def screen_best(hypotheses, *_):
        """The true one in full, to begin with; what is known of the others may be rough."""
        in_full = {"no appendage", "pendulum 30"}
        return [screen(each, 0, FULL if each[0].name in in_full else QUICK) for each in hypotheses]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("bayes_ssi.studies.search.family_search.screen_best", screen_best)
        without, *ones = screened_hypotheses(chosen, 0, bs.Run())[0].values()
    wanted = [(each.model_class, without.screened) for each in ones]
    return Chain(chosen, wanted, [each.screened for each in ones])


@pytest.fixture(scope="module")
def together(chain):
    return looks_at(chain.hypotheses, 0, bs.Run())


def test_the_greatest_likelihood_is_that_of_screening(chain, together):
    """Within a few nats, at the true place within a hundredth; evidences are well below it."""
    _, hypotheses, screened = chain
    assert hypotheses[TRUE][0].name == "pendulum 30"
    for i, (hypothesis, full) in enumerate(zip(hypotheses, screened, strict=True)):
        of_class, look = hypothesis[0].log_likelihood_at, together[i]
        at_maxima = of_class(full.maxima).max()
        assert look.log_evidence == pytest.approx(at_maxima, abs=0.01 if i == TRUE else 6.0)
        assert look.log_evidence > full.log_evidence + 5.0
        assert look.log_evidence == pytest.approx(of_class(look.z).max(), abs=1e-9)


def test_looking_together_changes_nothing(chain, together):
    alone = [looks_at([each], 0, bs.Run())[0] for each in chain.hypotheses[1:3]]
    for i, look in enumerate(alone, 1):
        assert np.array_equal(look.z, together[i].z)
        assert look.log_evidence == together[i].log_evidence


def test_only_hypotheses_of_one_model_with_equal_elements_are_computed_together(chain):
    """The same pendulum elsewhere; not on another model, nor a heavier one."""
    at_places = [made for made, _ in chain.hypotheses]
    (common,) = {in_common(made) for made in at_places}
    z = np.random.default_rng(0).standard_normal((len(at_places), 20, len(at_places[0].parameters)))
    answers = common_log_likelihoods(at_places)(list(enumerate(z)))
    for made, own, answer in zip(at_places, z, answers, strict=True):
        np.testing.assert_allclose(answer, made.log_likelihood_at(own), rtol=1e-9)

    def stiffer(structure, _):
        return replace(structure, stiffness=tuple((1.1 * c, m) for c, m in structure.stiffness))

    def heavier(structure, _):
        (pendulum,) = structure.elements
        return replace(structure, elements=(replace(pendulum, mass=1.1 * pendulum.mass),))

    for change in (stiffer, heavier):
        assert in_common(at_places[0].with_structures(change)) != common


def test_what_a_first_look_leaves_out_does_not_matter(chain):
    """Of more hypotheses than are screened in full, only those within reach go on."""
    _, hypotheses, full = chain
    steps = screen_best(hypotheses, [1.0] * len(hypotheses), 1, 0, bs.Run(), most_full=2)
    left_out = [i for i, each in enumerate(steps) if np.isnan(each.laplace)]
    assert len(left_out) == len(hypotheses) - 2
    assert steps[TRUE].log_evidence == full[TRUE].log_evidence
    total = logsumexp([each.log_evidence for each in full])
    bounds = {i: steps[i].log_evidence + 3.0 * steps[i].error for i in left_out}
    assert logsumexp(list(bounds.values())) < total + np.log(SHARE_LEFT_OUT)
    for i, bound in bounds.items():
        assert full[i].log_evidence < bound
        # As far below its greatest likelihood as the others, which may be higher than was seen.
        assert steps[i].log_evidence == pytest.approx(full[i].log_evidence, abs=6.0)


def test_several_appendages_are_screened_in_full_only_where_they_matter(chain):
    """Next to hypotheses with fewer that have a thousand times as much, quick screening does."""
    _, hypotheses, full = chain
    some, in_full = [hypotheses[TRUE], hypotheses[TRUE - 1]], full[TRUE]
    much = in_full.log_evidence + np.log(1000.0)
    quick = screen_best(some, [1.0, 1.0], 2, 0, bs.Run(), log_mass_of_fewer=much)[0]
    assert quick.log_evidence == pytest.approx(in_full.log_evidence, abs=3.0 * quick.error + 0.1)
    assert quick.n_evaluations < 0.2 * in_full.n_evaluations


def test_the_basis_that_all_share_is_accurate_where_the_best_one_lies(chain):
    """To a tenth of the data's errors, also with the pendulum, and in few combinations of it."""
    screened, (model_class, _) = chain.screened[TRUE], chain.hypotheses[TRUE]
    features = (chain.baselines.appendages("chain")[TRUE],)
    best = Hypothesis(Key("chain", features), model_class, 1.0, screened)
    accurate = chain.baselines.accurate(best)
    values = accurate.values(screened.posterior_draws(accurate.parameter_names, 20))
    bounds = accurate.structure.bounds(values, 4)
    assert bounds.frequency.max() < 0.1 * 0.003
    assert bounds.shape.max() < 0.1 * 0.02
    sampled = chain.baselines.to_sample(accurate, best)
    assert sampled.parameter_names == model_class.parameter_names
    carrying = sampled.structure
    draws = sampled.values(screened.posterior_draws(sampled.parameter_names, 20))
    ours, theirs = (each.modes(draws).frequencies_hz[:, :4] for each in (carrying, carrying.full))
    assert ours == pytest.approx(theirs, rel=0.1 * 0.003)
