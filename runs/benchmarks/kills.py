"""Does a command that is killed at random times and resumed give the same result?

    python runs/benchmarks/kills.py [--kills 20] [--study model_classes/shear_building.py]
        [--seed 0]

``bayes-ssi rank`` is run once without interruption. Then, ``--kills`` times, it is started in a
new directory, killed (SIGKILL) and started again until it ends; half of the killed commands are
killed a second time if they last long enough. Every second kill comes after a uniformly random
share of the first run's time, the others when the journals reach a uniformly random size. The
results must be the same: the ranking to the last byte, every array of draws to the last bit, and
nothing may be left next to the result. Prints in which step each command was killed, judged by the
size of the journals. The exit code is 1 if a result differs.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter, sleep

import numpy as np

from bayes_ssi.inference.workers.run import Run
from bayes_ssi.results.stored_result import load_result
from bayes_ssi.studies.questions import rank
from bayes_ssi.studies.ranking.study import load_study

COMMAND = [sys.executable, "-c", "from bayes_ssi.cli import main; main()", "rank"]
STUDY = Path(__file__).parents[2] / "model_classes" / "shear_building.py"
FILES = ("comparison.json", "comparison.csv", "data.csv")
ARRAYS = ("draws", "log_likelihoods", "frequencies_hz", "maxima", "relative_spreads")
KILL_AGAIN = 0.5
KILL_BY_TIME = 0.5
AFTER_THE_END = "after the end"

# Name of a journal → (step, size at the step's end), in the order of classes and steps.
Steps = dict[str, list[tuple[str, int]]]


class Command:
    """The command ``rank`` with result directory ``r``, alone in its parent directory."""

    def __init__(self, study: Path, seed: int, place: Path) -> None:
        self.result = place / "r"
        self.checkpoint = place / ".r.checkpoint"
        self.arguments = [*COMMAND, str(study), "--seed", str(seed), "--out", str(self.result)]
        self.arguments.append("--accept-failed-checks")

    def run(self, seconds: float = np.inf, size: float = np.inf) -> bool:
        """Whether the command ended by itself before the time was up or its journals had that size.

        Raises:
            RuntimeError: it ended in an error.
        """
        begun = perf_counter()
        with subprocess.Popen(
            self.arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as process:
            while process.poll() is None:
                if perf_counter() - begun > seconds or self.journal_size() > size:
                    process.kill()
                    break
                sleep(0.002)
            _, stderr = process.communicate()
        if process.returncode not in (0, -signal.SIGKILL):
            raise RuntimeError(f"exit code {process.returncode}: {stderr}")
        return process.returncode == 0

    def journal_size(self) -> int:
        try:
            return sum(path.stat().st_size for path in self.checkpoint.glob("*.journal"))
        except FileNotFoundError:  # removed just now
            return 0

    def step(self, steps: Steps) -> str:
        """The step in which the command was killed."""
        if not self.checkpoint.exists():
            return AFTER_THE_END if self.result.exists() else "before the first evaluation"
        if (self.checkpoint / "saving").exists():
            return "saving"
        begun = [name for name in steps if (self.checkpoint / name).exists()]
        if not begun:
            return "before the first evaluation"
        size = (self.checkpoint / begun[-1]).stat().st_size
        share = size / steps[begun[-1]][-1][1]
        step = next((step for step, end in steps[begun[-1]] if size < end), "the end")
        return f"{step} of class {len(begun)} ({100 * share:.0f} % of its journal)"


def steps_of(study: Path, seed: int, checkpoint: Path) -> Steps:
    """How far the journals grow in each step."""
    ends: dict[str, dict[str, int]] = {}

    def note(_: str, step: str, __: float) -> None:
        new = [path for path in checkpoint.glob("*.journal") if path.name not in ends]
        path = new[0] if new else checkpoint / list(ends)[-1]
        ends.setdefault(path.name, {})[step] = path.stat().st_size

    rank(load_study(study), seed, run=Run(checkpoint=checkpoint, progress=note))
    for name, steps in ends.items():
        steps[list(steps)[-1]] = (checkpoint / name).stat().st_size
    return {name: list(steps.items()) for name, steps in ends.items()}


def differences(result: Path, expected: Path) -> Iterator[str]:
    """Differences between two results, and what was left next to the first."""
    yield from sorted(path.name for path in result.parent.iterdir() if path != result)
    for name in FILES:
        if (result / name).read_bytes() != (expected / name).read_bytes():
            yield name
    pairs = zip(load_result(result).posteriors, load_result(expected).posteriors, strict=True)
    for a, b in pairs:
        for array in ARRAYS:
            if getattr(a, array).tobytes() != getattr(b, array).tobytes():
                yield f"{array} of {a.name!r}"
        if (a.name, a.evidence, a.failed_checks) != (b.name, b.evidence, b.failed_checks):
            yield f"evidence of {a.name!r}"


def killed(command: Command, steps: Steps, seconds: float, rng: np.random.Generator) -> list[str]:
    """Kill a command, once or more if it lasts, and let it end; return the steps of the kills."""
    total = sum(ends[-1][1] for ends in steps.values())
    fallen_in: list[str] = []
    while not fallen_in or rng.random() < KILL_AGAIN:
        if rng.random() < KILL_BY_TIME:
            ended = command.run(seconds=rng.uniform(0.0, seconds))
        else:
            ended = command.run(size=rng.uniform(command.journal_size(), total))
        if ended:
            return fallen_in
        fallen_in.append(command.step(steps))
        if fallen_in[-1] == AFTER_THE_END:
            return fallen_in
    command.run()
    return fallen_in


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20, help="results of killed commands")
    parser.add_argument("--study", type=Path, default=STUDY)
    parser.add_argument("--seed", type=int, default=0, help="of the study, and of the times")
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        steps = steps_of(asked.study, asked.seed, directory / "steps")
        first = Command(asked.study, asked.seed, directory / "uninterrupted")
        begun = perf_counter()
        first.run()
        seconds = perf_counter() - begun
        print(f"uninterrupted: {seconds:.1f} s", flush=True)
        n_same, counts = 0, Counter[str]()
        for number in range(1, asked.kills + 1):
            command = Command(asked.study, asked.seed, directory / str(number))
            fallen_in = killed(command, steps, seconds, rng)
            different = list(differences(command.result, first.result))
            n_same += not different
            counts.update(step.split(" of ")[0] for step in fallen_in)
            print(
                f"{number:3d}: {'DIFFERS: ' + ', '.join(different) if different else 'identical'}; "
                f"killed in {'; '.join(fallen_in) or 'no step, it ended before'}",
                flush=True,
            )
    print(f"{counts.total()} kills: " + ", ".join(f"{n} in {step}" for step, n in counts.items()))
    print(f"{n_same} of {asked.kills} results identical")
    sys.exit(n_same < asked.kills)


if __name__ == "__main__":
    main()
