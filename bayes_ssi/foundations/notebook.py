"""Progress in notebooks."""

import sys
import time
from collections.abc import Callable
from typing import Any


def notebook_progress() -> Callable[[str, str, float], None] | None:
    """A function that shows progress below the cell that runs; None outside of notebooks.

    It takes the name of what is computed, the name of the step and the completed share of it.
    """
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return _Lines() if getattr(shell, "kernel", None) else None


class _Lines:
    """A line for each name, replaced as it goes on, five times a second."""

    def __init__(self) -> None:
        self.lines: dict[str, str] = {}
        self.shown_at = float("-inf")
        self.handle: Any = None

    def __call__(self, name: str, step: str, done: float) -> None:
        self.lines[name] = f"{name}: {step} {100.0 * done:.0f} %"
        if done < 1.0 and time.monotonic() - self.shown_at < 0.2:
            return
        self.shown_at = time.monotonic()
        from IPython.display import display

        shown = {"text/plain": "\n".join(self.lines.values())}
        if self.handle is None:
            self.handle = display(shown, raw=True, display_id=True)
        else:
            self.handle.update(shown, raw=True)
