"""Records in files of measuring systems: universal files, TDMS, MiniSEED, SAC, strong motion, AT2.

Corrected strong motion (volume 2, ``.v2``) is that of the Center for Engineering Strong Motion
Data. Every channel has a heading of text with a line such as ``Chan  4:  Long  (Sta Chn:  6)``,
numbers, and then acceleration, velocity and displacement, each in fixed columns below a line such
as `` 3251 points of accel data equally spaced at  .020 sec, in cm/sec2. (8f10.6)``, and a last
line, ``End of data for channel``. Channels of one station follow each other in one file, or have a
file each.
"""

import re
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.foundations.text_files import damage_named, read_columns, require_regular_file
from bayes_ssi.foundations.universal_files import read_data_sets, response_direction
from bayes_ssi.measurements.records.channels import Channels
from bayes_ssi.measurements.records.record import units_of

# Of data sets 58, what the ordinates of time responses are.
ORDINATES = {8: "displacement", 11: "velocity", 12: "acceleration"}

# Endings; the second is that of another format, of COSMOS, which is refused by its content.
STRONG_MOTION = (".v2", ".v2c")
SEISMIC = (".mseed", ".miniseed", ".msd", ".sac")
CHANNEL_LINE = re.compile(
    r"\s*chan\s+(\d+):\s*(.*?)\s*(\(sta chn:\s*(\d+)\).*|location:.*)?$", re.IGNORECASE
)
BLOCK_LINE = re.compile(
    r"\s*(?P<points>\d+) points of (?P<what>accel|veloc|displ) data equally spaced at\s+"
    r"(?P<step>\d*\.\d+) sec\b\W*(in|units:)\s+(?P<unit>[a-z]+[a-z0-9/]*)"
    r"(?!.*\((?!8f10\.))",
    re.IGNORECASE,
)
END_OF_CHANNEL = "end of data for channel"
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"
# After "UNITS OF", "UNITS:" or "UNITS =" in the header of an AT2 file.
UNIT = r"\bunits?\s*(?:\bof\b|:|=)\s*([^\s,;.]+)"


def read_universal(path: Path) -> Channels:
    """Read the time responses (data sets 58) of a universal file.

    Sensors are named by node and direction, ``12 x``; what was measured against the direction of
    an axis is turned to it.
    """
    sets = [s for s in read_data_sets(path, 58) if s["func_type"] == 1]  # of time
    if not sets:
        raise ValueError("no data set 58 with a time response")
    if any(series["abscissa_spacing"] != 1 for series in sets):
        raise ValueError("a time response with uneven steps")
    rows: list[np.ndarray] = []
    names: list[str] = []
    for series in sets:
        along = response_direction(series)
        direction, sign = along or ("", 1.0)
        rows.append(sign * np.real(series["data"]))
        names.append(f"{int(series['rsp_node'])} {direction}" if along else "")
    ordinates = [series["ordinate_spec_data_type"] for series in sets]
    units = [str(series["ordinate_axis_units_lab"]).strip() for series in sets]
    return Channels(
        in_rows(rows),
        tuple(names) if all(names) else (),
        tuple(1.0 / float(series["abscissa_inc"]) for series in sets),
        tuple(ORDINATES[kind] for kind in ordinates if kind in ORDINATES),
        tuple(unit for unit in units if unit not in ("", "NONE")),
    )


def read_tdms(path: Path, keys: Sequence[str]) -> Channels:
    with optional_package("npTDMS", extra="tdms"):
        from nptdms import TdmsFile
    require_regular_file(path)
    with damage_named(path):
        file = TdmsFile.read(str(path))
    groups = {group.name: group for group in file.groups()}
    require_known("no group", keys, groups)
    chosen = [groups[key] for key in keys] or list(groups.values())
    channels = [channel for group in chosen for channel in group.channels() if len(channel)]
    if not channels:
        raise ValueError("holds no channels")
    if any(channel[:].dtype.kind not in "iuf" for channel in channels):
        raise ValueError("holds channels that are not numbers; name the groups to read by keys")
    properties = [channel.properties for channel in channels]
    return Channels(
        in_rows([channel[:] for channel in channels]),
        tuple(channel.name for channel in channels),
        tuple(1.0 / stated["wf_increment"] for stated in properties if stated.get("wf_increment")),
        (),
        tuple(str(stated["unit_string"]) for stated in properties if stated.get("unit_string")),
    )


def begins_miniseed(head: bytes) -> bool:
    """Whether a file begins as MiniSEED does, whose archives have the day for an ending."""
    return re.match(rb"\d{6}[DRQM][ \0]", head) is not None


def read_seismic(path: Path) -> Channels:
    """Read MiniSEED or SAC from the last beginning to the first end of its traces, with gaps.

    Sensors are named ``network.station.location.channel``.
    """
    with optional_package("obspy", extra="seismic"):
        import obspy
    require_regular_file(path)
    with damage_named(path):
        stream = obspy.read(str(path)).merge()
        stream.trim(
            max(trace.stats.starttime for trace in stream),
            min(trace.stats.endtime for trace in stream),
        )
    return Channels(
        in_rows([np.ma.filled(np.ma.asarray(trace.data, dtype=float), np.nan) for trace in stream]),
        tuple(trace.id for trace in stream),
        tuple(float(trace.stats.sampling_rate) for trace in stream),
    )


def read_strong_motion(path: Path, quantity: str) -> Channels:
    """Read one quantity of all channels of a file.

    Sensors are named by their number at the station, or else at the recorder, and direction:
    ``6 Long``, ``1 90 Deg``.
    """
    units_of(quantity)
    require_regular_file(path)
    name, blocks, ends = "", [], [False]
    with path.open(encoding="latin-1") as file:
        for line in file:
            if line.strip():
                ends.append(END_OF_CHANNEL in line.lower())
            if (channel := CHANNEL_LINE.match(line)) is not None:
                number, direction, _, at_station = channel.groups()
                name = " ".join(f"{at_station or number} {direction}".split())
            elif (block := BLOCK_LINE.match(line)) is not None:
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
    for line in islice(file, -(-points // 8)):  # 8f10: ten characters, which may touch
        text = line.rstrip()
        numbers += [text[i : i + 10] for i in range(0, len(text), 10)]
    try:
        samples = np.array(numbers, dtype=float)
    except ValueError as error:
        raise ValueError(f"below '{points} points of {what} data': {error}") from None
    if len(samples) != points:
        raise ValueError(f"'{points} points of {what} data' are followed by {len(samples)} numbers")
    return samples


def read_at2(path: Path) -> Channels:
    """Read PEER's AT2: a header, whose last line has the number of points and dt, then numbers."""
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


def in_rows(rows: Sequence[np.ndarray]) -> FloatArray:
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ValueError(f"channels of {lengths[0]} to {lengths[-1]} samples")
    return np.array(rows, dtype=float)
