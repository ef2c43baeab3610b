"""Recompute each log evidence of a saved ranking from its importance draws; needs numpy alone.

    python runs/recompute_evidence.py RESULT ...

Of every class, ``posteriors/CLASS.npz`` holds draws ``z`` (n, d) from a mixture of densities, in
coordinates in which the prior is N(0, I), with their ``log_likelihoods`` (n,), the mixture's
``log_proposals`` (n,) and the component that gave each, ``strata`` (n,). The evidence is the mean
of likelihood x prior / proposal. Where ``changes`` (m,) are there, a model was reduced or emulated,
and the mean of exp(changes) over posterior draws, log-likelihoods of exact solutions minus those
sampled, corrects it. That the mean of prior / proposal is 1 shows that densities are normalised.
"""

import json
import sys
from pathlib import Path

import numpy as np


def log_mean(log_terms, strata):
    """The log of the mean of positive terms, and its standard error by strata."""
    highest = log_terms.max()
    terms = np.exp(log_terms - highest)
    sizes = np.bincount(strata)[strata]
    labels = np.where(sizes < 20, -1, strata)  # too few to know their variance: as one
    parts = [terms[labels == label] for label in np.unique(labels)]
    variance = sum(len(part) * part.var(ddof=1) for part in parts if len(part) > 1)
    return highest + np.log(terms.mean()), np.sqrt(variance) / terms.sum()


def recomputed(saved):
    """Log evidence with its error, and log of the mean of prior / proposal with its own."""
    z, strata = saved["z"], saved["strata"]
    log_prior = -0.5 * (z**2).sum(axis=1) - 0.5 * z.shape[1] * np.log(2.0 * np.pi)
    log_ratio = log_prior - saved["log_proposals"]
    value, error = log_mean(saved["log_likelihoods"] + log_ratio, strata)
    if "changes" in saved:
        correction, its_error = log_mean(saved["changes"], np.zeros(len(saved["changes"]), int))
        value, error = value + correction, np.hypot(error, its_error)
    return (value, error), log_mean(log_ratio, strata)


def main(results):
    print(f"{'class':38} {'stored':17} {'recomputed':14} {'log prior mass':15}  apart by")
    for result in map(Path, results):
        record = json.loads((result / "result.json").read_text(encoding="utf-8"))
        for posterior in record["posteriors"]:
            name, evidence = posterior["name"], posterior["evidence"]
            file = (result / record["draws"][name]).with_suffix(".npz")
            if not file.is_file():
                sys.exit(f"{file}: no such file; rank the study again")
            (value, error), (mass, mass_error) = recomputed(np.load(file))
            stored, its_error = evidence["log_evidence"], evidence["error"]
            apart = abs(value - stored) / np.hypot(error, its_error)
            pairs = (stored, its_error), (value, error), (mass, mass_error)
            print(f"{name:32.32}", *(f"{a:9.3f} ± {b:.3f}" for a, b in pairs), f"{apart:6.2f} se")


if __name__ == "__main__":
    main(sys.argv[1:])
