"""Standard output: for one JSON record alone, and where its reader has gone."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Any


@contextmanager
def standard_output_on_standard_error() -> Iterator[None]:
    """Send to standard error what is printed: by Python, by libraries, and by new processes."""
    if sys.stdout is not None:  # None where it is closed
        sys.stdout.flush()
    with redirect_stdout(sys.stderr), _redirected_descriptor():
        yield


@contextmanager
def _redirected_descriptor() -> Iterator[None]:
    """Redirect also what is written to the descriptor, which processes started here inherit."""
    try:
        own, target = sys.__stdout__.fileno(), sys.__stderr__.fileno()  # type: ignore[union-attr]
        kept = os.dup(own)
    except (AttributeError, OSError, io.UnsupportedOperation):  # a stream without descriptor
        yield
        return
    os.dup2(target, own)
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(kept, own)
        os.close(kept)


def discard_standard_output() -> None:
    """Write to nowhere from now on: what is left in the buffer would fail again at the exit."""
    with suppress(AttributeError, OSError, io.UnsupportedOperation):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def json_text(record: Mapping[str, Any]) -> str:
    """The record as JSON; infinities and NaN are text."""
    from bayes_ssi.foundations.codec import to_record

    return json.dumps(to_record(record), indent=2, allow_nan=False)
