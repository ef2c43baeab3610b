"""What changed between two simulated tests of a finite-element model of 2302 degrees of freedom?

    python runs/changes_concrete_frame.py concrete_frame_fe.mat --seeds 0 1 2 3 4

The frame of runs/concrete_frame.py with its groups of members. In every pair one of the groups,
drawn by the seed, lost 10 to 40 % of its stiffness between the tests; modes are simulated with
errors of 0.2 % of frequencies and 0.01 of unit shapes. Everything runs in one process, which counts
full solutions.
"""

import argparse
from time import perf_counter, process_time

import numpy as np
from concrete_frame import GROUPS, simulated_modes, structure

import bayes_ssi as bs
from bayes_ssi.structures.finite_elements.assembled_structure import AssembledStructure

N_MODES = 8
# Of log evidences, in nats: full solutions correct them, the more the smaller it is.
SAMPLING = bs.SamplingSettings(log_evidence_error=0.2)


def tests(path, seed):
    """A class with two tests, the group that lost stiffness, and its loss."""
    rng = np.random.default_rng([seed, 34])
    frame = structure(path, GROUPS["columns by storey"], 0.1, N_MODES)
    names = [parameter.name for parameter in frame.parameters]
    values = np.array([p.prior.from_normal(rng.standard_normal()) for p in frame.parameters])
    group, loss = int(rng.integers(len(names))), float(rng.uniform(0.1, 0.4))
    after = values.copy()
    after[group] *= 1.0 - loss
    data = {
        name: simulated_modes(frame, own, rng)
        for name, own in (("before", values), ("after", after))
    }
    reduced = frame.reduced()
    model_class = bs.ModelClass(
        "frame",
        error=bs.ErrorModel(),
        configurations=[
            bs.Configuration(
                name, reduced, own, pairing={label: int(label) for label in own.labels}
            )
            for name, own in data.items()
        ],
    )
    return model_class, names[group], loss


class Counted:
    """A method of full solutions that counts how many rows it solves."""

    def __init__(self, method):
        self.method, self.n = method, 0

    def __get__(self, owner, kind):
        def solve(*arguments, **options):
            self.n += 1
            return self.method(owner, *arguments, **options)

        return solve


def compared(path, seed, visible):
    model_class, group, loss = tests(path, seed)
    solve = Counted(AssembledStructure.__dict__["shifted_modes"])
    AssembledStructure.shifted_modes = solve
    begun, cpu = perf_counter(), process_time()
    search = bs.changes(
        model_class, ["before"], ["after"], seed=seed, settings=SAMPLING, visible=visible
    )
    AssembledStructure.shifted_modes = solve.method
    seconds = perf_counter() - begun
    record = search.record
    first = record.places_by_probability[0]
    ((low, middle, high),) = record.place(group).amounts.values()
    covered = "covered" if low <= loss <= high else "not covered"
    print(
        f"seed {seed}: {group} lost {loss:.1%}; a change {record.probability_of_any:.4f}, "
        f"first {first.place.name} with {first.probability:.4f}; at the true place "
        f"{middle:.1%} ({low:.1%} to {high:.1%}), {covered}\n"
        f"  {len(record.hypotheses)} hypotheses, {len(search.ranking.posteriors)} sampled, "
        f"{solve.n} full solutions, {seconds:.0f} s, {process_time() - cpu:.0f} s of CPU time",
        flush=True,
    )
    for each in record.places:
        if each.smallest_visible is not None:
            print(f"  smallest visible in {each.place.name}: {each.smallest_visible:.1%}")
    for check in search.ranking.comparison.failed_checks:
        print(f"  (!) {check}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", help="concrete_frame_fe.mat")
    arguments.add_argument("--seeds", type=int, nargs="+", default=[0])
    arguments.add_argument("--visible", action="store_true")
    given = arguments.parse_args()
    for seed in given.seeds:
        compared(given.file, seed, given.visible)


if __name__ == "__main__":
    main()
