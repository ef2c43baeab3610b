"""Progress of what other processes of this machine do, told by small files.

Executors carry answers and no messages on the way; a file for each item does without any more of
them. Where there is no common file system nothing is told.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic

__all__ = ["ProgressFile", "ProgressReader"]

# Writing more often than this shows no one anything.
SECONDS_BETWEEN = 0.2


class ProgressFile:
    """Writes the progress of one item; called with its name, a step, and the share done."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._written = -SECONDS_BETWEEN
        self._step = ""

    def __call__(self, name: str, step: str, done: float) -> None:
        del name  # known to whoever reads
        now = monotonic()
        if step == self._step and now - self._written < SECONDS_BETWEEN:
            return
        self._written, self._step = now, step
        try:
            # In one move, so that nobody reads half of it.
            Path(f"{self.path}.new").write_text(f"{done!r} {step}", encoding="utf-8")
            os.replace(f"{self.path}.new", self.path)
        except OSError:
            return  # another machine's, or the reader has gone


class ProgressReader:
    """Passes on what the files of several items say.

    Args:
        directory: of the files, for this reader alone.
        names: of the items.
        report: called with a name, a step, and the share of it that is done.
    """

    def __init__(
        self,
        directory: str,
        names: Sequence[str],
        report: Callable[[str, str, float], None],
    ) -> None:
        self._paths = [Path(directory).absolute() / str(i) for i in range(len(names))]
        self._names = names
        self._report = report
        self._told = [""] * len(names)
        self._ended = [False] * len(names)

    def file(self, index: int) -> ProgressFile:
        """Where one item's progress is to be written, for its process."""
        return ProgressFile(str(self._paths[index]))

    def tell(self) -> None:
        """Pass on what is new, but the end of an item, which only its answer tells."""
        for i, path in enumerate(self._paths):
            if self._ended[i]:
                continue
            try:
                text = path.read_text(encoding="utf-8")
            except OSError:
                continue  # not begun
            done, step = text.split(" ", 1)
            if text != self._told[i] and (step, float(done)) != ("evidence", 1.0):
                self._told[i] = text
                self._report(self._names[i], step, float(done))

    def end(self, index: int) -> None:
        """One item's answer is here."""
        self._ended[index] = True
        self._report(self._names[index], "evidence", 1.0)
