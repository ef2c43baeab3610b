"""How long do whole commands take, from key press to prompt?

    python runs/benchmarks/whole_commands.py [--before PATH] [--runs 3] [--only "shear building;…"]

Every command runs as a process of its own with its defaults, several times; those of another
checkout, PATH, alternate with those of this one, so that both see the same state of the machine.
The table gives medians of wall time and of the processor time of all its processes, and of the
latter without the import of modules of other packages that the other checkout does without.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory, TemporaryFile
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
    imports: dict[str, float]  # module → seconds of its import, without those that it imports

    def without_imports(self, other: Seconds) -> float:
        """Processor time without the import of other packages' modules that ``other`` lacks."""
        lacking = self.imports.keys() - other.imports.keys()
        own = {name for name in lacking if name.split(".")[0] == "bayes_ssi"}
        return self.processor - sum(self.imports[name] for name in lacking - own)


def seconds_of_imports(report: str) -> dict[str, float]:
    """Module → seconds, of ``python -X importtime``."""
    rows = [line.removeprefix("import time:").split("|") for line in report.splitlines()]
    rows = [row for row in rows if len(row) == 3 and row[0].strip().isdigit()]
    return {name.strip(): int(own) / 1e6 for own, _, name in rows}


def timed(command: tuple[str, ...], tree: Path) -> Seconds:
    """Run a command of a checkout.

    Raises:
        RuntimeError: it failed.
    """
    # As a user has it: linear algebra may use what threads it likes.
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    environment |= {"PYTHONPATH": str(tree), "PYTHONPROFILEIMPORTTIME": "1"}
    with TemporaryDirectory() as directory, TemporaryFile("w+") as messages:
        arguments = [str(Path(directory, "r")) if each == OUTPUT else each for each in command]
        begun = perf_counter()
        process = subprocess.Popen(
            arguments, cwd=tree, env=environment, stdout=subprocess.DEVNULL, stderr=messages
        )
        _, status, usage = os.wait4(process.pid, 0)
        wall = perf_counter() - begun
        process.returncode = os.waitstatus_to_exitcode(status)
        messages.seek(0)
        report = messages.read()
    if process.returncode:
        lines = [line for line in report.splitlines() if not line.startswith("import time:")]
        raise RuntimeError(
            f"{tree}: exit code {process.returncode}: {' '.join(arguments)}\n" + "\n".join(lines)
        )
    return Seconds(wall, usage.ru_utime + usage.ru_stime, seconds_of_imports(report))


def summary(runs: list[Seconds], others: list[Seconds]) -> str:
    walls = [run.wall for run in runs]
    pairs = list(zip(runs, others, strict=True))
    without = [run.without_imports(other) for run, other in pairs]
    ratios = [run.without_imports(other) / other.without_imports(run) for run, other in pairs]
    return (
        f"{median(walls):6.1f} ({min(walls):.1f} to {max(walls):.1f})  "
        f"{median(run.processor for run in runs):9.2f} {median(without):15.2f} "
        f"{median(ratios):6.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
    )


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
    print(
        f"{'command':22s} {'tree':7s} {'wall (least to most)':>22s}  processor without imports, "
        "over the first tree's, wanted wall"
    )
    for name in chosen:
        runs: dict[str, list[Seconds]] = {tree: [] for tree in trees}
        for _ in range(options.runs):
            for tree, path in trees.items():
                runs[tree].append(timed(COMMANDS[name], path))
        for tree, of_tree in runs.items():
            wanted = f"{WANTED[name]:8.0f}" if tree == "this" else ""
            text = summary(of_tree, next(iter(runs.values())))
            print(f"{name:22s} {tree:7s} {text}  {wanted}", flush=True)


if __name__ == "__main__":
    main()
