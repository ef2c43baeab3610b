"""Log evidences against known answers, over many seeds, compared with two nested samplers.

    pip install -e ".[benchmarks]"
    python runs/benchmarks/evidence_accuracy.py [--seeds 20] [--part 1/2] [--lines FILE]
        [--only "NAME;…"] [--dynesty-seeds 0] [--nautilus-seeds 0] [--time-limit 300]
    python runs/benchmarks/evidence_table.py FILE …

One line for each problem: the root-mean-square error of the log evidence, the claimed error over
it, the largest error of a region's probability, how many runs failed a check, how many declared
that a region of that prior mass could be unseen, how many were confidently wrong, evaluations, and
seconds of one processor. The sum of confident wrong answers comes last.

A failed check is a result that says itself that it may be wrong. A wrong answer without one is
confident, unless the problem hides a region to which nothing leads and the result states that a
region of at least that prior mass could be unseen. Errors are claimed/actual over the runs that
neither fail a check nor miss such a region.

The nested samplers run at their defaults, vectorised where possible, on problems of up to six
dimensions; what they have not finished within the time limit (CPU seconds) is printed as such.
``--part i/n`` takes every nth problem, so that n processes share the work; ``--lines`` writes one
line of JSON for each run, from which ``evidence_table.py`` makes one table of all parts.
"""

from __future__ import annotations

import argparse
import contextlib
import json
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from catalogue import all_problems
from known_evidence import Problem
from nested_samplers import SAMPLERS, sample_within
from threadpoolctl import threadpool_limits

from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.target import Target

Run = dict[str, Any]
# Largest number of dimensions in which nested samplers are compared.
MOST_DIMENSIONS = 6
# An error of more than four standard errors comes by chance once in 16,000 runs, 0.1 times in 20
# runs of all problems; one of less than 0.05 nats changes the odds of two classes by less than
# 5 %, which no ranking turns on.
STANDARD_ERRORS, LEAST_ERROR = 4.0, 0.05


def ours(problem: Problem, seed: int) -> Run:
    begun = process_time()
    if problem.model_class is None:
        target = Target(problem.log_likelihood, problem.n_dimensions)
    else:
        target = class_target(problem.model_class)
    try:
        sampled = sample_target(target, np.random.SeedSequence(seed))
    except ValueError as refusal:
        return {
            "unfinished": str(refusal),
            "seconds": process_time() - begun,
            "evaluations": target.n_evaluations,
        }
    seconds = process_time() - begun
    weights, z = sampled.importance.weights, sampled.importance.z
    shares = [abs(weights[test(z)].sum() - known) for test, known in problem.regions.values()]
    return {
        "log_evidence": sampled.evidence.log_evidence,
        "claimed": sampled.evidence.error,
        "share_error": max(shares, default=0.0),
        "evaluations": sampled.n_evaluations,
        "seconds": seconds,
        "failed_checks": sampled.failed_checks,
        "largest_unseen_mass": sampled.search.largest_unseen_mass,
    }


def verdict(run: Run) -> str:
    """ "right", "failed check", "declared" or "confident wrong"."""
    if "unfinished" in run or run["failed_checks"]:
        return "failed check"
    error = abs(run["log_evidence"] - run["exact"])
    if error <= max(STANDARD_ERRORS * run["claimed"], LEAST_ERROR):
        return "right"
    hidden = run["hidden_mass"]
    if hidden is not None and hidden <= run["largest_unseen_mass"]:
        return "declared"
    return "confident wrong"


def summary(runs: list[Run]) -> dict[str, float]:
    """Figures of the runs of one sampler on one problem; NaN where no run gives them."""
    finished = [run for run in runs if "log_evidence" in run]
    errors = np.array([run["log_evidence"] - run["exact"] for run in finished])
    verdicts = [run.get("verdict", "right") for run in finished]
    stands = np.isin(verdicts, ["right", "confident wrong"])
    claimed = np.array([run["claimed"] for run in finished])
    return {
        "runs": len(runs),
        "unfinished": len(runs) - len(finished),
        "rms_error": rms(errors),
        "claimed_over_actual": rms(claimed[stands]) / rms(errors[stands]),
        "share_error": max((run.get("share_error", 0.0) for run in finished), default=np.nan),
        "failed_checks": sum(run.get("verdict") == "failed check" for run in runs),
        "declared": verdicts.count("declared"),
        "confident_wrong": verdicts.count("confident wrong"),
        "evaluations": float(np.mean([run.get("evaluations", np.nan) for run in runs])),
        "seconds": float(np.mean([run.get("seconds", np.nan) for run in runs])),
    }


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def report(sampler: str, runs: list[Run]) -> None:
    figures = summary(runs)
    if figures["unfinished"] == len(runs):
        print(f"  {sampler:9s} {runs[0]['unfinished']}", flush=True)
        return
    line = (
        f"  {sampler:9s} rms error {figures['rms_error']:.4f}  claimed/actual "
        f"{figures['claimed_over_actual']:.2f}"
    )
    if sampler == "bayes_ssi":
        line += (
            f"  region {figures['share_error']:.3f}  failed checks {figures['failed_checks']}"
            f"  declared {figures['declared']}  confident wrong {figures['confident_wrong']}"
        )
    line += f"  evaluations {figures['evaluations']:.0f}  {figures['seconds']:.2f} s"
    print(line, flush=True)


def part(text: str) -> tuple[int, int]:
    number, _, of = text.partition("/")
    if not (number.isdigit() and of.isdigit() and 1 <= int(number) <= int(of)):
        raise argparse.ArgumentTypeError(f"must be i/n with 1 <= i <= n, got {text!r}")
    return int(number), int(of)


def chosen(only: str, one_of: tuple[int, int]) -> list[Problem]:
    problems = all_problems()
    wanted = [name.strip() for name in only.split(";") if name.strip()]
    unknown = set(wanted) - {problem.name for problem in problems}
    if unknown:
        names = ", ".join(problem.name for problem in problems)
        raise SystemExit(f"no problem {sorted(unknown)[0]!r}; choose from {names}")
    kept = [problem for problem in problems if not wanted or problem.name in wanted]
    return kept[one_of[0] - 1 :: one_of[1]]


def runs_of(problem: Problem, sampler: str, seeds: range, limit: int) -> list[Run]:
    runs = []
    for seed in seeds:
        if sampler == "bayes_ssi":
            answer = ours(problem, seed)
        else:
            answer = sample_within(sampler, problem, seed, limit)
        run: Run = {
            "problem": problem.name,
            "n_dimensions": problem.n_dimensions,
            "sampler": sampler,
            "seed": seed,
            "exact": problem.log_evidence,
            "hidden_mass": problem.hidden_mass,
            **answer,
        }
        if sampler == "bayes_ssi":
            run["verdict"] = verdict(run)
        runs.append(run)
    return runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--part", type=part, default=(1, 1), help="i/n: every nth problem")
    parser.add_argument("--only", default="", help="names of problems, separated by semicolons")
    parser.add_argument("--lines", type=Path, help="file for one line of JSON a run")
    parser.add_argument("--dynesty-seeds", type=int, default=0)
    parser.add_argument("--nautilus-seeds", type=int, default=0)
    parser.add_argument("--time-limit", type=int, default=300, help="CPU seconds of one of these")
    options = parser.parse_args()
    counts = {"bayes_ssi": options.seeds}
    counts |= {name: getattr(options, f"{name}_seeds") for name in SAMPLERS}
    n_runs = n_wrong = 0
    lines = options.lines.open("x") if options.lines else contextlib.nullcontext()
    with threadpool_limits(limits=1, user_api="blas"), lines as file:
        for problem in chosen(options.only, options.part):
            print(
                f"{problem.name}: d = {problem.n_dimensions}, log evidence "
                f"{problem.log_evidence:.4f}",
                flush=True,
            )
            for sampler, n in counts.items():
                if sampler != "bayes_ssi" and problem.n_dimensions > MOST_DIMENSIONS:
                    continue
                if not n or (sampler == "nautilus" and problem.n_dimensions < 2):  # it needs two
                    continue
                seeds = range(options.first_seed, options.first_seed + n)
                runs = runs_of(problem, sampler, seeds, options.time_limit)
                report(sampler, runs)
                if file:
                    file.writelines(json.dumps(run) + "\n" for run in runs)
                    file.flush()
                if sampler == "bayes_ssi":
                    n_runs += len(runs)
                    n_wrong += sum(run["verdict"] == "confident wrong" for run in runs)
    print(f"confident wrong answers: {n_wrong} of {n_runs} runs")


if __name__ == "__main__":
    main()
