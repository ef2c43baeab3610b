"""Pendulums on a finite-element model of 2302 degrees of freedom, in the basis of the model alone.

    python runs/carried_pendulums.py concrete_frame_fe.mat

The file is that of runs/concrete_frame.py. A pendulum of about 1 % of the mass that moves in one
direction, with a frequency between half the first and the sixth one, hangs on each of the 43
sensors in turn, carried by the reduced basis of the frame without it. At random draws of the prior,
frequencies are compared with full solutions, and with the certified bounds.
"""

import argparse
from time import process_time

import numpy as np
from concrete_frame import GROUPS, structure

import bayes_ssi as bs

DRAWS = 4
EVERY = 6  # of the places is compared with full solutions


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", help="concrete_frame_fe.mat")
    frame = structure(arguments.parse_args().file, GROUPS["columns by storey"])
    reduced, rng = frame.reduced(), np.random.default_rng(0)
    basis = reduced.basis
    print(
        f"basis of the frame: {basis.size} vectors from {reduced.n_full_solutions} full solutions"
    )

    of_one_direction = frame.system.mass.matrices[0].sum() / 3.0
    mass = bs.Parameter("mass", bs.LogNormal(0.01 * of_one_direction, 0.5))
    hz = frame.modes(frame.prior_medians()).frequencies_hz[0]
    frequency = bs.Parameter("frequency", bs.LogUniform(0.5 * hz[0], hz[5]), unit="Hz")
    seconds, off, bounds, covered = [], [], [], True
    for i, place in enumerate(frame.degrees_of_freedom):
        begun = process_time()
        carrying = reduced.with_element(bs.Pendulum(place, mass, frequency, label="pendulum"))
        seconds.append(process_time() - begun)
        if i % EVERY:
            continue
        z = rng.standard_normal((DRAWS, len(carrying.parameters)))
        columns = zip(carrying.parameters, z.T, strict=True)
        values = np.column_stack([p.prior.from_normal(column) for p, column in columns])
        fast, full = (each.modes(values).frequencies_hz for each in (carrying, carrying.full))
        errors, bound = np.abs(fast / full - 1.0), carrying.bounds(values).frequency
        covered &= bool((bound >= errors - 1e-11).all())
        off.append(errors.max())
        bounds.append(bound.max())
    print(f"{len(seconds)} pendulums: {1e3 * np.mean(seconds):.1f} ms of CPU time each, "
          f"{carrying.basis.size} coordinates")  # fmt: skip
    print(f"at {DRAWS * len(off)} draws, frequencies within {max(off):.1e} of the full model's, "
          f"certified within {max(bounds):.1e}; every bound holds: {covered}")  # fmt: skip


if __name__ == "__main__":
    main()
