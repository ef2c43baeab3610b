"""Settings at whose edge a posterior lies: moved, they fail a check only if the answer changes."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from targets import one_mass

import bayes_ssi as bs
from bayes_ssi.parameters.priors import Widened
from bayes_ssi.studies.ranking import checks
from bayes_ssi.studies.ranking.checks import BAND_MOVED
from bayes_ssi.studies.ranking.class_sampling import sample_all

COARSE = bs.SamplingSettings(log_evidence_error=0.03, searches=2, effective_sample_size=1000)
ERROR = bs.ErrorModel(frequency_cov=0.02, shape_sd=0.05)
K = (2.0 * math.pi) ** 2


def frequencies_of(n_storeys):
    """Of a uniform shear building of n storeys with k = m (2π)², in closed form."""
    return 2.0 * np.sin((2 * np.arange(1, n_storeys + 1) - 1) * math.pi / (2 * (2 * n_storeys + 1)))


def building(n_storeys, factor, name="building", prior=None):
    """All modes but the highest were identified; the band ends at ``factor`` times that."""
    *identified, top = frequencies_of(n_storeys)
    modes = [bs.IdentifiedMode(str(i), f) for i, f in enumerate(identified, 1)]
    data = bs.ModalData(tuple(modes), (0.0, factor * top))
    k = bs.Parameter("k", prior or bs.LogNormal(1.0, 0.3))
    structure = bs.ShearBuilding((1.0,) * n_storeys, (K * k,) * n_storeys)
    pairing = {mode.label: int(mode.label) for mode in modes}
    return bs.ModelClass(name, structure, data, ERROR, pairing=pairing)


def ranked(*classes):
    return bs.rank(bs.Study("s", classes), settings=COARSE).comparison


def weighted(classes, odds):
    """Comparisons of two classes, sampled once, whose posterior odds are these."""
    posteriors = sample_all(classes, 0, COARSE)
    one, other = (each.evidence.log_evidence for each in posteriors)
    for each in odds:
        weights = dict(zip([c.name for c in classes], (each * math.exp(other - one), 1.0),
                           strict=True))  # fmt: skip
        study = bs.Study("s", classes, prior_weights=weights)
        yield checks.ranked(study, posteriors, 0, COARSE, bs.Run()).comparison


def shift_by_quadrature(n_storeys, factor, moved):
    """Shift of the mean of k in its standard deviations when the band's end is moved."""
    f = frequencies_of(n_storeys)
    k = np.linspace(0.7, 1.4, 4001)
    means, sds = [], []
    for end in (factor * f[-1], moved * factor * f[-1]):
        candidate = building(n_storeys, end / f[-1])
        density = candidate.log_likelihood(k[:, None]) + bs.LogNormal(1.0, 0.3).log_density(k)
        w = np.exp(density - density.max())
        w /= w.sum()
        means.append((w * k).sum())
        sds.append(math.sqrt((w * (k - means[-1]) ** 2).sum()))
    return abs(means[1] - means[0]) / sds[0]


@pytest.mark.parametrize("n_storeys", [2, 5])
def test_the_end_of_the_band_by_what_it_does_to_a_parameter(n_storeys):
    """One frequency determines k less than four do, and the end of the band shifts it by more."""
    comparison = ranked(building(n_storeys, 1.0))
    shifts = [shift_by_quadrature(n_storeys, 1.0, 1.0 + s * BAND_MOVED) for s in (-1.0, 1.0)]
    assert comparison.failed_checks == ()
    (remark,) = comparison.remarks
    assert "edge of the band" in remark
    number = float(re.search(r"([0-9.]+) of its standard deviation", remark)[1])
    assert number == pytest.approx(max(shifts), abs=0.06 + 0.01)


def test_the_end_of_the_band_that_turns_a_ranking_fails():
    """A second mode that should have been seen speaks against a class, unless the band ends."""
    two = building(2, 1.03, "two storeys")
    k = bs.Parameter("k", bs.LogNormal(frequencies_of(2)[0] ** 2, 0.3))
    one = bs.ModelClass(
        "one mass", bs.ShearBuilding((1.0,), (K * k,)), two.data, ERROR, pairing={"1": 1}
    )
    (comparison,) = weighted([two, one], [0.4 / 0.6])
    assert comparison.best.name == "one mass"
    (failed,) = (text for text in comparison.failed_checks if "edge of the band" in text)
    end = (1.0 - BAND_MOVED) * two.data.band_hz[1]
    assert failed.startswith("'two storeys': model mode 2 is paired with nothing")
    assert f"with the band ending at {end:.3g} Hz, 'two storeys' is the most probable" in failed


@pytest.mark.parametrize(
    ("cov", "prior", "fails", "words"),
    [
        (0.01, bs.LogNormal(0.55, 0.2), False, "no parameter of the structure by"),
        (0.04, bs.LogNormal(0.45, 0.2), True, "'k' moves by"),
        (0.01, bs.Uniform(2.0, 4.0), True, "prior beyond 2 would change is not known"),
    ],
)
def test_the_edge_of_a_prior_by_what_a_wider_one_does(cov, prior, fails, words):
    """The shift is 0.75 z s of an s.d. for a normal posterior of width s at z of its prior."""
    comparison = ranked(one_mass(prior=prior, error=cov))
    said = (*comparison.failed_checks, *comparison.remarks)
    (text,) = [each for each in said if "edge of its prior" in each]
    assert words in text
    assert (text in comparison.failed_checks) == fails


def test_the_size_of_an_error_is_no_answer(monkeypatch):
    """Frequencies off by 2.25 times the error that is expected: a wider prior moves its size."""
    monkeypatch.setattr("bayes_ssi.inference.criticism.misfit.PRIOR_EDGE", 1.0)
    # Weights for a prior wider by a factor of f have a tail of Pareto k near 1 - 1/f²: 0.75 for two
    # (0.755 by rejection), more than reweighting trusts, so that the class is sampled again.
    size = bs.Parameter("size", bs.LogNormal(0.004, 0.2))
    first, second = frequencies_of(2) * (1.009, 0.991)
    modes = bs.IdentifiedMode("1", first), bs.IdentifiedMode("2", second)
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    candidate = bs.ModelClass(
        "a", bs.ShearBuilding((1.0, 1.0), (K * k, K * k)), bs.ModalData(modes, (0.0, 3.0)),
        bs.ErrorModel(size, 0.05), pairing={"1": 1, "2": 2},
    )  # fmt: skip
    result = bs.rank(bs.Study("s", [candidate]), settings=COARSE)
    assert result.comparison.failed_checks == ()
    (remark,) = result.comparison.remarks
    assert "parameter 'size'" in remark
    wider = bs.ChangedSettings(priors={"size": Widened(size.prior, 1.3)})
    (row,) = bs.what_if(result, wider).classes
    shifts = [(p.after.mean - p.before.mean) / p.before.sd for p in row.parameters]
    assert shifts[1] > 0.5 > abs(shifts[0])


def test_no_prior_reaches_beyond_zero():
    """Exact data: the size of errors goes to zero, where every lognormal ends.

    Chains there are too short to pass their checks, however long.
    """
    candidate = replace(building(7, 0.94), error=bs.ErrorModel(shape_sd=0.05))
    short = bs.SamplingSettings(0.3, particles=60, searches=1, max_steps=50)
    best = bs.rank(bs.Study("s", [candidate]), settings=short).comparison.best
    (edge,) = (check for check in best.checks if check.kind == "edge")
    assert "lower edge of its prior, LogNormal" in edge.words
    assert "prior beyond" not in edge.words


def test_the_probabilities_of_missed_and_spurious_modes_where_classes_differ_in_them():
    """A class with a spurious mode gains log 2 on twice as many expected."""
    modes = tuple(bs.IdentifiedMode(str(i), f) for i, f in enumerate((1.0, 1.4), 1))
    data = bs.ModalData(modes, (0.0, 2.0))
    k, x = (bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in ("k", "x"))
    one = bs.ShearBuilding((1.0,), (K * k,))
    two = one.with_element(bs.Pendulum(on=1, mass=0.001, frequency=1.4 * x))
    spurious = bs.ModelClass("spurious", one, data, ERROR, pairing={"1": 1})
    pendulum = bs.ModelClass("pendulum", two, data, ERROR, pairing={"1": 1, "2": 2})
    even, far = weighted([spurious, pendulum], (1.0, 0.1))
    failed = [text for text in even.failed_checks if "differ in" in text]
    # Odds of 1/2 with half the spurious modes; p_D, from 0.95 to 0.90 or 0.975, moves them by 5 %.
    assert len(failed) == 1
    assert "with half as many spurious modes, the probability of" in failed[0]
    before, after = map(float, re.search(r"goes from (\S+) to (\S+)", failed[0]).groups())
    assert before == pytest.approx(0.5, abs=0.03)
    assert abs(after - before) == pytest.approx(1.0 / 6.0, abs=0.03)
    assert len([text for text in far.remarks if "differ in" in text]) == 2


@pytest.mark.parametrize("searched", [(), ("k",)])
def test_bounds_of_what_is_searched_fail_no_check(searched):
    """k is 1.21 for a perfect fit, two widths of its posterior below the prior."""
    candidate = one_mass(prior=bs.Uniform(1.26, 1.6), error=0.01)
    given = bs.Study("s", [candidate]), sample_all([candidate], 0, COARSE), 0, COARSE, bs.Run()
    comparison = checks.ranked(*given, searched=searched).comparison
    said = comparison.remarks if searched else comparison.failed_checks
    assert sum("within one of its own standard deviations" in text for text in said) == 1
