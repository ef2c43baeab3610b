"""JSON records on disk, with infinities and NaN as text."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["plain_record", "read_json", "write_json"]


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write a record; infinities and NaN as text."""
    text = json.dumps(plain_record(record), indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def plain_record(value: Any) -> Any:
    """The value as JSON has it: numpy's numbers as numbers, and infinities and NaN as text."""
    if isinstance(value, Mapping):
        return {str(key): plain_record(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_record(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def read_json(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise ValueError(f"{path.parent}: not a result directory: no {path.name}") from None
    except ValueError as error:
        raise ValueError(f"{path}: damaged: {error}") from None
    if not isinstance(record, dict):
        raise ValueError(f"{path}: damaged: not a record")
    return record
