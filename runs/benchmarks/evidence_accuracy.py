"""Log evidences of problems with known answers, over many seeds, and their quoted draws.

    python runs/benchmarks/evidence_accuracy.py FILE [--seeds 5] [--part 1/2] [--only "NAME;…"]
    python runs/benchmarks/evidence_accuracy.py FILE --shipped [--only "STUDY, CLASS;…"]
    python runs/benchmarks/evidence_accuracy.py FILE --summary [--before FILE]

The first appends one line of JSON for each run to FILE; ``--part i/n`` takes every nth problem, so
that calls share the work. The second takes the classes of the shipped studies, whose log evidences
are known for the shear building alone. Two problems are run only by name, "12 storeys" and
"15 storeys": three frequencies known to 0.1 %, so that of as many stiffnesses the data determine
three directions, along a sheet that curves by many times its thickness.

The third prints a table of all problems in FILE, as Markdown: the mean log evidence, its
root-mean-square error (the scatter about the mean where none is known), the claimed error over it,
the largest error of a region's probability, how many runs failed a check, declared that a region of
that prior mass could be unseen, and were confidently wrong, evaluations, seconds of one processor,
and of the quoted draws by arviz the least effective sample size, bulk and tail, and the largest
R-hat, and the share of their chains that are emcee's; then the sums, beside those of another file.

A failed check is a result that says itself that it may be wrong. A wrong answer without one is
confident, unless the problem hides a region to which nothing leads and the result states that a
region of at least that prior mass could be unseen. Errors are claimed/actual over the runs that
neither fail a check nor miss such a region.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from time import process_time

import beside_tests  # noqa: F401
import numpy as np
import quoted_draws
from catalogue import all_problems
from known_evidence import Problem
from problems_modal import as_problem, frequencies_alone
from quoted_draws import Run
from threadpoolctl import threadpool_limits

import bayes_ssi as bs
from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.posterior_sampling import sample
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.target import Target

# The draws (n_chains, n_draws, d) that a posterior quotes come first.
QUOTED = getattr(sample, "_quoted_draws", None) or sample._corrected_draws
# An error of more than four standard errors comes by chance once in 16,000 runs, 0.1 times in 20
# runs of all problems; one of less than 0.05 nats changes the odds of two classes by less than
# 5 %, which no ranking turns on.
STANDARD_ERRORS, LEAST_ERROR = 4.0, 0.05
STUDIES = Path(__file__).parents[2] / "model_classes"
# Independent nested sampling and quadrature.
SHEAR_BUILDING = {"1-a": 0.248, "1-b": -10.057, "2": -9.304, "3": 16.067}


def shipped() -> list[Problem]:
    return [
        replace(as_problem(candidate, math.nan), name=f"{study.stem}, {candidate.name}",
                log_evidence=SHEAR_BUILDING[candidate.name] if study.stem == "shear_building"
                else math.nan)
        for study in sorted(STUDIES.glob("*.py"))
        for candidate in bs.load_study(study).model_classes
    ]  # fmt: skip


def many_storeys(n: int) -> Problem:
    """Frequencies 2, -1 and 1 % off those of n equal storeys, whose first would be 1 Hz."""
    angles = (2.0 * np.arange(3) + 1.0) * math.pi / (4 * n + 2)
    observed = np.array([1.02, 0.99, 1.01]) * np.sin(angles) / np.sin(angles[0])
    return as_problem(frequencies_alone(f"{n} storeys", n, observed, 1e-3), math.nan)


def ours(problem: Problem, seed: int) -> Run:
    begun = process_time()
    if problem.model_class is None:
        target = Target(problem.log_likelihood, problem.n_dimensions)
    else:
        target = class_target(problem.model_class)
    with quoted_draws.watching_emcee() as steps_of_emcee:
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
        draws = QUOTED(sampled, np.random.default_rng(seed))[0]
        return {
            "log_evidence": sampled.evidence.log_evidence,
            "claimed": sampled.evidence.error,
            "share_error": max(shares, default=0.0),
            "evaluations": sampled.n_evaluations,
            "seconds": seconds,
            "failed_checks": sampled.failed_checks,
            "largest_unseen_mass": sampled.search.largest_unseen_mass,
            "emcee": quoted_draws.share_of_emcee(draws, steps_of_emcee()),
            **quoted_draws.diagnostics(draws),
        }


def run_of(problem: Problem, seed: int) -> Run:
    run = {
        "problem": problem.name,
        "seed": seed,
        "exact": problem.log_evidence,
        "hidden_mass": problem.hidden_mass,
        **ours(problem, seed),
    }
    return {**run, "verdict": verdict(run)}


def verdict(run: Run) -> str:
    """ "right", "failed check", "declared" or "confident wrong"."""
    if "unfinished" in run or run["failed_checks"]:
        return "failed check"
    if not is_off(run):
        return "right"
    hidden = run["hidden_mass"]
    if hidden is not None and hidden <= run["largest_unseen_mass"]:
        return "declared"
    return "confident wrong"


def is_off(run: Run) -> bool:
    error = abs(run["log_evidence"] - run["exact"])
    return bool(error > max(STANDARD_ERRORS * run["claimed"], LEAST_ERROR))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def errors_of(runs: list[Run], *verdicts: str) -> tuple[np.ndarray, np.ndarray]:
    """Actual and claimed errors of the finished runs, or of those with one of these verdicts.

    Of the problems whose log evidence is known.
    """
    kept = [
        run for run in runs
        if "claimed" in run and run["verdict"] in (verdicts or run["verdict"])
        and not math.isnan(run["exact"])
    ]  # fmt: skip
    actual = np.array([run["log_evidence"] - run["exact"] for run in kept])
    return actual, np.array([run["claimed"] for run in kept])


HEAD = (
    "problem", "log evidence", "rms error", "claimed/actual", "region", "failed checks", "declared",
    "confident wrong", "evaluations", "CPU s", "bulk ESS", "tail ESS", "R-hat", "emcee's",
)  # fmt: skip


def row(name: str, runs: list[Run]) -> str:
    finished = [run for run in runs if "claimed" in run]
    mean = float(np.mean([run["log_evidence"] for run in finished] or [np.nan]))
    if math.isnan(runs[0]["exact"]):
        runs = [{**run, "exact": mean} for run in runs]
    actual, claimed = errors_of(runs, "right", "confident wrong")
    verdicts = [run["verdict"] for run in runs]
    sizes = [[run[key] for run in finished] for key in ("ess_bulk", "ess_tail")]
    cells = [
        name,
        f"{mean:.3f}",
        f"{rms(errors_of(runs)[0]):.4f}",
        f"{rms(claimed) / rms(actual):.2f}",
        f"{max((run['share_error'] for run in finished), default=np.nan):.3f}",
        f"{verdicts.count('failed check')}/{len(runs)}",
        str(verdicts.count("declared")),
        str(verdicts.count("confident wrong")),
        f"{np.mean([run['evaluations'] for run in runs]):.0f}",
        f"{np.mean([run['seconds'] for run in runs]):.2f}",
        *(f"{min(each, default=np.nan):.0f}" for each in sizes),
        f"{max((run['r_hat'] for run in finished), default=np.nan):.3f}",
        f"{np.mean([run['emcee'] for run in finished] or [np.nan]):.2f}",
    ]
    return "| " + " | ".join("–" if cell == "nan" else cell for cell in cells) + " |"


def sums(runs: list[Run]) -> str:
    actual, claimed = errors_of(runs, "right")
    counts = Counter(run["verdict"] for run in runs).most_common()
    finished = [run for run in runs if "claimed" in run]
    right_and_failed = sum(run["verdict"] == "failed check" and not is_off(run) for run in finished)
    return (
        f"{len(runs)} runs of {len({run['problem'] for run in runs})} problems, "
        f"{sum(run['evaluations'] for run in runs):.3g} evaluations and "
        f"{sum(run['seconds'] for run in runs):.0f} s: "
        + ", ".join(f"{count} {verdict}" for verdict, count in counts)
        + f"; {right_and_failed} of the failed checks in right answers. Of the right without one: "
        f"rms error {rms(actual):.4f}, claimed {rms(claimed):.4f}, rms of error over claimed "
        f"{rms(actual / claimed):.2f}, largest {np.abs(actual / claimed).max(initial=0.0):.1f}; "
        f"{quoted_draws.quality(finished)}"
    )


def summary(file: Path, before: Path | None) -> None:
    own = quoted_draws.read(file, "problem")
    print("| " + " | ".join(HEAD) + " |\n" + "| " + " | ".join("---" for _ in HEAD) + " |")
    for name, runs in own.items():
        print(row(name, runs))
    print(f"\n{sums([run for runs in own.values() for run in runs])}")
    if before is None:
        return
    other = quoted_draws.read(before, "problem")
    print(f"\nBefore: {sums([run for name in own for run in other.get(name, [])])}")
    quoted_draws.print_ratios(other, own)


def part(text: str) -> tuple[int, int]:
    number, _, of = text.partition("/")
    if not (number.isdigit() and of.isdigit() and 1 <= int(number) <= int(of)):
        raise argparse.ArgumentTypeError(f"must be i/n with 1 <= i <= n, got {text!r}")
    return int(number), int(of)


def chosen(problems: list[Problem], only: str, one_of: tuple[int, int]) -> list[Problem]:
    wanted = [name.strip() for name in only.split(";") if name.strip()]
    if wanted:
        by_name = {each.name: each for each in (*problems, *map(many_storeys, (12, 15)))}
        if unknown := set(wanted) - by_name.keys():
            names = ", ".join(by_name)
            raise SystemExit(f"no problem {sorted(unknown)[0]!r}; choose from {names}")
        problems = [by_name[name] for name in wanted]
    return problems[one_of[0] - 1 :: one_of[1]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="one line of JSON a run")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--part", type=part, default=(1, 1), help="i/n: every nth problem")
    parser.add_argument("--only", default="", help="names of problems, separated by semicolons")
    parser.add_argument("--shipped", action="store_true", help="classes of the shipped studies")
    parser.add_argument("--summary", action="store_true")
    parser.add_argument("--before", type=Path, help="a file to compare with")
    options = parser.parse_args()
    if options.summary:
        summary(options.file, options.before)
        return
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    problems = shipped() if options.shipped else all_problems()
    for problem in chosen(problems, options.only, options.part):
        with threadpool_limits(limits=1, user_api="blas"):
            runs = [run_of(problem, seed) for seed in seeds]
        quoted_draws.append(options.file, runs)
        print(row(problem.name, runs), flush=True)


if __name__ == "__main__":
    main()
