"""Checks of arguments, so that a wrong one is named where it is given.

Against type hints, and against the names or values to choose from.
"""

import inspect
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache, wraps
from itertools import islice
from numbers import Integral, Real
from os import PathLike
from types import NoneType, UnionType
from typing import (
    Any,
    Generic,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

NAMES = {str: "text", int: "a whole number", float: "a number", bool: "True or False"}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which first checks its arguments against its type hints."""

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        signature, hints, name = _described(function)
        for argument, value in signature.bind(*args, **kwargs).arguments.items():
            if argument in hints:
                require(value, hints[argument], f"{name}: {argument}")
        return function(*args, **kwargs)

    return call


def require(value: Any, hint: Any, name: str) -> None:
    """Check that a value has a type; ``name`` is what the message calls it."""
    if not _fits(value, hint):
        shown = repr(value)
        # The most that keeps a message to two lines of a terminal.
        shown = shown if len(shown) <= 80 else f"{shown[:80]}…"
        raise TypeError(f"{name} must be {_words(hint)}, got {shown}")


@cache
def _described(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any], str]:
    """Signature, type hints, and the name by which it is called."""
    name = function.__qualname__.removesuffix(".__init__")
    return inspect.signature(function), get_type_hints(function), name


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value has a type. Hints that are not checked fit; iterators are not consumed."""
    hint = _without_arguments(hint)
    kind, parts = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if kind in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if kind is Literal:
        return value in parts
    if kind is Callable or hint is Callable:
        return callable(value)
    if isinstance(kind, type) and issubclass(kind, Mapping):
        if not isinstance(value, Mapping):
            return False
        return all(_fits(k, parts[0]) and _fits(v, parts[1]) for k, v in value.items())
    if isinstance(kind, type) and issubclass(kind, Iterable) and kind.__module__ != "numpy":
        if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
            return False
        if isinstance(value, Iterator):  # it can be read only once
            return True
        if getattr(value, "ndim", 1) == 0:
            return False
        if _is_record(hint):  # the function itself says what a wrong number of items lacks
            return all(map(_fits, value, parts))
        return all(_fits(item, parts[0]) for item in value)
    if hint in (int, float):
        number = Integral if hint is int else Real
        return isinstance(value, number) and not isinstance(value, bool)
    return isinstance(value, hint) if isinstance(hint, type) else True


def _without_arguments(hint: Any) -> Any:
    """The class of a hint such as ``SearchResult[Any]``; other hints as they are."""
    kind = get_origin(hint)
    return kind if Generic in getattr(kind, "__mro__", ()) else hint


def _is_record(hint: Any) -> bool:
    """Whether a hint is that of a tuple with a type for each place."""
    return get_origin(hint) is tuple and Ellipsis not in get_args(hint)


def _words(hint: Any) -> str:
    """A type in words: ``a Study``, ``text or a path``, ``ModelClasses in a sequence``."""
    hint = _without_arguments(hint)
    kind, parts = get_origin(hint), get_args(hint)
    if hint is Any:
        return "anything"
    if kind in (Union, UnionType):
        return " or ".join(_words(part) for part in parts if part is not NoneType)
    if kind is Literal:
        return " or ".join(map(repr, parts))
    if kind is Callable or hint is Callable:
        return "a function"
    if isinstance(kind, type) and issubclass(kind, Mapping):
        return f"a mapping of {_words(parts[0])} to {_words(parts[1])}"
    if _is_record(hint):
        return f"({', '.join(map(_words, parts))})"
    if kind is not None:
        return f"a sequence, each item {_words(parts[0])}"
    if isinstance(hint, type) and issubclass(hint, PathLike):
        return "a path"
    if hint in NAMES:
        return NAMES[hint]
    name = str(getattr(hint, "__name__", hint))
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def require_known(
    what: str, names: Iterable[object], choices: Collection[object], besides: str = ""
) -> None:
    """Refuse the first of ``names`` that is not one of ``choices``, or of what is ``besides``.

    ``what`` says where the name stands and what is missing: "study 'A': no model class".
    """
    for name in names:
        if name not in choices:
            raise ValueError(f"{what} {name!r}; choose from {listed_choices(choices)}{besides}")


def repeated(names: Iterable[T]) -> list[T]:
    """Those names that occur more than once, each once."""
    return [name for name, count in Counter(names).items() if count > 1]


def require_one_of(what: str, value: object, choices: Collection[object]) -> None:
    """Refuse a ``value`` of an argument, which the message calls ``what``."""
    if value not in choices:
        raise ValueError(f"{what} must be one of {listed_choices(choices)}, got {value!r}")


def listed_choices(choices: Collection[object], most: int = 30) -> str:
    """Choices for a message, shortened where there are many."""
    shown = ", ".join(map(repr, islice(choices, most))) or "nothing"
    return shown if len(choices) <= most else f"{shown} and {len(choices) - most} more"
