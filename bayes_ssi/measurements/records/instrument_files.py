"""Records in files of measuring systems: universal files, TDMS, MiniSEED, SAC and AT2."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.foundations.text_files import damage_named, read_columns, require_regular_file
from bayes_ssi.foundations.universal_files import read_data_sets, response_direction
from bayes_ssi.measurements.records.channels import Channels

# Of data sets 58, what the ordinates of time responses are.
ORDINATES = {8: "displacement", 11: "velocity", 12: "acceleration"}

SEISMIC = (".mseed", ".miniseed", ".msd", ".sac")
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
        tuple(map(_rate_of, sets)),
        tuple(ORDINATES[kind] for kind in ordinates if kind in ORDINATES),
        tuple(unit for unit in units if unit not in ("", "NONE")),
    )


def _rate_of(series: Mapping[str, Any]) -> float:
    """Samples per second of a time response, by its instants where they are stated one by one."""
    if series["abscissa_spacing"] == 1:
        return 1.0 / float(series["abscissa_inc"])
    steps = np.diff(series["x"])
    if not np.allclose(steps, steps.mean(), rtol=1e-2, atol=0.0):
        raise ValueError("a time response with uneven steps; resample it to equal ones first")
    return float(1.0 / steps.mean())


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
