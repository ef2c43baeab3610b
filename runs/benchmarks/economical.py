"""The economical path on a black box: evaluations that it takes, and its errors, over many seeds.

    python runs/benchmarks/economical.py

The black box is a building of six storeys with a stiffness factor each, which counts its
evaluations; the data are four of its modes at three floors. The reference is the default path's
evidence, sampled to a tenth of the error.
"""

import argparse

import numpy as np

import bayes_ssi as bs
from bayes_ssi.structures.structure import Structure

STOREYS = 6
TRUTH = (1.1, 0.9, 1.2, 0.8, 1.0, 1.15)
SETTINGS = bs.SamplingSettings(log_evidence_error=0.05, economical=True)
CAREFUL = bs.SamplingSettings(log_evidence_error=0.003)


class BlackBox(Structure):
    """A structure that counts its evaluations."""

    def __init__(self, hidden):
        self.hidden, self.n_asked = hidden, 0

    @property
    def parameters(self):
        return self.hidden.parameters

    @property
    def degrees_of_freedom(self):
        return self.hidden.degrees_of_freedom

    @property
    def n_modes(self):
        return self.hidden.n_modes

    def modes(self, values):
        self.n_asked += len(values)
        return self.hidden.modes(values)


def model_class():
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(1, STOREYS + 1)]
    building = bs.ShearBuilding((1.0,) * STOREYS, [4000.0 * k for k in factors])
    frequencies, shapes = (each[0] for each in building.modes(np.array([TRUTH])))
    modes = tuple(
        bs.IdentifiedMode(str(j + 1), float(frequencies[j]), shapes[[0, 2, 5], j]) for j in range(4)
    )
    band = (0.0, float(frequencies[3:5].mean()))
    data = bs.ModalData(modes, band, ("floor 1", "floor 3", "floor 6"))
    pairing = {str(j): j for j in range(1, 5)}
    error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)
    return bs.ModelClass("six storeys", BlackBox(building), data, error, pairing=pairing)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seeds", type=int, default=40)
    n_seeds = arguments.parse_args().seeds

    candidate = model_class()
    reference = bs.sample(candidate, settings=CAREFUL)
    posteriors, asked = [], []
    for seed in range(n_seeds):
        candidate.structure.n_asked = 0
        posteriors.append(bs.sample(candidate, seed=seed, settings=SETTINGS))
        asked.append(candidate.structure.n_asked)
    off = (
        np.array([one.evidence.log_evidence for one in posteriors])
        - reference.evidence.log_evidence
    )
    means, other = (
        np.array([[row.mean for row in one.summary] for one in several])
        for several in (posteriors, [reference])
    )
    sd = np.array([row.sd for row in reference.summary])
    print(f"reference: {reference.evidence.log_evidence:.3f} ± {reference.evidence.error:.3f}, "
          f"{reference.n_evaluations} evaluations")  # fmt: skip
    print(f"{n_seeds} seeds: {min(asked)} to {max(asked)} evaluations in all; log evidence off by "
          f"{off.mean():+.3f} on average, {np.sqrt((off**2).mean()):.3f} rms, "
          f"{np.abs(off).max():.3f} at most, {np.mean(np.abs(off) <= 0.05):.0%} of them within "
          f"0.05; error bar {np.mean([one.evidence.error for one in posteriors]):.3f}; means "
          f"off by {np.sqrt(np.mean(((means - other) / sd) ** 2)):.3f} standard deviations rms; "
          f"{sum(bool(one.failed_checks) for one in posteriors)} failed a check")  # fmt: skip


if __name__ == "__main__":
    main()
