"""Corrected strong motion (volume 2, ``.v2``) of the Center for Engineering Strong Motion Data.

Every channel has a heading of text with a line such as ``Chan  4:  Long  (Sta Chn:  6)``, numbers,
and then acceleration, velocity and displacement, each in fixed columns below a line such as
`` 3251 points of accel data equally spaced at  .020 sec, in cm/sec2. (8f10.6)``, and a last line,
``End of data for channel``. Channels of one station follow each other in one file, or have a file
each.
"""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_regular_file
from bayes_ssi.measurements.records.channels import Channels
from bayes_ssi.measurements.records.record import units_of
from bayes_ssi.measurements.records.tool_files import in_rows

# Endings; the second is that of another format, of COSMOS, which is refused by its content.
STRONG_MOTION = (".v2", ".v2c")
CHANNEL = re.compile(
    r"\s*chan\s+(\d+):\s*(.*?)\s*(\(sta chn:\s*(\d+)\).*|location:.*)?$", re.IGNORECASE
)
BLOCK = re.compile(
    r"\s*(?P<points>\d+) points of (?P<what>accel|veloc|displ) data equally spaced at\s+"
    r"(?P<step>\d*\.\d+) sec\b\W*(in|units:)\s+(?P<unit>[a-z]+[a-z0-9/]*)"
    r"(?!.*\((?!8f10\.))",
    re.IGNORECASE,
)
END = "end of data for channel"
# Numbers of a line, and characters of a number, which may touch the one before it.
NUMBERS, WIDTH = 8, 10


def read_strong_motion(path: Path, quantity: str) -> Channels:
    """Read one quantity of all channels of a file.

    Sensors are named by their number at the station, or else at the recorder, and direction:
    ``6 Long``, ``1 90 Deg``.

    Args:
        quantity: ``"acceleration"``, ``"velocity"`` or ``"displacement"``.
    """
    units_of(quantity)
    require_regular_file(path)
    name, blocks, ends = "", [], [False]
    with path.open(encoding="latin-1") as file:
        for line in file:
            if line.strip():
                ends.append(END in line.lower())
            if (channel := CHANNEL.match(line)) is not None:
                number, direction, _, at_station = channel.groups()
                name = " ".join(f"{at_station or number} {direction}".split())
            elif (block := BLOCK.match(line)) is not None:
                what, unit = block["what"].lower(), block["unit"].lower().replace("sec", "s")
                samples = _numbers(file, int(block["points"]), what)
                if quantity.startswith(what):
                    blocks.append((samples, name, 1.0 / float(block["step"]), unit))
    if not blocks:
        raise ValueError(
            f"holds no {quantity} as corrected strong motion (V2) has it, below a line such as "
            f"'3251 points of {quantity[:5]} data equally spaced at .020 sec, in ... (8f10.6)'"
        )
    if sum(ends) != len(blocks) or not ends[-1]:
        raise ValueError(
            f"{len(blocks)} channels have {quantity}, {sum(ends)} an 'End of data for channel'; is "
            "it damaged or truncated?"
        )
    rows, names, rates, units = zip(*blocks, strict=True)
    return Channels(in_rows(rows), names if all(names) else (), rates, (quantity,), units)


def _numbers(file: TextIO, points: int, what: str) -> FloatArray:
    """As many numbers as are announced, from the next lines."""
    numbers: list[str] = []
    for line in islice(file, -(-points // NUMBERS)):
        text = line.rstrip()
        numbers += [text[i : i + WIDTH] for i in range(0, len(text), WIDTH)]
    try:
        samples = np.array(numbers, dtype=float)
    except ValueError as error:
        raise ValueError(f"below '{points} points of {what} data': {error}") from None
    if len(samples) != points:
        raise ValueError(f"'{points} points of {what} data' are followed by {len(samples)} numbers")
    return samples
