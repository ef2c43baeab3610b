"""Pairs of modes with different shapes: how often is their number right, and is the answer steady?

    python runs/benchmarks/close_pairs.py [--records 20] [--first 0] [--bands 3] [--peer]

Each record has two modes with damping 0.3 to 5 % and shapes whose MAC is below 0.5, one mode far
below and one far above, 3 to 24 sensors, 10 to 60 minutes, noise 1 to 10 % and independent loads at
all sensors. Of four records two have modes 0 to 6 % apart, one has modes 0 to 0.5 % apart, as a
symmetric mast has, and one has one mode in place of the two. Told apart means that the exact
spectra have two peaks of their first singular value, or one of the second that stands out by 6 dB.
Bands differ in their edges by up to 5 %. With ``--peer`` (ssi_cov.py), pairs that SSI-cov tells
apart are counted as clear, too, and its own numbers are judged.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import NamedTuple

import beside_tests  # noqa: F401
import numpy as np
from random_structures import spectra_of, stationary
from scipy.signal import find_peaks
from ssi_cov import by_ssi_cov

import bayes_ssi as bs

RATE_HZ = 20.0
CLEAR_DB = 6.0
WRONG_AND_SURE = 0.99


class Pair(NamedTuple):
    record: bs.Record
    frequencies_hz: np.ndarray  # of the one or two modes in the middle
    dampings: np.ndarray
    shapes: np.ndarray
    is_clear: bool


def pair(seed: int) -> Pair:
    """The record of a seed."""
    rng = np.random.default_rng([52, seed])
    two = seed % 4 < 3
    n = round(np.exp(rng.uniform(np.log(3.0), np.log(24.0))))
    damping = float(np.exp(rng.uniform(np.log(0.003), np.log(0.05))))
    apart = float(rng.uniform(0.0, 0.005 if seed % 4 == 2 else 0.06))
    minutes = float(np.exp(rng.uniform(np.log(10.0), np.log(60.0))))
    noise = float(np.exp(rng.uniform(np.log(0.01), np.log(0.1))))
    f = np.array([0.7, 2.0, 2.0 * (1.0 + apart), 5.5])
    shapes = rng.standard_normal((n, 4))
    while (shapes[:, 1] @ shapes[:, 2]) ** 2 > 0.5 * np.prod((shapes[:, 1:3] ** 2).sum(0)):
        shapes[:, 2] = rng.standard_normal(n)
    shapes /= np.linalg.norm(shapes, axis=0)
    kept = [0, 1, 2, 3] if two else [0, 1, 3]
    f, shapes = f[kept], shapes[:, kept]
    dampings = np.full(len(f), damping)

    def transfer(at_hz: np.ndarray) -> np.ndarray:
        return spectra_of(f, (shapes, shapes), dampings, at_hz)

    samples = stationary(transfer, int(60.0 * minutes * RATE_HZ), RATE_HZ, rng)
    scales = samples.std(1, keepdims=True)
    samples += noise * scales * rng.standard_normal(samples.shape)
    response = transfer(np.linspace(1.6, 2.5, 4000))
    level = response @ response.conj().swapaxes(1, 2)
    level += (
        np.eye(n)
        * (noise * scales.mean()) ** 2
        / (scales.mean() ** 2)
        * np.trace(level.mean(0)).real
        / n
    )
    values = 10.0 * np.log10(np.linalg.eigvalsh(level))
    n_first = len(find_peaks(values[:, -1], prominence=1.0)[0])
    n_second = len(find_peaks(values[:, -2], prominence=CLEAR_DB)[0])
    record = bs.Record(samples, RATE_HZ, tuple(f"s{i}" for i in range(n)), "acceleration", "g")
    middle = slice(1, -1)
    return Pair(record, f[middle], dampings[middle], shapes[:, middle], n_first > 1 or n_second > 0)


def probability_of_two(identified: bs.ModalIdentification) -> tuple[int, float | None]:
    """The number of modes around 2 Hz, and the probability that they are two."""
    near = [p for p in identified.peaks if any(1.8 < f < 2.35 for f in p.frequencies_hz)]
    number = sum(sum(1.8 < f < 2.35 for f in p.frequencies_hz) for p in near)
    if len(near) > 1:
        return number, 1.0
    return number, near[0].probability_of_two if near else None


def number_by_peer(record: bs.Record) -> int:
    """The number of modes around 2 Hz by SSI-cov."""
    try:
        f = by_ssi_cov(record, (1.4, 2.9)).frequencies_hz
    except ValueError:
        return 0
    return int(((f > 1.8) & (f < 2.35)).sum())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--bands", type=int, default=3)
    parser.add_argument("--out")
    parser.add_argument("--peer", action="store_true")
    options = parser.parse_args()
    rows = []
    for seed in range(options.first, options.first + options.records):
        each = pair(seed)
        numbers, chances, failed, errors = [], [], [], []
        start = time.process_time()
        for band in range(options.bands):
            moved = np.random.default_rng([53, seed, band]).uniform(-0.05, 0.05, 2)
            edges = np.array([1.4, 2.9]) * (1.0 + moved * (band > 0))
            try:
                identified = bs.identify(each.record, edges.tolist())
            except ValueError as refused:
                print(f"record {seed}, band {band}: {refused}", flush=True)
                numbers, chances, failed = [*numbers, 0], [*chances, None], [*failed, 1]
                continue
            number, chance = probability_of_two(identified)
            numbers.append(number)
            chances.append(chance)
            failed.append(len(identified.failed_checks))
            if number == len(each.frequencies_hz):
                inside = np.flatnonzero(
                    (identified.quoted.frequencies_hz > 1.8)
                    & (identified.quoted.frequencies_hz < 2.35)
                )
                covs = [identified.quoted.modes[i].frequency_cov for i in inside]
                f = identified.quoted.frequencies_hz[inside]
                errors += (np.log(f / each.frequencies_hz) / covs).tolist()
        rows.append(
            {
                "seed": seed, "modes": len(each.frequencies_hz), "clear": each.is_clear,
                "sensors": len(each.record.sensors), "minutes": each.record.duration_s / 60.0,
                "damping": float(each.dampings[0]),
                "apart": float(np.ptp(each.frequencies_hz) / 2.0), "numbers": numbers,
                "chances": chances, "failed": failed, "errors": errors,
                "cpu": (time.process_time() - start) / options.bands,
            }
        )  # fmt: skip
        if options.peer:
            rows[-1]["peer"] = number_by_peer(each.record)
            rows[-1]["clear"] |= rows[-1]["peer"] == 2
        if options.out:
            with open(options.out, "a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    kinds = (True, "pairs that are clear"), (False, "pairs that are not"), (None, "one")
    for clear, what in kinds:
        of = [r for r in rows if r["modes"] == 2 and r["clear"] == clear]
        of = [r for r in rows if r["modes"] == 1] if clear is None else of
        right = sum(n == r["modes"] for r in of for n in r["numbers"])
        of_peer = sum(r["peer"] == r["modes"] for r in of) if options.peer else None
        print(f"{what}: right number in {right} of {sum(len(r['numbers']) for r in of)}"
              + (f"; SSI-cov in {of_peer} of {len(of)}" if options.peer else ""))  # fmt: skip
    sure = [
        r["seed"]
        for r in rows
        for p in r["chances"]
        if p is not None and (p if r["modes"] == 1 else 1.0 - p) > WRONG_AND_SURE
    ]
    print(f"sure and wrong: {sure}; without a probability: "
          f"{sum(p is None for r in rows for p in r['chances'])}")  # fmt: skip
    same = sum(len(set(r["numbers"])) == 1 for r in rows)
    errors = np.array([e for r in rows for e in r["errors"]])
    print(f"the same number in all bands: {same} of {len(rows)}; frequencies within three claimed "
          f"deviations {(np.abs(errors) < 3.0).mean():.1%}, rms {np.sqrt((errors**2).mean()):.2f}; "
          f"failed checks in {sum(map(any, (r['failed'] for r in rows)))}; CPU "
          f"{np.mean([r['cpu'] for r in rows]):.1f} s")  # fmt: skip


if __name__ == "__main__":
    main()
