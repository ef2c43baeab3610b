"""Computations side by side, and hypotheses whose likelihoods are computed in common batches."""

import threading
from functools import partial

import numpy as np
import pytest
from searches import INFILL_01, INFILL_12, PENDULUM_1, PENDULUM_3

import bayes_ssi as bs
from bayes_ssi.structures.changed_structure import FurtherMode
from bayes_ssi.studies.appendages.baselines import hypothesis
from bayes_ssi.studies.search.approximate_evidence import QUICK, screen, screen_all
from bayes_ssi.studies.search.common_likelihood import common_log_likelihoods, in_common
from bayes_ssi.studies.search.side_by_side import SideBySide


def squares(asked):
    """An answerer that writes down what it is asked at once; of a negative number, an error."""

    def answer_all(numbers):
        asked.append(list(numbers))
        return [ValueError(f"{n} is negative") if n < 0 else n * n for n in numbers]

    return SideBySide(answer_all)


def summed(batches, numbers):
    return sum(batches.ask(n) for n in numbers)


def test_all_ask_at_once_in_their_order():
    batches = squares(asked := [])
    computations = [partial(summed, batches, own) for own in ([1, 2, 3], [], [4, 5], [6])]
    assert batches.run(computations) == [14, 0, 41, 36]
    assert asked == [[1, 4, 6], [2, 5], [3]]
    assert batches.ask(7) == 49  # outside them


def test_an_error_is_raised_where_it_was_asked_for():
    batches = squares(asked := [])

    def cautious():
        with pytest.raises(ValueError, match="-1 is negative"):
            batches.ask(-1)
        return batches.ask(2)

    assert batches.run([cautious, partial(summed, batches, [3, 4])]) == [4, 25]
    assert asked == [[-1, 3], [2, 4]]


@pytest.mark.parametrize("at", ["first", "last", "answers"])
def test_an_error_ends_all(at):
    """Also those that wait, which clean up; and no thread is left."""
    ended = []

    def waiting(number):
        try:
            return summed(batches, range(9))
        finally:
            ended.append(number)

    def wrong():
        raise KeyError(batches.ask(-1 if at == "answers" else 1))

    def answer_all(numbers):
        if min(numbers) < 0:
            raise KeyError(1)
        return numbers

    batches, before = SideBySide(answer_all), threading.active_count()
    others = [partial(waiting, number) for number in (1, 2)]
    with pytest.raises(KeyError, match="1"):
        batches.run([wrong, *others] if at == "first" else [*others, wrong])
    assert ended == [1, 2]
    assert threading.active_count() == before


def test_rounding_is_treated_as_outside():
    batches = squares([])

    def divided():
        return np.ones(1) / np.zeros(1) + batches.ask(1)

    with np.errstate(divide="ignore"):
        assert batches.run([divided, divided]) == [np.inf, np.inf]


def test_common_batches_have_the_same_digits(bare, monkeypatch):
    """Of infills and pendulums, which have as many modes; without an appendage there is one less.

    Where one raises, the others are answered.
    """
    places = [(INFILL_12,), (INFILL_01,), (PENDULUM_1,), (PENDULUM_3,)]
    classes = [hypothesis(bare, own) for own in places]
    kinds = {in_common(made) for made in classes}
    assert len(kinds) == 1
    assert in_common(hypothesis(bare, ())) not in kinds
    motion = bs.Parameter("hz", bs.LogUniform(1.0, 3.0))
    moves = bare.with_structures(lambda structure, _: FurtherMode(structure, motion, like=0))
    farther = bare.with_structures(lambda structure, _: FurtherMode(structure, motion, like=1))
    assert in_common(moves) == in_common(farther) not in kinds
    z = np.random.default_rng(0).standard_normal((2, 200, len(classes[0].parameters)))
    questions = [(3, z[0]), (0, z[1, :7]), (3, z[1]), (1, z[0, 50:])]
    answers = common_log_likelihoods(classes)(questions)
    for (i, asked), answer in zip(questions, answers, strict=True):
        assert np.array_equal(answer, classes[i].log_likelihood_at(asked), equal_nan=True)
    assert np.isfinite(answers[0]).any()

    solved, last = bs.ShearBuilding.modes, classes[3].structure

    def modes(structure, values):
        if structure is last:
            raise ArithmeticError("no modes")
        return solved(structure, values)

    monkeypatch.setattr(bs.ShearBuilding, "modes", modes)
    error, answer = common_log_likelihoods(classes)(questions[:2])
    assert isinstance(error, ArithmeticError)
    assert np.array_equal(answer, answers[1], equal_nan=True)


def test_screening_side_by_side_changes_nothing(bare):
    """The one in the middle has a mode less."""
    none = screen((hypothesis(bare, ()), None), 0)
    wanted = [(hypothesis(bare, own), none) for own in ((INFILL_12,), (), (PENDULUM_1,))]
    for one, each in zip(screen_all(wanted, 0, bs.Run(), QUICK), wanted, strict=True):
        alone = screen(each, 0, QUICK)
        assert np.array_equal(one.z, alone.z)
        assert (one.log_evidence, one.error, one.n_evaluations) == (
            alone.log_evidence, alone.error, alone.n_evaluations,
        )  # fmt: skip
