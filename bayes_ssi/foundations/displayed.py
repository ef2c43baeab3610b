"""How objects show themselves: a line as ``repr``, a table on ``print`` and in notebooks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import fields
from functools import singledispatch
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame


class Displayed(ABC):
    """An object that users meet. Dataclasses that inherit this are made with ``repr=False``."""

    @abstractmethod
    def _line(self) -> str:
        """What it is, in a few words."""

    @abstractmethod
    def _rows(self) -> Iterable[dict[str, Any]]:
        """The rows of its table: column → value."""

    def to_frame(self) -> DataFrame:
        """Its table as a pandas frame, and so as CSV, LaTeX or a spreadsheet.

        Columns without any value are left out.
        """
        import pandas as pd

        return pd.DataFrame(list(self._rows())).dropna(axis="columns", how="all")

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._line()}>"

    def __str__(self) -> str:
        table = self.to_frame()
        return f"{self._line()}\n{table.to_string(index=False, float_format='{:.5g}'.format)}"

    def _repr_html_(self) -> str:
        table = self.to_frame().to_html(index=False, float_format="{:.5g}".format, border=0)
        return f"<p>{escape(self._line())}</p>\n{table}"


class InWords(Displayed):
    """A result that can be put into words."""

    def summary(self) -> str:
        """The answer in words, as the command line prints it."""
        return in_words(self)


@singledispatch
def in_words(result: object) -> str:
    """A result in words; whatever knows how to say one kind of result registers it here."""
    raise TypeError(f"no words for {result!r}")


def columns(record: Any, names: Sequence[str] = ()) -> dict[str, Any]:
    """Fields of a dataclass, all if no names are given, for a row of a table."""
    chosen = names or [item.name for item in fields(record)]
    return {name: getattr(record, name) for name in chosen}


def counted(number: int, what: str) -> str:
    """A number with its noun: ``1 mode``, ``2 modes``."""
    return f"{number} {what}{'' if number == 1 else 's' if what[-1] != 's' else 'es'}"


def listed(items: Iterable[object]) -> str:
    """A list in a sentence: a, b and c."""
    *first, last = map(str, items)
    return f"{', '.join(first)} and {last}" if first else last
