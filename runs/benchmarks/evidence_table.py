"""A table of the runs that evidence_accuracy.py wrote, as Markdown, and their sums.

python runs/benchmarks/evidence_table.py FILE …
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

from evidence_accuracy import Run, summary
from nested_samplers import SAMPLERS

HEAD = (
    "problem", "rms error", "claimed/actual", "failed checks", "declared", "confident wrong",
    "evaluations", "CPU s", *SAMPLERS,
)  # fmt: skip


def compared(runs: list[Run], own: dict[str, float]) -> str:
    """Computing time over ours, and the error; why not where nothing finished."""
    if not runs:
        return ""
    figures = summary(runs)
    if figures["unfinished"] == len(runs):
        return str(runs[0]["unfinished"])
    ratio = figures["seconds"] / own["seconds"]
    return f"{ratio:.0f} times the time, rms error {figures['rms_error']:.3f}"


def row(name: str, by_sampler: dict[str, list[Run]]) -> str:
    own = summary(by_sampler["bayes_ssi"])
    cells = [
        name,
        f"{own['rms_error']:.4f}",
        f"{own['claimed_over_actual']:.2f}",
        f"{own['failed_checks']}/{own['runs']}",
        str(own["declared"]),
        str(own["confident_wrong"]),
        f"{own['evaluations']:.0f}",
        f"{own['seconds']:.2f}",
        *(compared(by_sampler.get(sampler, []), own) for sampler in SAMPLERS),
    ]
    return "| " + " | ".join("–" if cell == "nan" else cell for cell in cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path)
    options = parser.parse_args()
    by_problem: dict[str, dict[str, list[Run]]] = {}
    for line in (line for file in options.files for line in file.read_text().splitlines()):
        run = json.loads(line)
        by_problem.setdefault(run["problem"], {}).setdefault(run["sampler"], []).append(run)
    print("| " + " | ".join(HEAD) + " |")
    print("| " + " | ".join("---" for _ in HEAD) + " |")
    for name, by_sampler in by_problem.items():
        print(row(name, by_sampler))
    runs = [run for by_sampler in by_problem.values() for run in by_sampler["bayes_ssi"]]
    counts = Counter(run["verdict"] for run in runs)
    counted = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
    seconds = sum(run["seconds"] for run in runs)
    print(f"\n{len(runs)} runs of {len(by_problem)} problems in {seconds:.0f} s: {counted}")


if __name__ == "__main__":
    main()
