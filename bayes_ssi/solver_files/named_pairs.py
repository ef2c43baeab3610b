"""Stiffness and mass among the named matrices of one file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence

# Names as programs and engineers give them: K, KAA, KGG, KAAX, Kxx, stiffness, STIF1; M, MAA, mass.
_STIFFNESS = re.compile(r"(k|k(aa|gg|ff|nn|xx|aax|ggx)|stif.*)", re.IGNORECASE)
_MASS = re.compile(r"(m|m(aa|gg|ff|nn|xx|aax|ggx)|mass.*)", re.IGNORECASE)


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
    """Positions of stiffness and mass.

    Args:
        file: the file, for messages.
        names: of its matrices, each but once.
        keys: the two names, if the caller gave them; capitals do not matter.

    Raises:
        ValueError: a key is not among the names, or, without keys, the names do not tell which
            matrices are meant.
    """
    lower = [name.lower() for name in names]
    if keys is not None:
        for key in keys:
            if key.lower() not in lower:
                raise ValueError(f"{file}: no matrix {key!r}; it holds {_listed(names)}")
        return lower.index(keys[0].lower()), lower.index(keys[1].lower())
    found = [
        [i for i, name in enumerate(names) if pattern.fullmatch(re.sub(r" \d+$", "", name))]
        for pattern in (_STIFFNESS, _MASS)
    ]
    if any(len(each) != 1 for each in found):
        raise ValueError(
            f'{file}: name its stiffness and mass, as in keys=("KAA", "MAA"); it holds '
            f"{_listed(names)}"
        )
    return found[0][0], found[1][0]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names)) or "no matrix"
