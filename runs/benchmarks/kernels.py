"""Do answers hang on the processor? Shipped studies under several kernels of linear algebra.

    python runs/benchmarks/kernels.py [--kernels Prescott Nehalem Haswell SkylakeX]
        [--threads 1 2] [--only "rank, shear building;…"]

numpy's and scipy's OpenBLAS choose a kernel by the processor, whose last digits differ from those
of others; OPENBLAS_CORETYPE makes one processor compute as another. Each case runs in a process of
its own under every kernel, with every number of threads. Estimates with their claimed errors,
answers, failed checks and exit codes are printed side by side. A kernel whose instructions this
processor lacks is left out, and said.

The exit code is 1 where a process ends in an error, answers or numbers of failed checks differ, or
estimates do by more than four joint errors.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.studies.ranking.comparison import RankedClass
from bayes_ssi.studies.ranking.study import load_study

KERNELS = ("Prescott", "Nehalem", "Haswell", "SkylakeX")
STUDIES = Path(__file__).parents[2] / "model_classes"
MOST_JOINT_ERRORS = 4.0
# Least squares are solved to about this share, which stands for the error of a calibrated value.
SOLVED = 1e-6
PROBE = """
import numpy as np, scipy.linalg
a = np.random.default_rng(0).standard_normal((300, 300))
np.linalg.eigh(a @ a.T), scipy.linalg.eigh(a @ a.T), np.linalg.inv(a), np.linalg.qr(a)
"""


class Answer(NamedTuple):
    """What a case gives: name → (estimate, claimed error), an answer in words, failed checks."""

    estimates: Mapping[str, tuple[float, float]]
    words: str
    n_failed_checks: int


class Setting(NamedTuple):
    kernel: str
    n_threads: int

    @property
    def environment(self) -> dict[str, str]:
        others = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
        own = {"OPENBLAS_CORETYPE": self.kernel, "OPENBLAS_NUM_THREADS": str(self.n_threads)}
        return {**others, **own}

    def __str__(self) -> str:
        return f"{self.kernel} {self.n_threads}"


def ranked(name: str, n_classes: int | None = None) -> Answer:
    """The first classes of a study; the answer is the order of those that are not improbable."""
    study = load_study(STUDIES / name)
    return of_rows(bs.rank(study.only(study.names[:n_classes])).comparison.classes)


def of_rows(rows: Sequence[RankedClass], words: str = "") -> Answer:
    probable = " > ".join(row.name for row in rows if row.probability > 0.01)
    n_failed = sum(len(row.failed_checks) for row in rows)
    return Answer({r.name: (r.log_evidence, r.error) for r in rows}, words or probable, n_failed)


def searched(name: str) -> Answer:
    found = bs.search(load_study(STUDIES / name))
    rows = found.ranking.comparison.classes
    places = ", ".join(place.place.name for place in found.record.credible_places)
    return of_rows(rows, f"{rows[0].name}; 95 % of the probability: {places}")


def calibrated(name: str) -> Answer:
    """The best minimum of every class; the answer counts them all."""
    classes = load_study(STUDIES / name).model_classes
    results = [bs.calibrate(each, shape_weight=0.0) for each in classes]
    estimates = {
        f"{result.name}, {parameter}": (value, SOLVED * abs(value))
        for result in results
        for parameter, value in zip(result.parameter_names, result.best.values, strict=True)
    }
    counts = ", ".join(str(len(result.minima)) for result in results)
    open_ = ", ".join(str(result.undetermined_directions) for result in results)
    return Answer(estimates, f"minima {counts}; undetermined {open_}", 0)


def identified() -> Answer:
    """Modes of 20 minutes of the shear building with its infill under loads on its floors."""
    floors = ("floor 1", "floor 2", "floor 3")
    record = simulated_record(with_infill(), floors, np.random.default_rng(0))
    found = bs.identify(record, (0.6, 4.6))
    modes = [(m.label, m.frequency_hz, m.frequency_cov) for m in found.modal_data().modes]
    estimates = {f"frequency of mode {label}": (hz, hz * cov) for label, hz, cov in modes}
    return Answer(estimates, f"{len(modes)} by {found.method}", len(found.failed_checks))


CASES: dict[str, Callable[[], Answer]] = {
    "rank, shear building": lambda: ranked("shear_building.py"),
    "rank, Liverpool frame": lambda: ranked("liverpool_frame.py"),
    "rank, four classes of the steel frame": lambda: ranked("steel_frame.py", 4),
    "rank, footbridge in a reduced basis": lambda: ranked("finite_elements/footbridge.py"),
    "search, bare building": lambda: searched("bare_building.py"),
    "calibrate, shear building": lambda: calibrated("shear_building.py"),
    "identify, simulated record": identified,
}


def run(case: str, setting: Setting) -> tuple[Answer | None, int]:
    """What a case gives in a process of its own, None if that ends in an error; its exit code."""
    command = [sys.executable, __file__, "--case", case]
    ended = subprocess.run(command, env=setting.environment, capture_output=True, text=True)
    if ended.returncode:
        print(f"{case}, {setting}: exit code {ended.returncode}\n{ended.stderr}", file=sys.stderr)
        return None, ended.returncode
    return Answer(*json.loads(ended.stdout.splitlines()[-1])), 0


def supported(kernel: str) -> bool:
    """Whether this processor has the kernel's instructions; said where it has not."""
    probe = [sys.executable, "-c", PROBE]
    code = subprocess.run(probe, env=Setting(kernel, 1).environment, capture_output=True).returncode
    if code:
        print(f"{kernel}: left out, not supported by this processor (exit code {code})")
    return code == 0


def compared(case: str, results: Mapping[Setting, tuple[Answer | None, int]]) -> bool:
    """Print one case's results side by side; whether they agree."""
    answers = {str(setting): answer for setting, (answer, _) in results.items() if answer}
    columns = [answer for answer, _ in results.values()]
    print(f"\n{case:40}" + "".join(f"{setting!s:>19}" for setting in results))
    for name in dict.fromkeys(name for answer in answers.values() for name in answer.estimates):
        known = [answer and answer.estimates.get(name) for answer in columns]
        cells = [f"{each[0]:.6g} ± {each[1]:.1g}" if each else "-" for each in known]
        print(f"  {name:38}" + "".join(f"{cell:>19}" for cell in cells))
    failed = [answer.n_failed_checks if answer else "-" for answer in columns]
    codes = [code for _, code in results.values()]
    for label, numbers in (("failed checks", failed), ("exit code", codes)):
        print(f"  {label:38}" + "".join(f"{number!s:>19}" for number in numbers))
    for words in dict.fromkeys(answer.words for answer in answers.values()):
        own = [name for name, answer in answers.items() if answer.words == words]
        print(f"  answer{'' if len(own) == len(results) else ' of ' + ', '.join(own)}: {words}")
    apart, where = max(
        (
            (abs(x - y) / math.hypot(dx, dy), f"{name}, {a} and {b}")
            for (a, one), (b, other) in combinations(answers.items(), 2)
            for name in one.estimates.keys() & other.estimates.keys()
            for (x, dx), (y, dy) in [(one.estimates[name], other.estimates[name])]
        ),
        default=(0.0, "nothing to compare"),
    )
    alike = {
        (answer.words, answer.n_failed_checks, *answer.estimates) for answer in answers.values()
    }
    agree = len(answers) == len(results) and len(alike) == 1 and apart <= MOST_JOINT_ERRORS
    verdict = "agree" if agree else "DIFFER"
    print(f"  {verdict}; largest difference {apart:.2g} joint errors ({where})", flush=True)
    return agree


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kernels", nargs="+", default=KERNELS)
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--only", help="names of cases, separated by semicolons")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.case:
        print(json.dumps(CASES[asked.case]()))
        return
    kernels = [kernel for kernel in asked.kernels if supported(kernel)]
    settings = [Setting(kernel, n) for kernel in kernels for n in asked.threads]
    chosen = asked.only.split(";") if asked.only else list(CASES)
    agree = [compared(case, {s: run(case, s) for s in settings}) for case in chosen]
    print(f"\n{sum(agree)} of {len(agree)} cases agree under {', '.join(map(str, settings))}")
    sys.exit(not all(agree))


if __name__ == "__main__":
    main()
