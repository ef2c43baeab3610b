"""Log evidences against known answers, over many seeds, compared with two nested samplers.

    pip install -e ".[benchmarks]"
    python runs/benchmarks/evidence_accuracy.py [--seeds 20] [--dynesty-seeds 3]
        [--nautilus-seeds 3] [--only NAME,…]

For each problem: the root-mean-square error of the quoted log evidence, its scatter, the claimed
error over the scatter, the largest error of a region's probability, evaluations, seconds of one
processor, and the number of runs with failed checks; then, in the same run, dynesty and nautilus
at their defaults, vectorised where possible (0 seeds skip one of them).
"""

import argparse
from time import process_time

import numpy as np
from catalogue import all_problems
from known_evidence import Problem, from_unit_cube
from threadpoolctl import threadpool_limits

from bayes_ssi.posterior.checks import failed_checks
from bayes_ssi.sampling.engine import sample_target
from bayes_ssi.sampling.target import Target


def ours(problem: Problem, seed: int) -> dict[str, float]:
    begun = process_time()
    target = Target(problem.log_likelihood, problem.n_dimensions)
    sampled = sample_target(target, np.random.SeedSequence(seed))
    seconds = process_time() - begun
    weights, z = sampled.importance.weights, sampled.importance.z
    shares = [abs(weights[test(z)].sum() - known) for test, known in problem.regions.values()]
    return {
        "log_evidence": sampled.evidence.log_evidence,
        "claimed": sampled.evidence.error,
        "share_error": max(shares, default=0.0),
        "evaluations": sampled.n_evaluations,
        "seconds": seconds,
        "flagged": bool(failed_checks(sampled)),
    }


def dynesty_default(problem: Problem, seed: int) -> dict[str, float]:
    import dynesty

    def log_likelihood(z: np.ndarray) -> float:
        return float(problem.log_likelihood(z[None])[0])

    begun = process_time()
    sampler = dynesty.NestedSampler(
        log_likelihood, from_unit_cube, problem.n_dimensions, rstate=np.random.default_rng(seed)
    )
    sampler.run_nested(print_progress=False)
    result = sampler.results
    return {
        "log_evidence": float(result.logz[-1]),
        "claimed": float(result.logzerr[-1]),
        "evaluations": int(np.sum(result.ncall)),
        "seconds": process_time() - begun,
    }


def nautilus_default(problem: Problem, seed: int) -> dict[str, float]:
    import nautilus

    begun = process_time()
    sampler = nautilus.Sampler(
        from_unit_cube, problem.log_likelihood, n_dim=problem.n_dimensions, vectorized=True,
        pass_dict=False, seed=seed,
    )  # fmt: skip
    sampler.run()
    return {
        "log_evidence": float(sampler.log_z),
        "claimed": float(1.0 / np.sqrt(sampler.n_eff)),
        "evaluations": int(sampler.n_like),
        "seconds": process_time() - begun,
    }


def report(name: str, runs: list[dict[str, float]], exact: float) -> None:
    values = {key: np.array([run[key] for run in runs]) for key in runs[0]}
    errors = values["log_evidence"] - exact
    line = (
        f"  {name:9s} rms error {np.sqrt(np.mean(errors**2)):.4f}  largest "
        f"{np.abs(errors).max():.4f}  claimed {values['claimed'].mean():.4f}"
    )
    if len(runs) > 3:
        line += f"  claimed/scatter {values['claimed'].mean() / errors.std(ddof=1):.2f}"
    if "share_error" in values:
        line += f"  region {values['share_error'].max():.3f}  flagged {values['flagged'].sum():.0f}"
    line += f"  evaluations {values['evaluations'].mean():.0f}  {values['seconds'].mean():.2f} s"
    print(line, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--dynesty-seeds", type=int, default=3)
    parser.add_argument("--nautilus-seeds", type=int, default=3)
    parser.add_argument("--only", default="", help="names of problems, separated by commas")
    options = parser.parse_args()
    wanted = [name.strip() for name in options.only.split(",") if name.strip()]
    with threadpool_limits(limits=1, user_api="blas"):
        for problem in all_problems():
            if wanted and problem.name not in wanted:
                continue
            print(f"{problem.name}: log evidence {problem.log_evidence:.4f}", flush=True)
            for name, run, n in (
                ("bayes_ssi", ours, options.seeds),
                ("dynesty", dynesty_default, options.dynesty_seeds),
                ("nautilus", nautilus_default, options.nautilus_seeds),
            ):
                if n and not (name == "nautilus" and problem.n_dimensions < 2):  # it needs two
                    runs = [run(problem, seed) for seed in range(n)]
                    report(name, runs, problem.log_evidence)


if __name__ == "__main__":
    main()
