"""Random structures and records: which clear modes are identified, named, or silently absent.

    python runs/benchmarks/random_records.py [--records 200] [--first 0] [--out FILE]

Which structures and records they are, and which of their modes are clear, is said in
random_structures.py, beside the tests.
"""

from __future__ import annotations

import argparse
import json
import time

import beside_tests  # noqa: F401
import numpy as np
from random_structures import Case, case

import bayes_ssi as bs


def compare(case: Case, found: bs.ModalIdentification) -> dict:
    """How what is quoted compares with the truth."""
    quoted, shapes = found.quoted, found.quoted.unit_shapes
    taken: dict[int, int] = {}
    pulls, falsely, pulls_z, pulls_shape = [], 0, [], []
    for i, (f, mode) in enumerate(zip(quoted.frequencies_hz, quoted.modes, strict=True)):
        best, distance = -1, np.inf
        for j, true in enumerate(case.frequencies_hz):
            if j in taken.values():
                continue
            mac = (shapes[:, i] @ case.shapes[:, j]) ** 2
            apart = abs(np.log(f / true)) / max(case.dampings[j], 3 * mode.frequency_cov)
            if apart + 2.0 * (1.0 - mac) < distance and apart < 1.0:
                best, distance = j, apart + 2.0 * (1.0 - mac)
        if best < 0:
            falsely += 1
            continue
        taken[i] = best
        pulls.append(float(np.log(f / case.frequencies_hz[best]) / mode.frequency_cov))
        zeta = mode.damping
        pulls_z.append(float(np.log(zeta / case.dampings[best]) * zeta / mode.damping_sd))
        if mode.shape_sd is None:  # of one sensor
            continue
        cosine = shapes[:, i] @ case.shapes[:, best]
        apart = shapes[:, i] * np.sign(cosine) - case.shapes[:, best]
        n = len(apart)
        pulls_shape.append(float(np.linalg.norm(apart) / np.sqrt(n - 1) / mode.shape_sd))
    named, absent, unseen = [], [], []
    for j, f in enumerate(case.frequencies_hz):
        if j in taken.values():
            continue
        width = case.dampings[j] * f
        said = any(abs(each[0] - f) < max(2.0 * width, 0.02 * f) for each in found.not_identified)
        if case.clear[j]:
            (named if said else absent).append(float(f))
        if not said:
            unseen.append(float(f))
    return {
        "clear": int(case.clear.sum()),
        "quoted": int(sum(case.clear[j] for j in taken.values())),
        "named": named,
        "absent": absent,
        "unseen": unseen,
        "modes": len(quoted.modes),
        "false": falsely,
        "pulls": pulls,
        "pulls_damping": pulls_z,
        "pulls_shape": pulls_shape,
        "claimed": [mode.frequency_cov for mode in quoted.modes],
        "failed": len(found.failed_checks),
        "checks": list(found.failed_checks),
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out")
    arguments = parser.parse_args()
    rows = []
    for seed in range(arguments.first, arguments.first + arguments.records):
        each = case(seed)
        start = time.process_time()
        try:
            row = compare(each, bs.identify(each.record, each.band_hz))
        except ValueError as error:
            row = {"error": str(error), "clear": int(each.clear.sum())}
        row |= {"seed": seed, "cpu": time.process_time() - start}
        row |= {"sensors": len(each.record.sensors), "minutes": each.record.duration_s / 60.0}
        rows.append(row)
        if arguments.out:
            with open(arguments.out, "a") as file:
                file.write(json.dumps(row) + "\n")
    print_summary(rows)


def print_summary(rows: list[dict]) -> None:
    """Shares, pulls and seconds."""
    errors = [row for row in rows if "error" in row]
    good = [row for row in rows if "error" not in row]
    clear = sum(row["clear"] for row in good)
    print(f"{len(rows)} records, {clear} clear modes, {len(errors)} records with an error")
    for row in errors:
        print(f"  {row['seed']}: {row['clear']} clear modes; {row['error']}")
    absent = {row["seed"]: row["absent"] for row in good if row["absent"]}
    false = {row["seed"]: row["false"] for row in good if row["false"]}
    print(
        f"quoted {sum(row['quoted'] for row in good)}, named "
        f"{sum(len(row['named']) for row in good)}, absent {absent}"
    )
    print(f"false modes {false} of {sum(row['modes'] for row in good)} quoted")
    for key in ("pulls", "pulls_damping", "pulls_shape"):
        pulls = np.array([p for row in good for p in row[key]])
        large = {
            row["seed"]: np.round(max(np.abs(row[key])), 1).item()
            for row in good
            if row[key] and max(np.abs(row[key])) > 4.0
        }
        print(
            f"{key}: rms {np.sqrt((pulls**2).mean()):.2f}, median of sizes "
            f"{np.median(np.abs(pulls)):.2f}, beyond four {large}"
        )
    right = [row for row in good if not (row["absent"] or row["false"] or row["named"])]
    failed = [row["seed"] for row in right if row["failed"]]
    print(f"failed checks in {len(failed)} of {len(right)} right results: {failed}")
    cpu = np.array([row["cpu"] for row in rows])
    slow = {row["seed"]: round(row["cpu"], 1) for row in rows if row["cpu"] > 10.0}
    print(f"CPU s: median {np.median(cpu):.2f}, sum {cpu.sum():.0f}, more than 10: {slow}")


if __name__ == "__main__":
    main()
