"""Every class of the shipped studies: how it is sampled, and how good its quoted draws are.

    python runs/benchmarks/shipped_studies.py sample FILE [--seeds 1] [--only STUDY,…]
    python runs/benchmarks/shipped_studies.py compare BEFORE AFTER

The first appends a line of JSON for each class and seed to FILE: evaluations, processor time, the
log evidence and its error, the acceptance that is quoted, arviz's effective sample sizes and R-hat
of the quoted draws, and the share of the quoted chains that are emcee's, compared step by step with
what its walkers did. The second prints two such files side by side, means over seeds, and for the
shear building, whose log evidences are known to 0.002, their errors.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import process_time

import beside_tests  # noqa: F401
import numpy as np
import quoted_draws
from quoted_draws import Run

import bayes_ssi as bs

STUDIES = Path(__file__).parents[2] / "model_classes"
# Independent nested sampling and quadrature.
REFERENCES = {"1-a": 0.248, "1-b": -10.057, "2": -9.304, "3": 16.067}


def sampled(candidate: bs.ModelClass, seed: int) -> Run:
    with quoted_draws.watching_emcee() as steps_of_emcee:
        begun = process_time()
        posterior = bs.sample(candidate, seed)
        seconds = process_time() - begun
        steps = steps_of_emcee()
    n = len(candidate.parameters)
    in_values = [candidate.values(s.reshape(-1, n)).reshape(s.shape) for s in steps]
    return {
        "class": candidate.name,
        "seed": seed,
        "parameters": n,
        "evaluations": posterior.n_evaluations,
        "seconds": seconds,
        "log_evidence": posterior.evidence.log_evidence,
        "error": posterior.evidence.error,
        "acceptance": getattr(posterior, "acceptance_fraction", None) or posterior.acceptance,
        "regions": len(posterior.regions),
        "emcee": quoted_draws.share_of_emcee(posterior.draws, in_values),
        **quoted_draws.diagnostics(posterior.draws),
        "failed_checks": posterior.failed_checks,
    }


def sample(file: Path, studies: list[str], seeds: int) -> None:
    (first, *_) = bs.load_study(STUDIES / "shear_building.py").model_classes
    bs.sample(first, 1000)  # imports are not part of the comparison
    for study in studies:
        for candidate in bs.load_study(STUDIES / f"{study}.py").model_classes:
            for seed in range(seeds):
                run = {"study": study, **sampled(candidate, seed)}
                quoted_draws.append(file, [run])
                print(row(f"{study}, {candidate.name}", [run]), flush=True)


HEAD = (
    f"{'class':42s} {'evaluations':>11s} {'s':>7s} {'log evidence':>18s} {'accept':>6s} "
    f"{'bulk':>6s} {'tail':>6s} {'R-hat':>6s} emcee failed"
)


def row(name: str, runs: list[Run]) -> str:
    mean = {
        key: float(np.mean([run[key] for run in runs]))
        for key in ("evaluations", "seconds", "log_evidence", "acceptance", "emcee")
    }
    error = float(np.sqrt(np.mean([run["error"] ** 2 for run in runs])))
    bulk, tail = (min(run[key] for run in runs) for key in ("ess_bulk", "ess_tail"))
    r_hat = max(run["r_hat"] for run in runs)
    failed = sum(bool(run["failed_checks"]) for run in runs)
    return (
        f"{name:42s} {mean['evaluations']:11.0f} {mean['seconds']:7.2f} "
        f"{mean['log_evidence']:9.3f} ± {error:.4f} {mean['acceptance']:6.2f} {bulk:6.0f} "
        f"{tail:6.0f} {r_hat:6.3f} {mean['emcee']:5.2f} {failed}"
    )


def compare(before: Path, after: Path) -> None:
    print(HEAD)
    old, new = (quoted_draws.read(file, "study", "class") for file in (before, after))
    off = []
    for name in [name for name in old if name in new]:
        print(row(name, old[name]))
        print(row("    after", new[name]))
        for a, b in zip(old[name], new[name], strict=False):
            off.append((b["log_evidence"] - a["log_evidence"]) / np.hypot(a["error"], b["error"]))
        study, _, own = name.partition(", ")
        for runs in (old[name], new[name]) if study == "shear_building" else ():
            errors = [run["log_evidence"] - REFERENCES[own] for run in runs]
            print(
                f"    log evidence less its reference {np.mean(errors):+.4f}, scatter "
                f"{np.std(errors):.4f}, largest {np.abs(errors).max():.4f}"
            )
    quoted_draws.print_ratios(old, new)
    largest = np.abs(off).max()
    print(f"log evidences differ by {np.std(off):.2f} standard errors, at most {largest:.1f}")
    for name, each in (("before", old), ("after", new)):
        print(f"{name}: {quoted_draws.quality([run for runs in each.values() for run in runs])}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    sampling = commands.add_parser("sample")
    sampling.add_argument("file", type=Path)
    sampling.add_argument("--seeds", type=int, default=1)
    sampling.add_argument("--only", help="names of studies, separated by commas")
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    options = parser.parse_args()
    if options.command == "compare":
        compare(options.before, options.after)
    else:
        every = sorted(each.stem for each in STUDIES.glob("*.py"))
        studies = options.only.split(",") if options.only else every
        sample(options.file, studies, options.seeds)


if __name__ == "__main__":
    main()
