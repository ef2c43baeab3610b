"""Random structures and records: which clear modes are identified, named, or silently absent.

    python runs/benchmarks/random_records.py [--records 200] [--first 0] [--out FILE] [--peer]

Which structures and records they are, and which of their modes are clear, is said in
random_structures.py, beside the tests. For modes alone within a tenth of their frequency, errors
are compared with the least that any method can reach with long records: of ln f and ln damping the
variances are ζ / (2π N) and 1 / (2π ζ N) for N periods (Au, 2014; Mech. Syst. Signal Process. 48,
15-33), without noise and with the whole resonance in the band. With ``--peer`` (ssi_cov.py), the
same records by SSI-cov.
"""

from __future__ import annotations

import argparse
import json
import math
import time

import beside_tests  # noqa: F401
import numpy as np
from random_structures import Case, case
from ssi_cov import by_ssi_cov

import bayes_ssi as bs


def matched(case: Case, frequencies_hz, shapes, covs) -> dict[int, int]:
    """Identified modes and the true ones that they are, within the larger of damping and error."""
    taken: dict[int, int] = {}
    for i, (f, cov) in enumerate(zip(frequencies_hz, covs, strict=True)):
        best, distance = -1, np.inf
        for j, true in enumerate(case.frequencies_hz):
            if j in taken.values():
                continue
            mac = (shapes[:, i] @ case.shapes[:, j]) ** 2
            apart = abs(np.log(f / true)) / max(case.dampings[j], 3 * cov)
            if apart + 2.0 * (1.0 - mac) < distance and apart < 1.0:
                best, distance = j, apart + 2.0 * (1.0 - mac)
        if best >= 0:
            taken[i] = best
    return taken


def over_the_law(case: Case, taken: dict[int, int], values) -> list[list[float]]:
    """Errors, or standard deviations, of ln f and ln damping of modes alone, over Au's law.

    ``values`` (2, m) are those of the identified modes.
    """
    rows = []
    for i, j in taken.items():
        apart = np.abs(np.delete(case.frequencies_hz, j) / case.frequencies_hz[j] - 1.0)
        if case.clear[j] and (apart > 0.1).all():
            zeta = case.dampings[j]
            periods = math.tau * case.frequencies_hz[j] * case.record.duration_s
            law = np.sqrt([zeta / periods, 1.0 / (zeta * periods)])
            rows.append((np.abs(values[:, i]) / law).tolist())
    return rows


def errors_of(case: Case, taken: dict[int, int], frequencies_hz, dampings) -> np.ndarray:
    """Of ln f and ln damping (2, m), 0 for modes that are none."""
    errors = np.zeros((2, len(frequencies_hz)))
    for i, j in taken.items():
        errors[:, i] = np.log(
            [frequencies_hz[i] / case.frequencies_hz[j], dampings[i] / case.dampings[j]]
        )
    return errors


def by_peer(case: Case) -> dict:
    """The same record by SSI-cov: clear modes, false ones, errors over the law, CPU seconds."""
    start = time.process_time()
    try:
        peer = by_ssi_cov(case.record, case.band_hz)
    except ValueError as error:
        return {"error": str(error)}
    seconds = time.process_time() - start
    n = len(peer.frequencies_hz)
    taken = matched(case, peer.frequencies_hz, peer.shapes, np.full(n, 0.02 / 3.0))
    errors = errors_of(case, taken, peer.frequencies_hz, peer.dampings)
    return {
        "quoted": int(sum(case.clear[j] for j in taken.values())),
        "modes": n,
        "false": n - len(taken),
        "errors_by_law": over_the_law(case, taken, errors),
        "cpu": seconds,
        "true": [float(case.frequencies_hz[j]) for j in taken.values()],
    }


def compare(case: Case, identified: bs.ModalIdentification) -> dict:
    """How what is quoted compares with the truth."""
    quoted, shapes = identified.quoted, identified.quoted.unit_shapes
    covs, dampings, sds = (
        np.array([getattr(mode, name) for mode in quoted.modes], dtype=float)
        for name in ("frequency_cov", "damping", "damping_sd")
    )
    taken = matched(case, quoted.frequencies_hz, shapes, covs)
    errors = errors_of(case, taken, quoted.frequencies_hz, dampings)
    claimed = np.array([covs, sds / dampings])
    pulls, pulls_z = ((errors / claimed)[:, list(taken)]).tolist()
    pulls_shape = []
    for i, j in taken.items():
        if quoted.modes[i].shape_sd is None:  # of one sensor
            continue
        apart = shapes[:, i] * np.sign(shapes[:, i] @ case.shapes[:, j]) - case.shapes[:, j]
        sd = np.linalg.norm(apart) / np.sqrt(len(apart) - 1)
        pulls_shape.append(float(sd / quoted.modes[i].shape_sd))
    named, absent, unseen = [], [], []
    for j, f in enumerate(case.frequencies_hz):
        if j in taken.values():
            continue
        width = case.dampings[j] * f
        said = any(
            abs(each[0] - f) < max(2.0 * width, 0.02 * f) for each in identified.not_identified
        )
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
        "false": len(quoted.modes) - len(taken),
        "pulls": pulls,
        "pulls_damping": pulls_z,
        "pulls_shape": pulls_shape,
        "errors_by_law": over_the_law(case, taken, errors),
        "claimed_by_law": over_the_law(case, taken, claimed),
        "failed": len(identified.failed_checks),
        "checks": list(identified.failed_checks),
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out")
    parser.add_argument("--peer", action="store_true")
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
        if arguments.peer:
            row["peer"] = by_peer(each)
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
    for key in ("errors_by_law", "claimed_by_law"):
        print_law(key, [row[key] for row in good])
    right = [row for row in good if not (row["absent"] or row["false"] or row["named"])]
    failed = [row["seed"] for row in right if row["failed"]]
    print(f"failed checks in {len(failed)} of {len(right)} right results: {failed}")
    cpu = np.array([row["cpu"] for row in rows])
    slow = {row["seed"]: round(row["cpu"], 1) for row in rows if row["cpu"] > 10.0}
    print(f"CPU s: median {np.median(cpu):.2f}, sum {cpu.sum():.0f}, more than 10: {slow}")
    if "peer" in rows[0]:
        print_peer(rows)


def print_law(what: str, several: list[list[list[float]]]) -> None:
    """Root mean squares of frequencies and dampings over the law, without the largest hundredth."""
    values = np.sort([row for rows in several for row in rows], axis=0)
    kept = values[: math.ceil(0.99 * len(values))]
    rms = np.sqrt((kept**2).mean(0))
    print(f"{what}: frequencies {rms[0]:.2f}, dampings {rms[1]:.2f}, of {len(values)} modes alone")


def print_peer(rows: list[dict]) -> None:
    """SSI-cov on the same records."""
    peers = [row["peer"] for row in rows if "error" not in row["peer"]]
    modes, false = (sum(peer[key] for peer in peers) for key in ("modes", "false"))
    print(f"SSI-cov: {len(rows) - len(peers)} records with an error, quoted "
          f"{sum(peer['quoted'] for peer in peers)} clear modes, false {false} of {modes}; CPU s: "
          f"median {np.median([peer['cpu'] for peer in peers]):.2f}")  # fmt: skip
    print_law("  errors_by_law", [peer["errors_by_law"] for peer in peers])
    only = {
        row["seed"]: lost
        for row in rows
        if (lost := sorted(set(row.get("unseen", [])) & set(row["peer"].get("true", []))))
    }
    print(f"  identified there alone, and not named here: {only}")


if __name__ == "__main__":
    main()
