"""Parameters averaged over model classes."""

import json
import math

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import averaged_parameters


def draws(seed, centre, n):
    rng = np.random.default_rng(seed)
    return np.array(centre) * np.exp(0.3 * rng.standard_normal((4, 250, n)))


@pytest.fixture
def three(make_posterior):
    """Classes with probabilities 1/6, 2/6 and 3/6; b is in all, a and c in two, d in one."""
    return [
        make_posterior("A", math.log(1.0), names="ab", draws=draws(1, [1.0, 2.0], 2)),
        make_posterior("B", math.log(2.0), names="cba", draws=draws(2, [5.0, 3.0, 1.5], 3)),
        make_posterior("C", math.log(3.0), names="bcd", draws=draws(3, [2.5, 4.0, 9.0], 3)),
    ]


def test_averages_are_those_of_the_mixture_of_the_classes_that_infer_it(three):
    averages = averaged_parameters(three, bs.compare(three))
    assert [(row.name, row.n_classes) for row in averages] == [("a", 2), ("b", 3), ("c", 2)]
    shares = {"a": {"A": 1 / 3, "B": 2 / 3}, "b": {"A": 1 / 6, "B": 2 / 6, "C": 3 / 6},
              "c": {"B": 2 / 5, "C": 3 / 5}}  # fmt: skip
    assert [row.probability for row in averages] == pytest.approx([1 / 2, 1.0, 5 / 6])
    for row in averages:
        own = {p.name: p.values[:, p.parameter_names.index(row.name)] for p in three
               if row.name in p.parameter_names}  # fmt: skip
        x = np.concatenate(list(own.values()))
        w = np.concatenate([np.full(1000, shares[row.name][name] / 1000) for name in own])
        assert row.mean == pytest.approx(w @ x, rel=1e-12)
        assert row.sd == pytest.approx(math.sqrt(w @ (x - w @ x) ** 2), rel=1e-12)
        # Weights of so many equal draws add up to just 5 %: the lower draw, whatever the rounding.
        levels = np.multiply([0.05, 0.95], 1.0 - 1e-12)
        expected = np.quantile(x, levels, weights=w, method="inverted_cdf")
        assert (row.quantile_05, row.quantile_95) == pytest.approx(tuple(expected), rel=1e-3)


def test_a_class_of_all_the_probability_is_the_average(make_posterior):
    one = make_posterior("A", 0.0, names="a", draws=draws(4, [1.0], 1))
    other = make_posterior("B", -900.0, names="a", draws=draws(5, [9.0], 1))
    (average,) = averaged_parameters([one, other], bs.compare([one, other]))
    assert average.mean == pytest.approx(one.values.mean(), rel=1e-12)
    assert average.n_classes == 2


def test_what_only_impossible_classes_share_is_left_out(make_posterior):
    best = make_posterior("A", 0.0, names="a", draws=draws(4, [1.0], 1))
    worse = [make_posterior(name, -900.0, names="b", draws=draws(5, [9.0], 1)) for name in "BC"]
    assert averaged_parameters([best, *worse], bs.compare([best, *worse])) == ()


@pytest.mark.usefixtures("coarse_command")
def test_ranking_shows_and_saves_the_averages(run, tiny_study_file, tmp_path):
    text = tiny_study_file.read_text(encoding="utf-8")
    tiny_study_file.write_text(text.replace('"k1"', '"k"'), encoding="utf-8")
    done = run("rank", tiny_study_file, "--out", tmp_path / "r", "--accept-failed-checks",
               "--verbose")  # fmt: skip
    assert "Parameters averaged over the model classes that infer them" in done.stdout
    rows = json.loads((tmp_path / "r" / "averaged_parameters.json").read_text(encoding="utf-8"))
    assert [(row["name"], row["n_classes"]) for row in rows] == [("k", 2)]
