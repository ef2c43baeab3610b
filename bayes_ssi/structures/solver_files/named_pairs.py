"""Stiffness and mass among the named matrices of one file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence

# K, KAA, kxx, stiffness, STIF1 and M, MAA, mxx, mass, MASS1: a pair has the same rest.
_STIFFNESS = re.compile(r"(?:stiffness|stif|k)(.*)", re.IGNORECASE)
_MASS = re.compile(r"(?:mass|m)(.*)", re.IGNORECASE)


def numbered(names: Iterable[str]) -> tuple[str, ...]:
    """Names of which the second of one name becomes "kaa 2"."""
    seen: Counter[str] = Counter()
    unique = []
    for name in names:
        seen[name.lower()] += 1
        unique.append(name if seen[name.lower()] == 1 else f"{name} {seen[name.lower()]}")
    return tuple(unique)


def chosen_pair(
    file: object, names: Sequence[str], keys: tuple[str, str] | None
) -> tuple[int, int]:
    """Positions of stiffness and mass."""
    lower = [name.lower() for name in names]
    if keys is not None:
        for key in keys:
            if key.lower() not in lower:
                raise ValueError(f"{file}: no matrix {key!r}; it holds {_listed(names)}")
        return lower.index(keys[0].lower()), lower.index(keys[1].lower())
    masses = {match[1]: i for i, name in enumerate(lower) if (match := _MASS.fullmatch(name))}
    pairs = [
        (i, masses[match[1]])
        for i, name in enumerate(lower)
        if (match := _STIFFNESS.fullmatch(name)) and match[1] in masses
    ]
    if len(pairs) != 1:
        raise ValueError(
            f'{file}: name its stiffness and mass, as in --keys KAA,MAA, or keys=("KAA", "MAA") in '
            f"Python; it holds {_listed(names)}"
        )
    return pairs[0]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names)) or "no matrix"
