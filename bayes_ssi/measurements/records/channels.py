"""What one file holds of a record: channels, and what the file states about them.

In a file of named arrays (MATLAB .mat, numpy .npz and HDF5) an array of samples has a row or a
column for each sensor; its longer side is time. Scalars ``rate_hz`` or ``dt_s`` and texts
``quantity`` and ``unit`` in the same file (for HDF5 also attributes of the array) state what the
samples are, and ``sensors`` their names; so do ``fs``, ``dt`` and ``names``. A vector ``t`` or
``time`` in s gives the rate, as does a first row or column of equal steps. They may be fields of
MATLAB's structures, ``data.acc`` beside ``data.fs``.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray, IntArray
from bayes_ssi.foundations.named_arrays import read_arrays

# Names under which files of arrays, attributes and comments state what the samples are.
STATED = ("rate_hz", "dt_s", "quantity", "unit")
# Those that other programs' arrays have, in lower case.
SPELLINGS = {
    "fs": "rate_hz", "sampling_rate": "rate_hz", "dt": "dt_s", "t": "times", "time": "times",
    "names": "sensors", "channels": "sensors", "labels": "sensors",
}  # fmt: skip
RATES_HZ = (2.0, 1e5)  # of vibration records; others are of times that are not in s


class Channels(NamedTuple):
    """Channels of one file."""

    samples: FloatArray  # (n, N)
    names: tuple[str, ...] = ()  # of the channels; empty where the file has none
    rates_hz: tuple[float, ...] = ()
    quantities: tuple[str, ...] = ()
    units: tuple[str, ...] = ()  # every statement of the unit

    @classmethod
    def joined(cls, parts: "Sequence[Channels]") -> "Channels":
        """Channels of several files with the same instants; named where all files have names."""
        if len(parts) == 1:
            return parts[0]
        samples, names, *stated = zip(*parts, strict=True)
        return cls(
            np.concatenate(samples),
            tuple(chain(*names)) if all(names) else (),
            *(tuple(chain(*statements)) for statements in stated),
        )


def with_statements(
    samples: FloatArray, names: Sequence[str], stated: Mapping[str, Any],
    steps_s: Iterable[float] = (), units: Iterable[str] = (),
) -> Channels:  # fmt: skip
    """Channels of a file that states things by name (:data:`STATED`), and in its columns."""
    rates = [_number(stated, "rate_hz")] if "rate_hz" in stated else []
    rates += [1.0 / _number(stated, "dt_s")] if "dt_s" in stated else []
    quantities, stated_units = ([str(stated[k])] if k in stated else [] for k in STATED[2:])
    return Channels(
        samples,
        tuple(names) if any(names) else (),
        (*rates, *(1.0 / step for step in steps_s)),
        tuple(quantities),
        (*stated_units, *units),
    )


def _number(stated: Mapping[str, Any], key: str) -> float:
    try:
        number = float(stated[key])
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError(f"{key} must be a positive, finite number, got {stated[key]}")
    return number


def read_arrays_of_record(path: Path, keys: Sequence[str]) -> Channels:
    """The channels of the arrays named ``keys``; if empty, of all with more than one number.

    What is stated counts where it is stated for the whole file, or in the structure of the arrays.
    """
    read = read_arrays(path, attributes=(*STATED, "sensors"))
    is_matlab = path.suffix.lower() == ".mat"  # version 7.3 is HDF5, with groups for structures
    arrays: dict[str, np.ndarray] = {}
    of: dict[str, tuple[str, str]] = {}  # structure, or HDF5's group, and what an array is there
    for path_inside, value in read.items():
        name = path_inside.replace("/", ".") if is_matlab else path_inside
        array = np.asarray(value)
        arrays[name] = np.char.decode(array) if array.dtype.kind == "S" else array
        place = max(name.rfind("."), name.rfind("/"), 0)
        field = name[place:].lstrip("./").lower()
        of[name] = name[:place], SPELLINGS.get(field, field)
    samples = {
        name: array
        for name, array in arrays.items()
        if of[name][1] not in (*STATED, "times")
        and array.dtype.kind in "iuf" and array.size > 1 and array.ndim <= 2
    }  # fmt: skip
    keys = list(keys) or list(samples)
    if not keys:
        held = [f"{n!r} ({array.dtype}, {array.shape})" for n, array in arrays.items()]
        what = ", ".join(held) or "no arrays"
        raise ValueError(f"holds no rows or columns of real numbers; it holds {what}")
    require_known("no array of samples", keys, samples)
    blocks = [np.atleast_2d(samples[key]) for key in keys]
    blocks = [block.T if block.shape[0] > block.shape[1] else block for block in blocks]
    lengths = {block.shape[1] for block in blocks}
    if len(lengths) > 1:
        raise ValueError(
            f"arrays {', '.join(map(repr, keys))} differ in length; name those to read by keys, or "
            "give modes that they hold by ModalData.from_arrays"
        )
    around = {"", *(of[key][0] for key in keys)}
    beside = {of[n][1]: arrays[n] for n in arrays if of[n][0] in around and n not in keys}
    stated = {
        key: array.item() if array.size == 1 else array.tolist()
        for key, array in beside.items()
        if key in STATED
    }
    names = [str(name).strip() for name in np.ravel(beside.get("sensors", []))]
    if not names and len(keys) > 1 and all(len(block) == 1 for block in blocks):
        names = list(keys)
    joined = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    joined = np.ascontiguousarray(joined, dtype=float)
    times = np.ravel(beside.get("times", []))
    if len(joined) > 1 and advances(joined[0]):
        times, joined = joined[0], np.ascontiguousarray(joined[1:])
        if np.array_equal(times, times[0] + np.arange(len(times))):
            times = times[:0]  # a count of samples, which says nothing of the rate
        names = names[1:] if len(names) > len(joined) else names
    if times.size != joined.shape[1] or times.dtype.kind not in "iuf":
        return with_statements(joined, names, stated)
    step, places = instants_of(times, "times")
    if not (RATES_HZ[0] <= 1.0 / step <= RATES_HZ[1] or {"rate_hz", "dt_s"} & {*stated}):
        raise ValueError(f"times advance by {step:g}, not in s; remove them and give the rate")
    return with_statements(at_places(joined, places), names, stated, [step])


def advances(values: np.ndarray) -> bool:
    """Whether values advance by equal steps, but for some, gaps, as no sensor's do."""
    steps = np.diff(values.astype(float))
    step = float(np.median(steps))
    return step > 0.0 and float(np.median(np.abs(steps - step))) < 0.01 * step


def instants_of(values: np.ndarray, name: str) -> tuple[float, IntArray]:
    """The step of a column of instants, and the places (N,) of its rows, from 0 on.

    Raises:
        ValueError: steps differ, but for their rounding and where instants are missing.
    """
    times = np.asarray(values - values[0], dtype=float)  # whole numbers may be long ones
    steps = np.diff(times)
    step = float(np.median(steps))
    # Times are printed to a few digits, and may be wrong by half of the last one.
    first = np.asarray(values[:100], dtype=float)
    exact = 1e-10 + 2.0 * np.spacing(np.abs(first).max())
    decimals = (k for k in range(9) if np.allclose(first, np.round(first, k), 0.0, exact))
    rounding = 10.0 ** -next(decimals, 9)
    long = steps > 1.5 * step
    wrong = (np.abs(steps - step) > 0.01 * step + rounding) & ~long | (step <= 0.0)
    if wrong.any():
        at = int(wrong.argmax())
        raise ValueError(
            f"column {name!r}: instants must advance by equal steps; after sample {at + 1} (at "
            f"{float(values[at]):.10g}) the step is {steps[at]:.6g}, most are {step:.6g}; remove "
            "the column and give the rate (--rate), or divide the file there"
        )
    apart = times - np.linspace(times[0], times[-1], len(times))
    # Steps hardly longer than the last digit to which times are printed are rounded to one of it or
    # two, in turn: where fewer than a tenth are two, samples are missing.
    coarse = np.ptp(apart) <= 2.0 * rounding and steps.max() < 2.5 * rounding
    if long.mean() >= 0.1 and coarse:
        long[:] = False
    usual = float(steps[~long].mean())
    missing = np.where(long, np.round(steps / usual) - 1.0, 0.0)
    return usual, np.concatenate([[0], np.cumsum(1 + missing)]).astype(np.intp)


def at_places(samples: FloatArray, places: IntArray) -> FloatArray:
    """Samples with NaN where instants are missing."""
    if places[-1] == len(places) - 1:
        return samples
    if places[-1] >= 2 * len(places):
        raise ValueError(
            f"{places[-1] + 1 - len(places)} instants are missing beside {len(places)}; divide the "
            "file where it pauses"
        )
    whole = np.full((len(samples), places[-1] + 1), np.nan)
    whole[:, places] = samples
    return whole
