"""Progress of work in another process of this machine, through a file."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ProgressFile:
    """The last report of one piece of work; called by it like any function of progress.

    Where the file cannot be written, as by a worker on another machine, nothing is reported.
    """

    path: Path

    def __call__(self, name: str, step: str, done: float) -> None:
        # Replaced as a whole: what is read is never half a report.
        new = self.path.with_suffix(".new")
        with suppress(OSError):
            new.write_text(json.dumps([name, step, done]), encoding="utf-8")
            new.replace(self.path)

    def read(self) -> tuple[str, str, float] | None:
        """The last report; None if there is none."""
        try:
            name, step, done = json.loads(self.path.read_text(encoding="utf-8"))
        except OSError:
            return None
        return name, step, done
