"""Buildings with a tuned mass damper, and sensors whose clocks are late: which modes, whose phases?

    python runs/benchmarks/dampers_and_clocks.py [--records 20] [--first 0] [--out FILE] [--peer]

Each record is of a shear building of 3 to 8 floors with structural damping of 0.5 to 2 %, under
independent loads on its floors, noise of 1 to 5 %, 15 to 40 minutes. Of four records two have a
damper on the roof, tuned to the first mode within 5 %, with 1 to 10 % of the building's mass and a
damping of 3 to 15 %, on which every second one has a sensor. Of eight, three have one sensor that
is 5 to 50 ms late. The truth are the complex modes of the damped structure. A mode is clear where
its pole has at least half the power of the exact spectra's highest singular value there, or where
they have a peak; the two modes of a damper are always asked for.
With ``--peer`` (ssi_cov.py), the records where SSI-cov loses modes are counted.
"""

from __future__ import annotations

import argparse
import json
import time

import beside_tests  # noqa: F401
import numpy as np
from random_structures import chain, stationary
from ssi_cov import by_ssi_cov

import bayes_ssi as bs

RATE_HZ = 25.0


def simulated(seed: int) -> tuple[bs.Record, np.ndarray, np.ndarray, bool, dict[str, float]]:
    """The record, frequencies and dampings of three or four modes, and the delays by sensor."""
    rng = np.random.default_rng([54, seed])
    n = int(rng.integers(3, 9))
    masses = 1e5 * rng.lognormal(0.0, 0.1, n)
    k = chain(2e8 * (n / 5.0) ** 2 * 0.25 * rng.lognormal(0.0, 0.1, n))
    values, vectors = np.linalg.eigh(k / np.sqrt(np.outer(masses, masses)))
    damping = float(np.exp(rng.uniform(np.log(0.005), np.log(0.02))))
    root = np.sqrt(masses)[:, None]
    c = root * (vectors * (2.0 * damping * np.sqrt(values))) @ vectors.T * root.T
    has_damper = seed % 4 < 2
    size = float(masses.sum() * rng.uniform(0.01, 0.10))
    omega = float(
        np.sqrt(values[0]) * (1.0 + rng.uniform(-0.05, 0.05)) / (1.0 + size / masses.sum())
    )
    of_damper = float(rng.uniform(0.03, 0.15))
    if has_damper:
        v = np.zeros(n + 1)
        v[-2:] = -1.0, 1.0
        k, c = (np.pad(matrix, (0, 1)) for matrix in (k, c))
        k += size * omega**2 * np.outer(v, v)
        c += 2.0 * of_damper * size * omega * np.outer(v, v)
        masses = np.r_[masses, size]
    m = np.diag(masses)
    inverse = np.linalg.inv(m)
    states = np.block([[np.zeros_like(k), np.eye(len(k))], [-inverse @ k, -inverse @ c]])
    poles = np.linalg.eigvals(states)
    poles = poles[poles.imag > 0.0]
    poles = poles[np.argsort(np.abs(poles))][: 3 + has_damper]
    sensors = np.arange(n + (has_damper and seed % 2 == 0))

    def transfer(at_hz: np.ndarray) -> np.ndarray:
        w = 2.0 * np.pi * np.maximum(at_hz, 1e-6)[:, None, None]
        response = np.linalg.inv(k - w**2 * m + 1j * w * c) * w**2
        return response[:, sensors][:, :, :n] * np.sqrt(masses[:n])

    minutes = rng.uniform(15.0, 40.0)
    samples = stationary(transfer, int(60.0 * minutes * RATE_HZ), RATE_HZ, rng)
    names = tuple(f"s{i}" for i in sensors)
    delays = {}
    if seed % 8 in (1, 2, 4):
        i = int(rng.integers(len(sensors)))
        delays[names[i]] = float(rng.uniform(0.005, 0.05))
        lines = np.fft.rfft(samples[i])
        hz = np.fft.rfftfreq(samples.shape[1], 1.0 / RATE_HZ)
        samples[i] = np.fft.irfft(
            lines * np.exp(-2j * np.pi * hz * delays[names[i]]), len(samples[i])
        )
    noise = rng.uniform(0.01, 0.05)
    samples += noise * samples.std(1, keepdims=True) * rng.standard_normal(samples.shape)
    record = bs.Record(samples, RATE_HZ, names, "acceleration", "m/s2")
    size = np.abs(poles)
    return record, size / (2.0 * np.pi), -poles.real / size, has_damper, delays


def matched(true_hz, dampings, identified_hz) -> tuple[dict[int, int], list[float]]:
    """Identified modes and the true ones that they are; frequencies of true modes without one."""
    paired, lost = {}, []
    for j, (hz, z) in enumerate(zip(true_hz, dampings, strict=True)):
        apart = {i: abs(np.log(f / hz)) for i, f in enumerate(identified_hz) if i not in paired}
        best = min(apart, key=apart.get, default=None)
        if best is None or apart[best] > 1.5 * z + 0.01:
            lost.append(round(float(hz), 3))
        else:
            paired[best] = j
    return paired, lost


def lost_by_peer(record: bs.Record, band, true_hz, dampings) -> list[float]:
    """Frequencies of true modes that SSI-cov does not identify."""
    try:
        identified_hz = by_ssi_cov(record, band).frequencies_hz
    except ValueError:
        identified_hz = np.zeros(0)
    return matched(true_hz, dampings, identified_hz)[1]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out")
    parser.add_argument("--peer", action="store_true")
    options = parser.parse_args()
    rows = []
    for seed in range(options.first, options.first + options.records):
        record, f, zeta, has_damper, delays = simulated(seed)
        start = time.process_time()
        high = 0.5 * (f[-1] + f[-2]) if has_damper else 1.2 * f[-1]
        inside = f < high
        band = [0.5 * f[0], min(high, 0.45 * RATE_HZ)]
        identified = bs.identify(record, band)
        paired, lost = matched(f[inside], zeta[inside], identified.quoted.frequencies_hz)
        pulls, pulls_z = [], []
        for i, j in paired.items():
            mode = identified.quoted.modes[i]
            pulls.append(float(np.log(mode.frequency_hz / f[j]) / mode.frequency_cov))
            pulls_z.append(float((mode.damping - zeta[j]) / mode.damping_sd))
        sentences = (*identified.remarks, *identified.failed_checks)
        said = [r for r in sentences if "late" in r or "early" in r]
        named = sorted({name for name in record.sensors for r in said if repr(name) in r})
        rows.append(
            {
                "seed": seed, "damper": has_damper, "sensors": len(record.sensors),
                "f": f.round(4).tolist(), "zeta": zeta.round(4).tolist(), "lost": lost,
                "false": len(identified.quoted.modes) - len(paired),
                "failed": len(identified.failed_checks),
                "pulls": pulls, "pulls_z": pulls_z, "late": delays, "named": named, "said": said,
                "cpu": time.process_time() - start,
            }
        )  # fmt: skip
        if options.peer:
            rows[-1]["peer"] = lost_by_peer(record, band, f[inside], zeta[inside])
        if options.out:
            with open(options.out, "a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    for kind in (True, False):
        of = [row for row in rows if row["damper"] == kind]
        if not of:
            continue
        lost = [row for row in of if row["lost"]]
        pulls, pulls_z = (
            np.array([pull for row in of for pull in row[key]]) for key in ("pulls", "pulls_z")
        )
        print(
            f"{'damper' if kind else 'none'}: {len(of)} records; modes lost in {len(lost)}, "
            f"silently in {[row['seed'] for row in lost if not row['failed']]}; false modes "
            f"{sum(row['false'] for row in of)}; failed checks in "
            f"{sum(row['failed'] > 0 for row in of)}; within three deviations: frequencies "
            f"{(abs(pulls) < 3).mean():.0%}, rms {(pulls**2).mean() ** 0.5:.2f}, dampings "
            f"{(abs(pulls_z) < 3).mean():.0%}, rms {(pulls_z**2).mean() ** 0.5:.2f}"
            + (
                f"; SSI-cov loses modes in {sum(map(bool, (row['peer'] for row in of)))}"
                if options.peer
                else ""
            )
        )
    right = [row for row in rows if sorted(row["late"]) == row["named"]]
    print(f"late sensors: verdict right in {len(right)} of {len(rows)}; CPU "
          f"{np.mean([row['cpu'] for row in rows]):.1f} s")  # fmt: skip


if __name__ == "__main__":
    main()
