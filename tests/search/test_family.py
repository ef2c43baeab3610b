"""Any family of hypotheses is searched by the same driver: here, storeys that lost stiffness."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from searches import COARSE, exact_modes

import bayes_ssi as bs
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.studies.search.approximate_evidence import Screened
from bayes_ssi.studies.search.family import Family, Key, SearchLimits
from bayes_ssi.studies.search.family_search import search_family

K = (2.0 * math.pi) ** 2
SENSORS = ("floor 1", "floor 2", "floor 3")
ERROR = bs.ErrorModel(frequency_cov=0.005, shape_sd=0.02)


def building(left):
    """Storeys with these shares of their stiffness left, all times one factor."""
    factor = bs.Parameter("factor", bs.LogNormal(1.0, 0.05))
    return bs.ShearBuilding((1.0,) * 3, [K * factor * share for share in left])


class Storey(int):
    is_common = False


@dataclass(frozen=True, eq=False)
class Losses(Family[Storey]):
    """Storeys, from 1, whose stiffness is anything between none and all of what it was."""

    title = "Losses of stiffness"

    def name_of(self, features):
        return " + ".join(f"storey {storey}" for storey in features) or "no loss"

    def hypothesis(self, baseline, features, name):
        left = [
            bs.Parameter(f"left in storey {i}", bs.Uniform(0.0, 1.0)) if i in features else 1.0
            for i in (1, 2, 3)
        ]
        return baseline.with_structures(lambda *_: building(left)).with_any_pairing(name)

    def quantities(self, baseline, feature, column):  # noqa: ARG002 - of all families
        return {"left": column(f"left in storey {feature}")}


@pytest.fixture(scope="module")
def found():
    """Exact modes of a building whose second storey has 70 % of its stiffness left."""
    data = exact_modes(building((1.0, 0.7, 1.0)), SENSORS, (0.0, 3.0))
    whole = bs.ModelClass("whole", building((1.0,) * 3), data, ERROR, pairing={})
    limits = SearchLimits(branches=1)
    losses = Losses(bs.Study("losses", [whole]), {"whole": tuple(map(Storey, (1, 2, 3)))}, limits)
    return search_family(losses, 0, COARSE, bs.Run())


def test_the_storey_that_lost_stiffness_is_found_and_how_much(found):
    probabilities = found.probabilities
    assert sum(probabilities.values()) == pytest.approx(1.0)
    with_it = sum(
        probabilities[each.model_class.name] for each in found.hypotheses if 2 in each.key.features
    )
    assert with_it > 0.99
    assert max(probabilities, key=probabilities.get) == "storey 2"
    posterior = found.posteriors["storey 2"]
    left = posterior.summary[posterior.parameter_names.index("left in storey 2")]
    assert left.quantile_05 < 0.7 < left.quantile_95


def test_two_are_tried_on_the_best_one(found):
    keys = {each.key for each in found.hypotheses}
    assert {Key("whole", (2,)), Key("whole", (1, 2)), Key("whole", (2, 3))} <= keys
    assert len(keys) + sum(n for _, n, _ in found.levels) == 7


def test_parameters_are_averaged_over_hypotheses_and_without_any(found):
    """What is lost in one storey was taken from all of them."""
    (factor,) = found.averaged_parameters()
    assert factor.name == "factor"
    assert factor.mean == pytest.approx(1.0, abs=0.02)
    assert factor.naive_mean < 0.97


def test_draws_of_some_parameters_end_at_three_standard_deviations_of_the_prior():
    """Equal weights draw every row once; the prior holds 2 · 0.00135 beyond three."""
    z = np.column_stack([np.zeros(101), np.linspace(-5.0, 5.0, 101)])
    mixture = StudentMixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None], np.full(1, 30.0))
    screened = Screened(
        ("a", "b"), 0.0, 0.1, 0.0, 101, np.zeros((1, 2)), z, np.full(101, 1.0 / 101.0), mixture
    )
    (b,) = screened.posterior_draws(["b"], 101).T
    expected = [min(max(-5.0 + 0.1 * i, -3.0), 3.0) for i in range(101)]
    np.testing.assert_allclose(np.sort(b), expected, atol=1e-12)


def test_large_models_are_searched_in_a_reduced_basis():
    """A chain of 60 masses; its evidence as with full solutions."""
    factor, n = bs.Parameter("factor", bs.LogNormal(1.0, 0.05)), 60
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    chain = bs.MatrixStructure((factor, stiffness), np.eye(n), n_modes=3)
    exact = 2.0 * np.sin(np.arange(1, 4) * np.pi / (2.0 * (n + 1))) / (2.0 * np.pi)
    modes = tuple(bs.IdentifiedMode(str(j), float(hz)) for j, hz in enumerate(exact, 1))
    data = bs.ModalData(modes, (0.0, 1.1 * float(exact[-1])), ())
    whole = bs.ModelClass("whole", chain, data, ERROR, pairing={"1": 1, "2": 2, "3": 3})
    family = Losses(bs.Study("losses", [whole]), {"whole": ()}, SearchLimits())
    (quick,) = family.in_reduced_bases().classes
    assert quick.structure.exact is chain
    z = np.linspace(-2.0, 2.0, 5)[:, None]
    assert quick.log_likelihood_at(z) == pytest.approx(whole.log_likelihood_at(z), abs=1e-4)
