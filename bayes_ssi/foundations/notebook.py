"""Progress in notebooks."""

import sys
import time
from collections.abc import Callable


def notebook_progress() -> Callable[[str, str, float], None] | None:
    """A function that shows progress below the cell that runs; None outside of notebooks.

    It takes the name of what is computed, the name of the step and the completed share of it.
    """
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return _lines() if getattr(shell, "kernel", None) else None


def _lines() -> Callable[[str, str, float], None]:
    """A line for each name, replaced as it goes on, five times a second."""
    lines: dict[str, str] = {}
    shown_at, handle = float("-inf"), None

    def show(name: str, step: str, done: float) -> None:
        nonlocal shown_at, handle
        lines[name] = f"{name}: {step} {100.0 * done:.0f} %"
        if done < 1.0 and time.monotonic() - shown_at < 0.2:
            return
        shown_at = time.monotonic()
        from IPython.display import display

        shown = {"text/plain": "\n".join(lines.values())}
        if handle is None:
            handle = display(shown, raw=True, display_id=True)
        else:
            handle.update(shown, raw=True)

    return show
