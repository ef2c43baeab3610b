"""Files of ground motion: PEER's AT2, and records of one channel in any format.

AT2: header lines of which one states the unit and the last the number of points and dt, then the
accelerations in rows.
"""

import math
import re
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.text_files import read_columns
from bayes_ssi.measurements.records.channels import Channels
from bayes_ssi.measurements.records.record_files import agreed, agreed_rate, read_file_of_record
from bayes_ssi.structures.response.ground_motion import UNITS, GroundMotion, checked_unit

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"
# After "UNITS OF", "UNITS:" or "UNITS =" in the header of an AT2 file.
UNIT = r"\bunits?\s*(?:\bof\b|:|=)\s*([^\s,;.]+)"


@checked
def read_ground_motion(
    path: str | Path, *, unit: str | None = None, dt: float | None = None
) -> GroundMotion:
    """Read the acceleration of the ground from a PEER AT2 file or a record of one channel.

    Records are those of :func:`read_record`: columns of text, with the times in a column or dt in a
    line ``# dt_s, 0.005``; arrays; universal files; TDMS; and strong motion.

    Args:
        path: the file; one whose name ends in .AT2 is read as PEER's.
        unit: "g", "m/s2" or "cm/s2", for instance, in place of the file's; needed where the file
            states none.
        dt: time between samples in s; needed where the file does not state it.

    Raises:
        OSError: the file cannot be read.
        ValueError: the content is not understood, unit or dt are missing, dt is contradicted by
            the file, or there are fewer than two samples. The message names the file.
    """
    path = Path(path)
    try:
        is_at2 = path.suffix.lower() == ".at2"
        channels = _read_at2(path) if is_at2 else read_file_of_record(path, (), "acceleration")
        if len(channels.samples) != 1:
            held = ", ".join(map(repr, channels.names)) or "without names"
            raise ValueError(
                f"{len(channels.samples)} channels ({held}); a ground motion is one, beside a "
                "column of times named time"
            )
        for quantity in channels.quantities:
            if quantity != "acceleration":
                raise ValueError(f"the file holds a {quantity}, not an acceleration")
        units = [checked_unit(each) for each in (channels.units if unit is None else [unit])]
        if not units:
            choices = ", ".join(map(repr, UNITS))
            raise ValueError(f"the unit of the acceleration is not given; give one of {choices}")
        if dt is not None and not 0 < dt < math.inf:
            raise ValueError(f"dt must be positive and finite (s), got {dt!r}")
        rates = (*([] if dt is None else [1.0 / dt]), *channels.rates_hz)
        if not rates:
            raise ValueError("dt, the time between samples, is not given; give it in s")
        acceleration = UNITS[agreed(units, "unit")] * channels.samples[0]
        return GroundMotion(acceleration, 1.0 / agreed_rate(rates), path.stem)
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def _read_at2(path: Path) -> Channels:
    lines = read_columns(path)[0].splitlines()
    at = next((i for i, line in enumerate(lines) if "NPTS" in line.upper()), None)
    if at is None:
        raise ValueError("not a PEER AT2 file: no header line states NPTS and DT")
    n_points, rates = _points_and_rates(lines[at])
    units = re.findall(UNIT, " ".join(lines[:at]), re.IGNORECASE)
    samples: list[float] = []
    for i, line in enumerate(lines[at + 1 :], at + 2):
        # In AT2's fixed columns a minus sign may touch the number before it.
        if rest := re.sub(NUMBER, "", line).strip():
            raise ValueError(f"line {i}: expected accelerations, got {rest!r}")
        samples += [float(re.sub("[dD]", "e", each)) for each in re.findall(NUMBER, line)]
    if len(samples) != n_points:
        raise ValueError(f"the header says NPTS = {n_points}, but {len(samples)} values follow")
    return Channels(np.array([samples]), rates_hz=tuple(rates), units=tuple(units))


def _points_and_rates(line: str) -> tuple[int, list[float]]:
    """NPTS and 1/DT of an AT2 header, in its newer form (NPTS= 3, DT= .01 SEC) or its older one."""
    older = re.match(rf"\s*(\d+)\s+({NUMBER})\s+NPTS", line, re.IGNORECASE)
    points = older or re.search(r"NPTS\s*=\s*(\d+)", line, re.IGNORECASE)
    if points is None:
        raise ValueError(f"the header's line {line.strip()!r} holds no number of points (NPTS)")
    steps = [older[2]] if older else re.findall(rf"DT\s*=\s*({NUMBER})", line, re.IGNORECASE)
    if not all(float(step) > 0.0 for step in steps):
        raise ValueError(f"dt must be positive, got {line.strip()!r}")
    return int(points[1]), [1.0 / float(step) for step in steps]
