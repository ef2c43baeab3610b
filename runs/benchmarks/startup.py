"""The cost of starting up, compared with the libraries that every computation needs.

    python runs/benchmarks/startup.py [RUNS]

Import times, by ``python -X importtime``, of numpy, scipy.linalg and scipy.special together, of
bayes_ssi, and of ``bayes-ssi --help``, each in its own process, alternating, RUNS times (9 if
not given); medians, and their ratios. The package promises at most 1.5 and 2.
"""

import os
import statistics
import subprocess
import sys

LIBRARIES = "import numpy, scipy.linalg, scipy.special"
STARTS = {
    "numpy, scipy.linalg, scipy.special": LIBRARIES,
    "import bayes_ssi": "import bayes_ssi",
    "bayes-ssi --help": "from bayes_ssi.cli import main; main(['--help'])",
}
# Avoid measuring the compilation of modules.
ENVIRONMENT = {
    name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
}
LIMITS = {"import bayes_ssi": 1.5, "bayes-ssi --help": 2.0}


def import_seconds(code: str) -> float:
    """Time in imports of a process that runs ``code``: the sum of every module's own time."""
    command = [sys.executable, "-X", "importtime", "-c", code]
    report = subprocess.run(command, capture_output=True, text=True, check=True, env=ENVIRONMENT)
    rows = (line.removeprefix("import time:").split("|") for line in report.stderr.splitlines())
    return sum(int(row[0]) for row in rows if len(row) == 3 and row[0].strip().isdigit()) / 1e6


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    for code in STARTS.values():  # what Python compiles on the first run
        import_seconds(code)
    times = {name: [] for name in STARTS}
    for _ in range(runs):
        for name, code in STARTS.items():
            times[name].append(import_seconds(code))
    base = statistics.median(times["numpy, scipy.linalg, scipy.special"])
    for name, seconds in times.items():
        median = statistics.median(seconds)
        ratio = median / base
        limit = LIMITS.get(name)
        judged = "" if limit is None else f", at most {limit:g}: {ratio <= limit}"
        print(f"{name:36s} {1000 * median:6.0f} ms   {ratio:.2f} times{judged}")


if __name__ == "__main__":
    main()
