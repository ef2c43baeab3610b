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
import json
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from quoted_draws import diagnostics, share_of_emcee, watching_emcee

import bayes_ssi as bs

STUDIES = Path(__file__).parents[2] / "model_classes"
# Independent nested sampling and quadrature.
REFERENCES = {"1-a": 0.248, "1-b": -10.057, "2": -9.304, "3": 16.067}
Run = dict[str, Any]


def sampled(candidate: bs.ModelClass, seed: int) -> Run:
    with watching_emcee() as steps_of_emcee:
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
        "emcee": share_of_emcee(posterior.draws, in_values),
        **diagnostics(posterior.draws),
        "failed_checks": posterior.failed_checks,
    }


def sample(file: Path, studies: list[str], seeds: int) -> None:
    (first, *_) = bs.load_study(STUDIES / "shear_building.py").model_classes
    bs.sample(first, 1000)  # imports are not part of the comparison
    for study in studies:
        for candidate in bs.load_study(STUDIES / f"{study}.py").model_classes:
            for seed in range(seeds):
                run = {"study": study, **sampled(candidate, seed)}
                with file.open("a") as lines:
                    lines.write(json.dumps(run) + "\n")
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


def read(file: Path) -> dict[tuple[str, str], list[Run]]:
    runs: dict[tuple[str, str], list[Run]] = {}
    for run in map(json.loads, file.read_text().splitlines()):
        runs.setdefault((run["study"], run["class"]), []).append(run)
    return runs


def compare(before: Path, after: Path) -> None:
    print(HEAD)
    old, new = read(before), read(after)
    ratios, off = [], []
    for key in [key for key in old if key in new]:
        print(row(", ".join(key), old[key]))
        print(row("    after", new[key]))
        ratios.append(
            [np.mean([r[k] for r in new[key]]) / np.mean([r[k] for r in old[key]])
             for k in ("evaluations", "seconds")]
        )  # fmt: skip
        for a, b in zip(old[key], new[key], strict=False):
            off.append((b["log_evidence"] - a["log_evidence"]) / np.hypot(a["error"], b["error"]))
        if key[0] == "shear_building":
            for name, runs in (("before", old[key]), ("after", new[key])):
                errors = [run["log_evidence"] - REFERENCES[key[1]] for run in runs]
                print(
                    f"    {name}: log evidence less its reference {np.mean(errors):+.4f}, "
                    f"scatter {np.std(errors):.4f}, largest {np.abs(errors).max():.4f}"
                )
    for name, each in zip(("evaluations", "seconds"), np.transpose(ratios), strict=True):
        print(
            f"{name}: after over before, median {np.median(each):.2f}, {each.min():.2f} to "
            f"{each.max():.2f}; at most 0.75 in {(each <= 0.75).sum()} of {len(each)} classes"
        )
    largest = np.abs(off).max()
    print(f"log evidences differ by {np.std(off):.2f} standard errors, at most {largest:.1f}")
    for name, runs in (("before", old), ("after", new)):
        every = [run for each in runs.values() for run in each]
        print(
            f"{name}: all quoted chains are emcee's in {sum(r['emcee'] == 1.0 for r in every)} of "
            f"{len(every)} runs; least bulk {min(r['ess_bulk'] for r in every):.0f} and tail ESS "
            f"{min(r['ess_tail'] for r in every):.0f}, largest R-hat "
            f"{max(r['r_hat'] for r in every):.3f}; failed checks in "
            f"{sum(bool(r['failed_checks']) for r in every)}"
        )


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
