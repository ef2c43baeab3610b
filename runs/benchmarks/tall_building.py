"""How long does a search take on a 20-storey building with 8 identified modes?

    python runs/benchmarks/tall_building.py [--workers 2] [--most 1]

Four stiffness factors for five storeys each, sensors on six floors, exact modes of the building
with a pendulum of 8 % of a floor's mass on floor 15: 48 hypotheses with at most one appendage.
"""

from __future__ import annotations

import argparse
from time import perf_counter

import numpy as np

import bayes_ssi as bs
from bayes_ssi.studies.appendages.candidates import SearchSettings
from bayes_ssi.studies.questions import search
from bayes_ssi.studies.ranking.class_sampling import chosen_workers

N_STOREYS, N_MODES = 20, 8
FLOORS = (1, 4, 8, 12, 16, 20)
STIFFNESS = 4000.0
PENDULUM = bs.Pendulum(on=15, mass=0.08, frequency=2.3)


def baseline() -> bs.ModelClass:
    """The bare building, with the modes of the one that has a pendulum."""
    masses = (1.0,) * N_STOREYS
    truth = bs.ShearBuilding(masses, (STIFFNESS,) * N_STOREYS).with_element(PENDULUM)
    frequencies, shapes = truth.modes(np.zeros((1, 0)))
    modes = tuple(
        bs.IdentifiedMode(
            str(j + 1), float(frequencies[0, j]), shapes[0, [floor - 1 for floor in FLOORS], j]
        )
        for j in range(N_MODES)
    )
    # The band ends halfway to the first mode that was not identified.
    band = (0.0, float(frequencies[0, N_MODES - 1 : N_MODES + 1].mean()))
    data = bs.ModalData(modes, band, tuple(f"floor {floor}" for floor in FLOORS))
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(1, 5)]
    bare = bs.ShearBuilding(masses, [STIFFNESS * factors[i // 5] for i in range(N_STOREYS)])
    return bs.ModelClass("bare", bare, data, bs.ErrorModel(0.01, 0.05), pairing="any")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--most", type=int, default=1, help="largest number of appendages")
    options = parser.parse_args()
    weights = (1.0, 1.0, *(0.2**number for number in range(1, options.most)))
    begun = perf_counter()
    bare = baseline()
    # Copies of this process, as commands have them.
    workers = chosen_workers([bare], options.workers)
    result = search(bare, SearchSettings(number_weights=weights), run=bs.Run(workers))
    seconds = perf_counter() - begun
    rows = result.record.hypotheses
    for row in rows[:6]:
        print(f"{row.name:16s} {row.log_evidence:8.2f} ± {row.error:.2f}  {row.probability:.4f}")
    checks = result.ranking.comparison.failed_checks
    sampled = [row for row in rows if row.is_sampled]
    print(
        f"{len(rows)} hypotheses, {len(sampled)} sampled, {len(checks)} failed checks, "
        f"{seconds:.0f} s"
    )
    for check in checks:
        print(f"    {check}")
    for name in ("laplace", "screened"):
        errors = [getattr(row, name) - row.log_evidence for row in sampled]
        print(f"{name} less sampled log evidence: {min(errors):.2f} to {max(errors):.2f} nats")
    own = sum(posterior.seconds for posterior in result.ranking.posteriors)
    n = sum(posterior.n_evaluations for posterior in result.ranking.posteriors)
    print(f"sampling alone {own:.0f} s, summed over workers, and {n} evaluations")


if __name__ == "__main__":
    main()
