"""Records in files of measuring systems: universal files (data sets 58) and TDMS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.text_files import require_regular_file
from bayes_ssi.foundations.universal_files import read_data_sets, response_direction
from bayes_ssi.measurements.records.channels import Channels
from bayes_ssi.measurements.records.record import Place

# Of data sets 58: functions that are time responses, and what their ordinates are.
TIME_RESPONSE = 1
ORDINATES = {8: "displacement", 11: "velocity", 12: "acceleration"}


def read_universal(path: Path) -> Channels:
    """Read the time responses (data sets 58) of a universal file.

    Sensors are named by node and direction, ``12 x``; what was measured against the direction of
    an axis is turned to it.
    """
    sets = [s for s in read_data_sets(path, 58) if s["func_type"] == TIME_RESPONSE]
    if not sets:
        raise ValueError("no data set 58 with a time response")
    if any(each["abscissa_spacing"] != 1 for each in sets):
        raise ValueError("a time response with uneven steps")
    directions = [response_direction(each) for each in sets]
    places: list[Place] = [
        (int(each["rsp_node"]), along[0]) if along else None
        for each, along in zip(sets, directions, strict=True)
    ]
    signs = [along[1] if along else 1.0 for along in directions]
    names = [f"{place[0]} {place[1]}" if place else "" for place in places]
    return Channels(
        in_rows([s * np.real(each["data"]) for s, each in zip(signs, sets, strict=True)]),
        tuple(names) if all(names) else (),
        tuple(1.0 / float(each["abscissa_inc"]) for each in sets),
        tuple(ORDINATES[k] for each in sets if (k := each["ordinate_spec_data_type"]) in ORDINATES),
        tuple(
            label
            for each in sets
            if (label := str(each["ordinate_axis_units_lab"]).strip()) not in ("", "NONE")
        ),
        tuple(places),
    )


def read_tdms(path: Path, keys: Sequence[str]) -> Channels:
    """Read the channels of a TDMS file."""
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise ValueError(
            'npTDMS is not installed; install it with pip install "bayes_ssi[tdms]"'
        ) from None
    require_regular_file(path)
    try:
        file = TdmsFile.read(str(path))
    except Exception as error:  # a damaged file may raise anything there
        reason = " ".join(str(error).split())
        raise ValueError(
            f"cannot be read; damaged or truncated? {type(error).__name__}: {reason}"
        ) from error
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
        tuple(1.0 / each["wf_increment"] for each in properties if each.get("wf_increment")),
        (),
        tuple(str(each["unit_string"]) for each in properties if each.get("unit_string")),
    )


def in_rows(rows: Sequence[np.ndarray]) -> FloatArray:
    """Channels as one array."""
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ValueError(f"channels of {lengths[0]} to {lengths[-1]} samples")
    return np.array(rows, dtype=float)
