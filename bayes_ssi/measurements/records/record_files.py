"""Files of vibration records and of ground motion, in any format that the package reads."""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.named_arrays import ARRAY_FILES
from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.foundations.text_files import (
    WORKBOOKS,
    damage_named,
    first_bytes,
    read_columns,
    require_regular_file,
)
from bayes_ssi.foundations.universal_files import begins_universal, has_data_set, read_data_sets
from bayes_ssi.measurements.modes.table_spellings import holds_modes
from bayes_ssi.measurements.records.channels import Channels, read_arrays_of_record
from bayes_ssi.measurements.records.record import (
    QUANTITIES,
    Record,
    checked_rate,
    checked_unit_of,
    quantity_of,
    units_of,
)
from bayes_ssi.measurements.records.text_columns import read_columns_of_record
from bayes_ssi.structures.response import UNITS, GroundMotion, checked_unit

# Of data sets 58, codes of directions, negative where a sensor points the other way; and what the
# ordinates of time responses are.
AXES = {1: "x", 2: "y", 3: "z"}
ORDINATES = {8: "displacement", 11: "velocity", 12: "acceleration"}

SEISMIC = (".mseed", ".miniseed", ".msd", ".sac")
MINISEED = re.compile(rb"\d{6}[DRQM][ \0]")  # as it begins; archives have the day for an ending
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"
# After "UNITS OF", "UNITS:" or "UNITS =" in the header of an AT2 file.
UNIT = r"\bunits?\s*(?:\bof\b|:|=)\s*([^\s,;.]+)"


@checked
def read_record(
    paths: str | Path | Sequence[str | Path],
    *,
    rate_hz: float | None = None,
    quantity: str | None = None,
    unit: str | None = None,
    sensors: Sequence[str] | None = None,
    keys: Sequence[str] = (),
) -> Record:
    """Read the record of one setup, from one file or several with channels of the same instants.

    Formats are columns of text or of a workbook
    (:mod:`bayes_ssi.measurements.records.text_columns`), arrays in MATLAB, numpy or HDF5 files
    (:mod:`bayes_ssi.measurements.records.channels`), universal files (data sets 58), TDMS,
    MiniSEED and SAC. What the files do not state must be given; what both state must agree.

    Args:
        paths: the file, or several.
        rate_hz: samples per second.
        quantity: ``"acceleration"``, ``"velocity"`` or ``"displacement"``.
        unit: of all samples.
        sensors: names of the sensors, in place of the files' own.
        keys: names of arrays, ``data.acc`` where they are in structures, or of groups of a TDMS
            file or the sheet of a workbook, to be read.

    Raises:
        OSError: a file cannot be read.
        ValueError: a file is not understood; rate, quantity or unit are missing or contradicted;
            files differ in their number of samples; or as for :class:`Record`.
    """
    files = [Path(path) for path in ([paths] if isinstance(paths, (str, Path)) else paths)]
    if not files:
        raise ValueError("read_record: no file is given")
    parts = []
    for path in files:
        with _named(path):
            parts.append(_read_file(path, keys, rate_hz))
    lengths = [part.samples.shape[1] for part in parts]
    for path, length in zip(files, lengths, strict=True):
        if length != lengths[0]:
            raise ValueError(
                f"{path}: {length} samples, but {lengths[0]} in {files[0]}; files of one setup "
                "hold the same instants"
            )
    whole = f"{files[0]}" + (f" and {len(files) - 1} more" if len(files) > 1 else "")
    channels = Channels.joined(parts)
    channels.samples.setflags(write=False)  # so that the record need not copy them
    names = tuple(sensors) if sensors is not None else channels.names
    rates = (*([] if rate_hz is None else [rate_hz]), *channels.rates_hz)
    quantities = (*([quantity] if quantity else []), *channels.quantities)
    units = (*([unit] if unit else []), *channels.units)
    if not quantities:  # a unit is that of one of them only
        quantities = tuple(dict.fromkeys(filter(None, map(quantity_of, units))))
    with _named(whole):
        _require(rates, quantities, units, names, len(channels.samples))
        kind = _agreed(quantities, "quantity")
        return Record(
            channels.samples,
            _agreed_rate(rates),
            names,
            kind,
            _agreed([checked_unit_of(kind, stated) for stated in units], "unit"),
            ", ".join(path.name for path in files),
        )


def _require(
    rates: Sequence[float], quantities: Sequence[str], units: Sequence[str], names: Sequence[str],
    n: int,
) -> None:  # fmt: skip
    """Name all at once what neither the files nor the caller state, with the commands' options."""
    kinds = ", ".join(map(repr, QUANTITIES))
    choices = "one of " + ", ".join(map(repr, units_of(quantities[0]))) if quantities else "it"
    wanted: dict[str, Sequence[object]] = {
        "rate_hz, the samples per second, is not given; give it in Hz (--rate)": rates,
        f"the quantity of the samples is not given; give one of {kinds} (--quantity)": quantities,
        f"the unit of the samples is not given; give {choices} (--unit)": units,
        f"the names of the {n} sensors are not given; give them as sensors (--sensor)": names,
    }
    if missing := [text for text, stated in wanted.items() if not stated]:
        raise ValueError("; ".join(missing))


@checked
def read_ground_motion(
    path: str | Path, *, unit: str | None = None, dt: float | None = None
) -> GroundMotion:
    """Read the acceleration of the ground from a PEER AT2 file or a record of one channel.

    Records are those of :func:`read_record`: columns of text, with the times in a column or dt in a
    line ``# dt_s, 0.005``; arrays; universal files; and TDMS.

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
    with _named(path):
        channels = _read_file(path, (), 1.0 / dt if dt else None)
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
        (samples,) = channels.samples
        if np.isnan(samples).any():
            raise ValueError(
                f"sample {int(np.isnan(samples).argmax()) + 1} is missing; a ground motion is one "
                "without gaps"
            )
        acceleration = UNITS[_agreed(units, "unit")] * samples
        return GroundMotion(acceleration, 1.0 / _agreed_rate(rates), path.stem)


def is_record(path: Path) -> bool:
    """Whether a file that exists holds a record rather than identified modes.

    A file of text does where none of its first lines names columns of modes.
    """
    suffix = path.suffix.lower()
    head = first_bytes(path)
    if suffix in (*ARRAY_FILES, ".tdms", *SEISMIC) or MINISEED.match(head):
        return True
    if begins_universal(head):
        return has_data_set(path, 58)
    return bool(head.strip()) and not holds_modes(path)


def _read_file(path: Path, keys: Sequence[str], rate_hz: float | None) -> Channels:
    """The channels of one file, and what it states of them."""
    suffix = path.suffix.lower()
    if suffix in ARRAY_FILES:
        return read_arrays_of_record(path, keys)
    if suffix == ".tdms":
        return read_tdms(path, keys)
    if keys and suffix not in WORKBOOKS:
        raise ValueError(f"keys are given, but a file of type {suffix!r} has none")
    if suffix in SEISMIC or MINISEED.match(first_bytes(path)):
        return read_seismic(path)
    if suffix == ".at2":
        return read_at2(path)
    if begins_universal(first_bytes(path)):
        return read_universal(path)
    return read_columns_of_record(path, rate_hz, keys)


@contextmanager
def _named(what: Path | str) -> Iterator[None]:
    """Begin the message of an error with the name of what is read."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{what}: {str(error).removeprefix(f'{what}: ')}") from None


def _agreed_rate(rates: Sequence[float]) -> float:
    """The rate that is stated, once or more often."""
    for rate in rates:
        # Files state a rate or its inverse, some to three digits.
        if not math.isclose(checked_rate(rate), rates[0], rel_tol=1e-3):
            raise ValueError(f"two rates are given: {rates[0]:g} and {rate:g} Hz")
    return rates[0]


def _agreed(stated: Sequence[str], what: str) -> str:
    """The one text that is stated, once or more often."""
    for other in stated:
        if other != stated[0]:
            raise ValueError(f"two of {what} are given: {stated[0]!r} and {other!r}")
    return stated[0]


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
    rates: list[float] = []
    for series in sets:
        code = int(series["rsp_dir"])
        axis = AXES.get(abs(code))  # none where it was measured about one, or that is not stated
        rows.append((-1.0 if axis and code < 0 else 1.0) * np.real(series["data"]))
        names.append(f"{int(series['rsp_node'])} {axis}" if axis else "")
        is_even = series["abscissa_spacing"] == 1
        steps = np.array([series["abscissa_inc"]]) if is_even else np.diff(series["x"])
        if not np.allclose(steps, steps.mean(), rtol=1e-2, atol=0.0):
            raise ValueError("a time response with uneven steps; resample it to equal ones first")
        rates.append(float(1.0 / steps.mean()))
    ordinates = [series["ordinate_spec_data_type"] for series in sets]
    units = [str(series["ordinate_axis_units_lab"]).strip() for series in sets]
    return Channels(
        in_rows(rows),
        tuple(names) if all(names) else (),
        tuple(rates),
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
    # In its newer form, NPTS= 3, DT= .01 SEC, or its older one.
    header = lines[at].strip()
    older = re.match(rf"(\d+)\s+({NUMBER})\s+NPTS", header, re.IGNORECASE)
    points = older or re.search(r"NPTS\s*=\s*(\d+)", header, re.IGNORECASE)
    if points is None:
        raise ValueError(f"the header's line {header!r} holds no number of points (NPTS)")
    steps = [older[2]] if older else re.findall(rf"DT\s*=\s*({NUMBER})", header, re.IGNORECASE)
    if not all(float(step) > 0.0 for step in steps):
        raise ValueError(f"dt must be positive, got {header!r}")
    units = re.findall(UNIT, " ".join(lines[:at]), re.IGNORECASE)
    samples: list[float] = []
    for i, line in enumerate(lines[at + 1 :], at + 2):
        # In AT2's fixed columns a minus sign may touch the number before it.
        if rest := re.sub(NUMBER, "", line).strip():
            raise ValueError(f"line {i}: expected accelerations, got {rest!r}")
        samples += [float(re.sub("[dD]", "e", each)) for each in re.findall(NUMBER, line)]
    if len(samples) != (n_points := int(points[1])):
        raise ValueError(f"the header says NPTS = {n_points}, but {len(samples)} values follow")
    rates = tuple(1.0 / float(step) for step in steps)
    return Channels(np.array([samples]), rates_hz=rates, units=tuple(units))


def in_rows(rows: Sequence[np.ndarray]) -> FloatArray:
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ValueError(f"channels of {lengths[0]} to {lengths[-1]} samples")
    return np.array(rows, dtype=float)
