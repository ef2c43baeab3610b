"""False alarms of the checks of records, and what they find.

    python runs/benchmarks/record_checks.py

Sound records are of a building of three storeys, with and without a resonant infill, under loads
on its floors or ground motion, of 300 to 1,200 s, damping 0.5 to 5 %, noise 1 to 10 %. Earthquakes
have an envelope, and are filtered as agencies do and rounded. Lines of machines are added.
"""

from __future__ import annotations

import beside_tests  # noqa: F401
import numpy as np
from scipy.signal import butter, sosfiltfilt
from simulated_records import FRAME, simulated_record, with_infill

from bayes_ssi.measurements.records.record_checks import machine_lines, remarks_on

SENSORS = ("floor 1", "floor 2", "floor 3")
KINDS: tuple[dict, ...] = (
    {}, {"ground": True}, {"damping": 0.005}, {"damping": 0.05, "ground": True}, {"damping": 0.01},
    {"duration_s": 300.0}, {"noise": 0.1}, {"damping": 0.01, "ground": True},
    {"duration_s": 1200.0, "damping": 0.005, "ground": True},
    {"duration_s": 400.0, "rate_hz": 20.0},
)  # fmt: skip
MACHINES_HZ = (1.5, 2.0, 2.8, 3.5, 5.0, 7.3, 10.1)


def sound(seed: int) -> tuple[np.ndarray, float]:
    structure = FRAME if seed // 10 % 2 else with_infill()
    kind = {"duration_s": 600.0} | KINDS[seed % 10]
    record = simulated_record(structure, SENSORS, np.random.default_rng([7, seed]), **kind)
    return record.samples, record.rate_hz


def earthquake(seed: int) -> tuple[np.ndarray, float]:
    rng = np.random.default_rng([9, seed])
    structure = FRAME if seed % 2 else with_infill()
    record = simulated_record(
        structure, SENSORS, rng, ground=True, damping=0.03, duration_s=80.0, rate_hz=100.0
    )
    after = np.maximum(np.arange(record.n_samples) / 100.0 - rng.uniform(5.0, 20.0), 0.0)
    samples = record.samples * (0.002 + after**2 * np.exp(-2.0 * after / rng.uniform(4.0, 12.0)))
    high = (40.0, 23.0, 35.0, 10.0)[seed % 4]
    if seed % 3:
        filtered = sosfiltfilt(butter(4, [0.1, high], "bandpass", fs=100.0, output="sos"), samples)
    else:
        frequencies = np.fft.rfftfreq(record.n_samples, 0.01)
        passed = np.interp(frequencies, [0.06, 0.1, high, 1.08 * high], [0.0, 1.0, 1.0, 0.0])
        filtered = np.fft.irfft(passed * np.fft.rfft(samples), record.n_samples)
    return np.round(filtered, 6), 100.0


def main() -> None:
    records = [sound(seed) for seed in range(100)]
    quakes = [earthquake(seed) for seed in range(48)]
    for what, some in (("sound records", records), ("earthquakes", quakes)):
        alarms = sum(bool(remarks_on(*each, SENSORS)) for each in some)
        print(f"{what}: {alarms} of {len(some)} with a remark")
    for ground in (False, True):
        sounds = [
            simulated_record(
                with_infill(), SENSORS, np.random.default_rng([3, seed, ground]), ground=ground,
                duration_s=600.0,
            ).samples
            for seed in range(10)
        ]  # fmt: skip
        times = np.arange(sounds[0].shape[1]) / 50.0
        for amplitude in (0.03, 0.05, 0.1):
            found = wrong_lines = 0
            for frequency in MACHINES_HZ:
                pattern = np.array([0.6, 1.0, -0.4 if frequency > 2.0 else 1.1])[:, None]
                for k, samples in enumerate(sounds):
                    sine = np.sin(2.0 * np.pi * (frequency + 0.00037 * k) * times + k)
                    scales = amplitude * samples.std(axis=1, keepdims=True) * pattern
                    lines = machine_lines(samples + scales * sine, 50.0)
                    right = np.abs(lines - frequency - 0.00037 * k) < 0.5 / 600.0
                    found += right.any()
                    wrong_lines += (~right).sum()
            loads = "ground motion" if ground else "loads on floors"
            print(
                f"a machine of {amplitude:.0%}, {loads}: {found} of 70, {wrong_lines} other lines"
            )


if __name__ == "__main__":
    main()
