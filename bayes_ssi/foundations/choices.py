"""One line for a name that is not among those to choose from."""

from __future__ import annotations

from collections.abc import Collection, Iterable


def require_known(what: str, names: Iterable[object], choices: Collection[object]) -> None:
    """Refuse the first of ``names`` that is not one of ``choices``.

    Args:
        what: where the name stands and what is missing, such as "study 'A': no model class".

    Raises:
        ValueError: with the name and the choices.
    """
    for name in names:
        if name not in choices:
            listed = ", ".join(map(repr, choices)) or "nothing"
            raise ValueError(f"{what} {name!r}; choose from {listed}")
