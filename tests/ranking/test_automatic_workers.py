"""Workers of a run for which none were chosen: only where they are safe and save time."""

import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from delegating import DelegatingStructure

import bayes_ssi as bs
from bayes_ssi.studies.ranking import class_sampling as module
from bayes_ssi.studies.ranking.class_sampling import (
    automatic_workers,
    chosen_workers,
    holds_user_code,
)


@pytest.fixture(autouse=True)
def four_cores(monkeypatch):
    monkeypatch.setattr(module, "usable_cores", lambda: 4)
    monkeypatch.setattr(module, "can_copy", lambda: True)


@pytest.fixture
def n_workers():
    """The number of workers for some classes; 0 for none."""

    def number(classes, n_classes=None):
        workers = automatic_workers(classes, n_classes or len(classes))
        return workers.n_workers if workers else 0

    return number


def own_modes(k):
    return np.array([k]), np.ones((3, 1))


@pytest.fixture
def of_a_function(case_c):
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    structure = bs.FunctionStructure(own_modes, {"k": k}, n_modes=1, sensors=case_c.sensors)
    return bs.ModelClass("function", structure, case_c, pairing={"1": 1})


def test_as_many_as_are_busy(model_classes, n_workers, monkeypatch):
    classes = list(model_classes.values())
    assert n_workers(classes) == 4
    assert n_workers(classes[:3]) == 3
    assert n_workers(classes[:1]) == 0
    assert n_workers(classes[:1], n_classes=7) == 4, "hypotheses built on one class"
    monkeypatch.setattr(module, "usable_cores", lambda: 1)
    assert n_workers(classes) == 0
    # New processes for few small classes cost more than they save.
    monkeypatch.setattr(module, "usable_cores", lambda: 4)
    monkeypatch.setattr(module, "can_copy", lambda: False)
    assert (n_workers(classes[:3]), n_workers(classes)) == (0, 4)


def test_a_users_own_code_stays_in_this_process(model_classes, of_a_function, n_workers):
    classes = list(model_classes.values())
    assert n_workers([*classes, of_a_function]) == 0
    own = replace(classes[0], name="own", structure=DelegatingStructure(classes[0].structure))
    assert n_workers([*classes, own]) == 0
    # Unless workers are asked for; these are no copies of a process that ran the user's code.
    chosen = chosen_workers([*classes, own], 2)
    assert (chosen.n_workers, chosen.copies) == (2, False)
    assert chosen_workers(classes, 99).n_workers == 4
    assert chosen_workers(classes, 2).copies


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ([np.arange(3.0), "text", {"k": bs.LogNormal(1.0, 0.3)}, partial(np.sum, axis=0)], False),
        ([own_modes], True),
        ({"k": lambda x: x}, True),
        (threading.Lock(), True),
    ],
    ids=["data", "function", "lambda", "cannot be pickled"],
)
def test_what_is_a_users_own_code(what, expected):
    assert holds_user_code(what) is expected
