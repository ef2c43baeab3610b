"""Every public name says what it takes, returns and raises, and its examples what they show."""

import dataclasses
import doctest
import inspect

import numpy as np
import pytest

import bayes_ssi as bs

EXPORTED = [(name, getattr(bs, name)) for name in bs.__all__]
MEMBERS = [
    (f"{name}.{own}", member)
    for name, kind in EXPORTED
    if inspect.isclass(kind)
    for own, member in vars(kind).items()
    if not own.startswith("_")
]


def function_of(member):
    """The function behind a method or property; None for any other member."""
    behind = getattr(member, "fget", None) or getattr(member, "func", None)
    function = behind or getattr(member, "__func__", member)
    return function if inspect.isfunction(function) else None


FUNCTIONS = [
    (name, function)
    for name, member in [*EXPORTED, *MEMBERS]
    if not inspect.isclass(member) and (function := function_of(member)) is not None
]


def parameters_of(function):
    parameters = inspect.signature(function).parameters.values()
    return [each for each in parameters if each.name not in ("self", "cls")]


def docstring(name, function):
    """Its own, or that of what it overrides."""
    if "." not in name:
        return inspect.getdoc(function)
    kind, own = name.split(".")
    inherited = (vars(base).get(own) for base in getattr(bs, kind).__mro__)
    functions = (function_of(member) for member in inherited if member is not None)
    return next((each.__doc__ for each in functions if each and each.__doc__), "")


@pytest.mark.parametrize(("name", "function"), FUNCTIONS, ids=[name for name, _ in FUNCTIONS])
def test_a_function_is_typed_and_described(name, function):
    text = docstring(name, function)
    assert text
    assert "return" in function.__annotations__, "says what it returns"
    assert {each.name for each in parameters_of(function)} <= set(function.__annotations__)
    if len(parameters_of(function)) > 1 and "Arguments" not in text:
        assert [p.name for p in parameters_of(function) if p.name not in text] == []
    if "    raise " in inspect.getsource(function):
        assert "rror" in text, "says what it raises"


CLASSES = [(name, kind) for name, kind in EXPORTED if dataclasses.is_dataclass(kind)]


@pytest.mark.parametrize("kind", [kind for _, kind in CLASSES], ids=[name for name, _ in CLASSES])
def test_a_record_describes_its_fields(kind):
    text = inspect.getdoc(kind)
    assert [field.name for field in dataclasses.fields(kind) if field.name not in text] == []
    if "__post_init__" in vars(kind):
        assert "Raises:" in text


def test_the_checks_above_are_made():
    assert len(FUNCTIONS) > 100
    assert len(CLASSES) > 20


def test_names_are_listed_once_and_in_order():
    assert bs.__all__ == sorted(set(bs.__all__))


FINDER = doctest.DocTestFinder(recurse=False)
EXAMPLES = {
    name: FINDER.find(getattr(bs, name), name, globs={"bs": bs, "np": np}) for name in bs.__all__
}
WITH_EXAMPLE = [name for name, (found, *_) in EXAMPLES.items() if found.examples]


def test_the_names_that_are_used_most_have_examples():
    assert len(WITH_EXAMPLE) >= 20


@pytest.mark.parametrize("name", WITH_EXAMPLE)
def test_an_example_gives_what_it_shows(name):
    runner = doctest.DocTestRunner(optionflags=doctest.REPORT_ONLY_FIRST_FAILURE)
    said = []
    runner.run(EXAMPLES[name][0], out=said.append)
    assert runner.failures == 0, "".join(said)
