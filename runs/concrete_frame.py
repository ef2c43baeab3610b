"""Update a finite-element model of 2302 degrees of freedom from its matrices.

    python runs/concrete_frame.py concrete_frame_fe.mat

The file holds a concrete frame: a nominal stiffness matrix K0, a lumped mass matrix M0 (913 degrees
of freedom have no mass), the influence matrices E_1 ... E_12, Influence_Link and Influence_Rebar,
which add up to K0, and the 43 measured degrees of freedom measDOFs, counted from 1. It is not part
of this package.

Modes are simulated at known factors, with errors; two groupings of the twelve factors are ranked.
The truth belongs to the second: the columns of the two storeys differ. Full solutions are counted.
Then a reduced model, as accurate as those that were sampled, is compared with the full one at 200
random draws of each posterior; the full solutions that this takes are not counted.
"""

import argparse
import re
from time import perf_counter

import numpy as np

import bayes_ssi as bs
from bayes_ssi.structures.modal import mac
from bayes_ssi.structures.structure import Requirement

N_MODES = 8
BAND_HZ = (0.0, 21.2)
GROUPS = {
    "columns alike": {"columns": range(1, 7), "beams": range(7, 11), "slabs": (11, 12)},
    "columns by storey": {
        "columns 1": (1, 2, 3),
        "columns 2": (4, 5, 6),
        "beams": range(7, 11),
        "slabs": (11, 12),
    },
}
TRUTH = {"columns 1": 0.8, "columns 2": 1.15, "beams": 1.1, "slabs": 0.95}
FREQUENCY_COV, SHAPE_SD = 0.002, 0.01
FIXED = ("Influence_Link", "Influence_Rebar")
DRAWS = 200


def structure(path, groups, cov=0.3, n_modes=N_MODES):
    """The frame, with one stiffness factor per group of members."""
    factor_of = {
        i: bs.Parameter(name, bs.LogNormal(median=1.0, cov=cov))
        for name, members in groups.items()
        for i in members
    }
    stiffness = [(factor_of[i], bs.read_matrix(path, f"E_{i}")) for i in sorted(factor_of)]
    stiffness += [bs.read_matrix(path, key) for key in FIXED]
    mass = bs.read_matrix(path, "M0")
    labels = [f"dof {i}" for i in range(1, mass.shape[0] + 1)]
    sensors = [f"dof {int(i)}" for i in bs.read_matrix(path, "measDOFs").ravel()]
    return bs.MatrixStructure(stiffness, mass, labels=labels, sensors=sensors, n_modes=n_modes)


def simulated_modes(frame, truth, rng):
    """The modes that a test of the frame, with what it carries, would identify in the band.

    ``truth`` are the values (n_parameters,) of the frame's parameters.
    """
    sensors = tuple(label for label in frame.degrees_of_freedom if label not in frame.appendages)
    modes_of_frame = frame.modes(truth[None])
    frequencies = modes_of_frame.frequencies_hz[0]
    shapes = frame.sensor_matrix(sensors).apply(modes_of_frame.shapes)[0]
    modes = []
    for i, frequency in enumerate(frequencies):
        identified = frequency * (1.0 + FREQUENCY_COV * rng.standard_normal())
        if identified > BAND_HZ[1]:
            continue
        unit = shapes[:, i] / np.linalg.norm(shapes[:, i])
        shape = unit + SHAPE_SD * rng.standard_normal(len(unit))
        modes.append(bs.IdentifiedMode(str(i + 1), float(identified), shape))
    return bs.ModalData(tuple(modes), BAND_HZ, sensors)


def compared(frame, names, posterior, rng):
    """Largest error of frequency, and least MAC, of a reduced model at random draws."""
    some = posterior.values[rng.choice(len(posterior.values), DRAWS, replace=False)]
    own = some[:, [posterior.parameter_names.index(name) for name in names]]
    # A tenth of the errors, which sampling requires where the posterior lies.
    reduced = frame.reduced().accurate_at(Requirement(own, 0.1 * FREQUENCY_COV, 0.1 * SHAPE_SD))
    full, fast = frame.modes(own), reduced.modes(own)
    off = np.abs(fast.frequencies_hz / full.frequencies_hz - 1.0).max()
    alike = [np.diag(mac(a, b)).min() for a, b in zip(full.shapes, fast.shapes, strict=True)]
    return off, min(alike)


def full_solutions(posterior):
    """Numbers of full solutions for a model class: for its basis, and to confirm its evidence."""
    counts = [re.search(r"by (\d+) full solutions", remark) for remark in posterior.remarks]
    return sum(int(count.group(1)) for count in counts if count)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", help="concrete_frame_fe.mat")
    arguments.add_argument("--workers", type=int, default=2)
    given = arguments.parse_args()

    rng = np.random.default_rng(1)
    frames = {name: structure(given.file, groups) for name, groups in GROUPS.items()}
    true_frame = frames["columns by storey"]
    truth = np.array([TRUTH[parameter.name] for parameter in true_frame.parameters])
    modes = simulated_modes(true_frame, truth, rng)
    error = bs.ErrorModel(frequency_cov=FREQUENCY_COV, shape_sd=SHAPE_SD)
    pairing = {label: int(label) for label in modes.labels}
    classes = [
        bs.ModelClass(name, frame.reduced(), modes, error, pairing=pairing)
        for name, frame in frames.items()
    ]
    started = perf_counter()
    ranking = bs.rank(bs.Study("Concrete frame", classes), run=bs.Run(given.workers))
    spent = sum(full_solutions(posterior) for posterior in ranking.posteriors)
    print(f"ranked in {perf_counter() - started:.0f} s with {given.workers} workers and "
          f"{spent} full solutions")  # fmt: skip
    for row in ranking.comparison.classes:
        print(f"{row.name}: log evidence {row.log_evidence:.3f} ± {row.error:.3f}, "
              f"probability {row.probability_text}")  # fmt: skip
    for posterior in ranking.posteriors:
        print(f"\n{posterior.name}, {posterior.n_evaluations} evaluations")
        for remark in (*posterior.remarks, *(f"(!) {each}" for each in posterior.failed_checks)):
            print(f"  {remark}")
        for row in posterior.summary:
            true = f", true {TRUTH[row.name]}" if row.name in TRUTH else ""
            print(f"  {row.name}: {row.mean:.3f} ± {row.sd:.3f}{true}")
        frame = frames[posterior.name]
        names = [parameter.name for parameter in frame.parameters]
        off, alike = compared(frame, names, posterior, rng)
        print(f"  reduced against full at {DRAWS} draws: frequencies within {off:.1e}, "
              f"MAC {alike:.8f} or more")  # fmt: skip


if __name__ == "__main__":
    main()
