"""One line for a name or a value that is not among those to choose from."""

from collections.abc import Collection, Iterable
from itertools import islice


def require_known(
    what: str, names: Iterable[object], choices: Collection[object], besides: str = ""
) -> None:
    """Refuse the first of ``names`` that is not one of ``choices``, or of what is ``besides``.

    ``what`` says where the name stands and what is missing: "study 'A': no model class".
    """
    for name in names:
        if name not in choices:
            raise ValueError(f"{what} {name!r}; choose from {listed_choices(choices)}{besides}")


def require_one_of(what: str, value: object, choices: Collection[object]) -> None:
    """Refuse a ``value`` of an argument, which the message calls ``what``."""
    if value not in choices:
        raise ValueError(f"{what} must be one of {listed_choices(choices)}, got {value!r}")


def listed_choices(choices: Collection[object], most: int = 30) -> str:
    """Choices for a message, shortened where there are many."""
    shown = ", ".join(map(repr, islice(choices, most))) or "nothing"
    return shown if len(choices) <= most else f"{shown} and {len(choices) - most} more"
