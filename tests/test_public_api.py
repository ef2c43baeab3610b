"""Everything that the package exports says what it takes, gives and raises."""

import dataclasses
import inspect

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
    plain = getattr(member, "fget", None) or getattr(member, "func", None)
    found = plain or getattr(member, "__func__", member)
    return found if inspect.isfunction(found) else None


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
    return next((found.__doc__ for found in functions if found and found.__doc__), "")


@pytest.mark.parametrize(("name", "function"), FUNCTIONS, ids=[name for name, _ in FUNCTIONS])
def test_a_function_is_typed_and_described(name, function):
    told = docstring(name, function)
    assert told
    assert function.__annotations__.get("return"), "says what it returns"
    assert {each.name for each in parameters_of(function)} <= set(function.__annotations__)
    if len(parameters_of(function)) > 1 and "Arguments" not in told:
        assert [p.name for p in parameters_of(function) if p.name not in told] == []
    if "    raise " in inspect.getsource(function):
        assert "rror" in told, "says what it raises"


CLASSES = [(name, kind) for name, kind in EXPORTED if dataclasses.is_dataclass(kind)]


@pytest.mark.parametrize("kind", [kind for _, kind in CLASSES], ids=[name for name, _ in CLASSES])
def test_a_record_describes_its_fields(kind):
    told = inspect.getdoc(kind)
    assert [field.name for field in dataclasses.fields(kind) if field.name not in told] == []
    if "__post_init__" in vars(kind):
        assert "Raises:" in told


def test_the_checks_above_check_something():
    assert len(FUNCTIONS) > 100
    assert len(CLASSES) > 20
    assert set(bs.__all__) >= {"rank", "ModelClass", "load_predictions"}
