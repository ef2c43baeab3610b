"""Imports of packages without optional dependencies that take longer to import than they do."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def importing_without(optional: str, package: str) -> Iterator[None]:
    """Within it, ``package`` is imported as if ``optional`` were not installed.

    Whoever imports the package later gets another copy of it, a whole one. Where either is
    imported already, nothing is left out.
    """
    if optional in sys.modules or package in sys.modules:
        yield
        return
    sys.modules[optional] = None  # type: ignore[assignment]  # importing it fails
    try:
        yield
    finally:
        del sys.modules[optional]
        for name in list(sys.modules):
            if name == package or name.startswith(f"{package}."):
                del sys.modules[name]
