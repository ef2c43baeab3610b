"""Labels of degrees of freedom from text files: a node and a direction a line."""

from __future__ import annotations

import re
from pathlib import Path

from bayes_ssi.structures.solver_files.directions import label
from bayes_ssi.structures.solver_files.number_lines import require_whole_lines

_LABEL = re.compile(r"(\S.*?)[\s.,;]+(\w+)")


def read_labels(path: Path) -> list[str]:
    """Labels "node direction" of lines such as ``12 x``, ``12 UX``, ``12 1`` or ``12.1``."""
    require_whole_lines(path)
    labels = []
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip()
            if not text:
                continue
            match = _LABEL.fullmatch(text)
            if match is None:
                raise ValueError(
                    f"{path}: line {number}: expected a node and a direction, got {text!r}"
                )
            try:
                labels.append(label(match[1], match[2]))
            except ValueError as error:
                raise ValueError(f"{path}: line {number}: {error}") from None
    return labels
