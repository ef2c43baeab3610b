"""How long do whole commands take, from key press to prompt?

    python runs/benchmarks/whole_commands.py [--before PATH] [--runs 3] [--only "shear building;…"]

Every command runs as a process of its own with its defaults, several times; those of another
checkout, PATH, alternate with those of this one, so that both see the same state of the machine.
The table gives medians of wall time and of the processor time of all its processes.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import NamedTuple

THIS = Path(__file__).parents[2]
CLI = (sys.executable, "-c", "from bayes_ssi.cli import main; main()")
OUTPUT = "OUTPUT"  # replaced by the path of a new directory
OPTIONS = ("--out", OUTPUT, "--quiet", "--accept-failed-checks")
COMMANDS = {
    "shear building": (*CLI, "rank", "model_classes/shear_building.py", *OPTIONS),
    "Liverpool frame": (*CLI, "rank", "model_classes/liverpool_frame.py", *OPTIONS),
    "steel frame": (*CLI, "rank", "model_classes/steel_frame.py", *OPTIONS),
    "search, bare building": (*CLI, "search", "model_classes/bare_building.py", *OPTIONS),
    "search, 20 storeys": (sys.executable, "runs/benchmarks/tall_building.py"),
}
# Seconds on two cores.
WANTED = {
    "shear building": 5.0,
    "Liverpool frame": 20.0,
    "steel frame": 30.0,
    "search, bare building": 10.0,
    "search, 20 storeys": 30.0,
}


class Seconds(NamedTuple):
    """What one process took, with all processes that it started."""

    wall: float
    processor: float


def timed(command: tuple[str, ...], tree: Path) -> Seconds:
    """Run a command of a checkout.

    Raises:
        RuntimeError: it failed.
    """
    # As a user has it: linear algebra may use what threads it likes.
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    environment["PYTHONPATH"] = str(tree)
    with TemporaryDirectory() as directory:
        arguments = [str(Path(directory, "r")) if each == OUTPUT else each for each in command]
        begun = perf_counter()
        process = subprocess.Popen(arguments, cwd=tree, env=environment, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        wall = perf_counter() - begun
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{tree}: exit code {process.returncode}: {' '.join(arguments)}")
    return Seconds(wall, usage.ru_utime + usage.ru_stime)


def summary(runs: list[Seconds]) -> str:
    wall, processor = (median(values) for values in zip(*runs, strict=True))
    low, high = min(run.wall for run in runs), max(run.wall for run in runs)
    return f"{wall:6.1f} ({low:.1f} to {high:.1f})  {processor:6.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, help="another checkout to compare with")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", help="names of commands, separated by semicolons")
    options = parser.parse_args()
    chosen = options.only.split(";") if options.only else list(COMMANDS)
    trees = {"this": THIS}
    if options.before is not None:
        trees = {"before": options.before.resolve(), **trees}
    print(f"{options.runs} runs each on {len(os.sched_getaffinity(0))} cores; seconds, medians")
    print(f"{'command':22s} {'tree':7s} {'wall (least to most)':>22s}  processor  wanted")
    for name in chosen:
        runs: dict[str, list[Seconds]] = {tree: [] for tree in trees}
        for _ in range(options.runs):
            for tree, path in trees.items():
                runs[tree].append(timed(COMMANDS[name], path))
        for tree, of_tree in runs.items():
            wanted = f"{WANTED[name]:8.0f}" if tree == "this" else ""
            print(f"{name:22s} {tree:7s} {summary(of_tree):>31s}  {wanted}", flush=True)


if __name__ == "__main__":
    main()
