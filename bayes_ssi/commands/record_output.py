"""Standard output for one JSON record alone."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from typing import Any


@contextmanager
def standard_output_on_standard_error() -> Iterator[None]:
    """Send to standard error what is printed: by Python, by libraries, and by new processes."""
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


def json_text(record: Mapping[str, Any]) -> str:
    """The record as JSON; infinities and NaN are text."""
    from bayes_ssi.codec import to_record

    return json.dumps(to_record(record), indent=2, allow_nan=False)
