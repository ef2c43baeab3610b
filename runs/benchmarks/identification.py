"""Are errors claimed for modes identified from records right? Simulated records, many of each kind.

    python runs/benchmarks/identification.py [--records 20] [--kinds floors ground …] [--first 0]

Each record is 20 minutes at 50 Hz from three sensors on the building of Case (c) (modes at 0.983,
2.604, 3.005 and 3.984 Hz, damping 2 %, 1 % noise), unless its kind says otherwise. For each method:
how often all modes were identified, root mean square errors of frequencies, claimed over actual
errors (root mean squares) of frequencies and shapes, the mean frequency error in claimed standard
deviations, the largest error in claimed standard deviations that no failed check goes with, in how
many a peak is said to hold two modes, and seconds of CPU a record for the whole of ``bs.identify``.
SSI-cov is there where pyOMA2 is installed.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any, NamedTuple

import beside_tests  # noqa: F401
import numpy as np
from simulated_records import FRAME, Truth, simulated_record, truth_of, with_infill

import bayes_ssi as bs
from bayes_ssi.measurements.modes.identification_summary import METHOD_NAMES
from bayes_ssi.measurements.records.other_methods import modes_by

SENSORS = ("floor 1", "floor 2", "floor 3")
BAND = (0.6, 4.6)
# A shear building whose modes are at 0.97, 2.90, 4.83 Hz and more, of which two are in the band.
TALL = bs.ShearBuilding(masses=(1.0,) * 40, stiffnesses=(24_600.0,) * 40)
TALL_BAND = (0.6, 4.2)
FLOORS = tuple(f"floor {i}" for i in range(1, 41))
KINDS: dict[str, dict[str, Any]] = {
    "floors": {},
    "ground": {"ground": True},
    "5 minutes": {"duration_s": 300.0},
    "5 minutes, ground": {"duration_s": 300.0, "ground": True},
    "2 hours": {"duration_s": 7200.0},
    "2 hours, ground": {"duration_s": 7200.0, "ground": True},
    "damping 0.5 %": {"damping": 0.005},
    "damping 0.5 %, ground": {"damping": 0.005, "ground": True},
    "damping 5 %": {"damping": 0.05},
    "damping 5 %, ground": {"damping": 0.05, "ground": True},
    "two sensors": {"sensors": ("floor 1", "floor 3")},
    "two sensors, ground": {"sensors": ("floor 1", "floor 3"), "ground": True},
    "forty sensors": {"structure": TALL, "sensors": FLOORS, "duration_s": 600.0},
    "forty sensors, ground": {
        "structure": TALL, "sensors": FLOORS, "duration_s": 600.0, "ground": True,
    },
    "coloured loads": {"disturbed": "colour"},
    "harmonic": {"disturbed": "harmonic"},
    "transient": {"disturbed": "transient"},
    "clipping": {"disturbed": "clipping"},
    "changing amplitude": {"disturbed": "amplitude"},
    "1.2 bandwidths": {"structure": with_infill(mass=0.0163)},
    "0.74 bandwidths": {"structure": with_infill(mass=0.0062)},
    "0.5 bandwidths": {"structure": with_infill(mass=0.0028)},
    "no infill": {"structure": FRAME},
}  # fmt: skip


class Errors(NamedTuple):
    """Of one record and method: errors and what was claimed, NaN where nothing was, (m,) each."""

    log_frequencies: np.ndarray
    frequency_covs: np.ndarray
    shapes: np.ndarray
    claimed_shapes: np.ndarray


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=["floors", "ground"], choices=list(KINDS))
    options = parser.parse_args()
    for kind in options.kinds:
        report(kind, range(options.first, options.first + options.records))


def report(kind: str, seeds: range) -> None:
    """Print the table of one kind of record."""
    changes = dict(KINDS[kind])
    structure = changes.pop("structure", with_infill())
    sensors = changes.pop("sensors", SENSORS)
    how = changes.pop("disturbed", "")
    band = TALL_BAND if structure is TALL else BAND
    truth = truth_of(structure, sensors, changes.get("damping", 0.02)).within(band)
    of_methods: dict[str, list[Errors]] = {name: [] for name in METHOD_NAMES}
    seconds, all_modes, failed, silent, pairs = [], 0, 0, 0.0, 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        record = simulated_record(structure, sensors, rng, **changes)
        if how:
            record = disturbed(record, how, truth)
        start = time.process_time()
        found = bs.identify(record, band)
        seconds.append(time.process_time() - start)
        all_modes += len(found.modes) == len(truth.frequencies_hz)
        failed += bool(found.failed_checks)
        pairs += any(
            len(peak.frequencies_hz) > 1 and (peak.probability_of_two or 0.0) > 0.9
            for peak in found.peaks
        )
        for name in METHOD_NAMES:
            try:
                modes = modes_by(name, record, found.quoted)
            except ValueError:
                continue
            if len(modes.frequencies_hz) != len(truth.frequencies_hz):
                continue
            errors = errors_of(modes, truth)
            of_methods[name].append(errors)
            if name == "bayesian-fft" and not found.failed_checks:
                silent = max(silent, largest(errors))
    print(
        f"{kind}: {len(seeds)} records, all modes and no others in {all_modes}, failed checks in "
        f"{failed}, largest error without one {silent:.1f} claimed, two modes at a peak above 0.9 "
        f"in {pairs}, {np.mean(seconds):.2f} s of CPU"
    )
    for name, several in of_methods.items():
        if several:
            print_row(METHOD_NAMES[name], several)
    sys.stdout.flush()


def disturbed(record: bs.Record, how: str, truth: Truth) -> bs.Record:
    """The record with what the spectral model does not know of."""
    from scipy.signal import lfilter

    samples = np.array(record.samples)
    scales = samples.std(axis=1, keepdims=True)
    times = np.arange(record.n_samples) / record.rate_hz
    if how == "colour":
        # A first-order low-pass at 1 Hz: the loads' spectrum falls to a twentieth over the band.
        decay = np.exp(-2.0 * np.pi / record.rate_hz)
        samples = lfilter([1.0 - decay], [1.0, -decay], samples, axis=1)
    elif how == "harmonic":
        samples += 0.3 * scales * np.sin(2.0 * np.pi * 2.8 * times)
    elif how == "transient":
        # A shock halfway, from which all modes decay.
        after = np.maximum(times - 0.5 * times[-1], 0.0)
        for frequency, damping, shape in zip(*truth[:2], truth.shapes.T, strict=True):
            omega = 2.0 * np.pi * frequency
            decay = np.sin(omega * after) * np.exp(-damping * omega * after)
            samples += 5.0 * scales.mean() * np.outer(shape, decay)
    elif how == "clipping":
        samples = np.clip(samples, -1.5 * scales, 1.5 * scales)
    elif how == "amplitude":
        samples *= np.exp(np.sin(2.0 * np.pi * times / times[-1]))  # by a factor of 7
    return bs.Record(samples, record.rate_hz, record.sensors, record.quantity, record.unit)


def errors_of(data: bs.ModalData, truth: Truth) -> Errors:
    """Errors of all modes, sought near those of the Bayesian FFT."""
    cosines = np.abs((data.unit_shapes * truth.shapes).sum(0))
    covs, sds = (
        np.array([getattr(mode, name) for mode in data.modes], dtype=float)
        for name in ("frequency_cov", "shape_sd")
    )
    return Errors(
        np.log(data.frequencies_hz / truth.frequencies_hz),
        covs,
        np.sqrt(np.maximum(0.0, 2.0 - 2.0 * cosines)),
        sds * np.sqrt(len(data.sensors) - 1),
    )


def largest(errors: Errors) -> float:
    """The largest error in claimed standard deviations."""
    of_frequencies = np.abs(errors.log_frequencies) / errors.frequency_covs
    return float(max(of_frequencies.max(), (errors.shapes / errors.claimed_shapes).max()))


def print_row(name: str, several: list[Errors]) -> None:
    """Print one method's errors."""
    errors, claimed, shapes, claimed_shapes = (
        np.array(part) for part in zip(*several, strict=True)
    )

    def rms(values: np.ndarray) -> np.ndarray:
        return np.sqrt((values**2).mean(0))

    def row(values: np.ndarray, form: str = "{:.2f}") -> str:
        return " ".join(form.format(value) for value in values)

    if np.isnan(claimed).all():
        print(
            f"  {name:13s} n {len(several):3d}  f % {row(100 * rms(errors), '{:.3f}')}  "
            f"shapes {row(rms(shapes), '{:.4f}')}  (no errors are claimed)"
        )
        return
    if np.isnan(claimed_shapes).all():
        claimed_shapes = np.zeros_like(shapes)  # none is used
    print(
        f"  {name:13s} n {len(several):3d}  f % {row(100 * rms(errors), '{:.3f}')}  "
        f"claimed/actual f {row(rms(claimed) / rms(errors))}  "
        f"bias {row((errors / claimed).mean(0), '{:+.2f}')}  "
        f"shapes {row(rms(shapes), '{:.4f}')}  "
        f"claimed/actual {row(rms(claimed_shapes) / rms(shapes))}"
    )


if __name__ == "__main__":
    main()
