"""The records of random_records.py by pyOMA2 as it comes: recall, false modes, seconds.

    pip install ".[oma]"
    python runs/benchmarks/random_records_pyoma2.py [--records 200] [--first 0] [--beside FILE]

SSI-cov of records decimated to the band, 45 block rows, orders to 60, and its clustering "Kvaale";
nothing is tuned. A true mode is identified where one of the clusters in the band lies within twice
its damping, or 2 %, of its frequency, with a MAC above 0.8; a cluster without a true mode is false.
With the FILE that ``random_records.py --out`` wrote, true modes that only pyOMA2 identifies, and
that the package does not name either, are listed.
"""

from __future__ import annotations

import argparse
import json
import logging
import time
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

import beside_tests  # noqa: F401
import numpy as np
from pyoma2.algorithms.data.run_params import Clustering
from pyoma2.algorithms.ssi import SSI
from pyoma2.setup import SingleSetup
from random_structures import Case, case
from scipy.signal import decimate

BLOCK_ROWS, HIGHEST_ORDER = 45, 60


def modes_of(each: Case) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and real shapes of the clusters in the band."""
    record = each.record
    factor = max(1, int(0.8 * record.nyquist_hz / each.band_hz[1]))
    slow = record.samples if factor == 1 else decimate(record.samples, factor, ftype="fir")
    setup = SingleSetup(np.array(slow).T, record.rate_hz / factor)
    algorithm = SSI(name="ssi", method="cov", br=BLOCK_ROWS, ordmax=HIGHEST_ORDER)
    algorithm.add_clustering(Clustering(name="modes", quick="Kvaale", freqlim=each.band_hz))
    setup.add_algorithms(algorithm)
    with redirect_stderr(StringIO()), redirect_stdout(StringIO()):  # bars of progress
        setup.run_by_name("ssi")
        algorithm.run_all_clustering()
    result = algorithm.result.clustering_results["modes"]
    shapes = np.asarray(result.Phi)
    turn = np.exp(-0.5j * np.angle((shapes**2).sum(0)))
    real = (shapes * turn).real
    return np.asarray(result.Fn), real / np.linalg.norm(real, axis=0)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--beside")
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    beside: dict[int, dict] = {}
    if arguments.beside:
        with open(arguments.beside) as file:
            beside = {row["seed"]: row for row in map(json.loads, file)}
    clear, quoted, false, modes, seconds, only = 0, 0, 0, 0, [], {}
    failed: dict[int, str] = {}
    for seed in range(arguments.first, arguments.first + arguments.records):
        each = case(seed)
        clear += int(each.clear.sum())
        start = time.process_time()
        try:
            frequencies, shapes = modes_of(each)
        except (ValueError, IndexError, AttributeError, np.linalg.LinAlgError) as error:
            failed[seed] = str(error).splitlines()[0]
            continue
        finally:
            seconds.append(time.process_time() - start)
        modes += len(frequencies)
        seen = set()
        for f, shape in zip(frequencies, shapes.T, strict=True):
            near = [
                j
                for j, true in enumerate(each.frequencies_hz)
                if j not in seen
                and abs(f / true - 1.0) < max(2.0 * each.dampings[j], 0.02)
                and (shape @ each.shapes[:, j]) ** 2 > 0.8
            ]
            if near:
                seen.add(min(near, key=lambda j: abs(f / each.frequencies_hz[j] - 1.0)))
            else:
                false += 1
        quoted += sum(bool(each.clear[j]) for j in seen)
        unseen = beside.get(seed, {}).get("unseen", [])
        lost = [f for f in unseen if any(abs(f - each.frequencies_hz[j]) < 1e-9 for j in seen)]
        if lost:
            only[seed] = [round(f, 3) for f in lost]
    print(f"{arguments.records} records, {clear} clear modes: {quoted} identified")
    print(f"false {false} of {modes}; failed {failed}")
    if beside:
        print(f"identified here alone: {only}")
    print(f"CPU s: median {np.median(seconds):.2f}, sum {sum(seconds):.0f}")


if __name__ == "__main__":
    main()
