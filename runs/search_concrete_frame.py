"""Find an appendage that hides on a finite-element model of 2302 degrees of freedom.

    python runs/search_concrete_frame.py concrete_frame_fe.mat --seeds 0 1 2

The file is that of runs/concrete_frame.py. The stiffness factors of four groups of members are
known to 10 %; the seed draws them, and a pendulum in resonance: one of the four lowest modes of the
frame, one of the measured degrees of freedom that move at least half as far in it as the farthest,
and a mass of 1 to 5 % of the modal mass (the shape's largest measured component being 1). The test
identifies the modes below 21.2 Hz at all 43 measured degrees of freedom, with errors of 0.2 % of
the frequencies and 0.01 of the shapes at unit length. The search knows neither factors nor pairing;
a pendulum may hang on each of the measured degrees of freedom, in its direction.

With ``--directions`` also on two more degrees of freedom of each measured node. With
``--known-place`` nothing is searched: posteriors that know the place are compared with the truth.

For each seed: the rank and the probability of the true place; by how much the best fit of the first
place that was sampled differs from the true modes, which says whether the sensors can tell the two
places from each other; the mass and the frequency at either place with 90 % intervals (where the
structure moves more, a lighter pendulum does the same, so the truth is that of the true place); and
what the search took. Then a table of all seeds.
"""

import argparse
import re
import resource
from time import perf_counter
from typing import NamedTuple

import numpy as np
from concrete_frame import FREQUENCY_COV, GROUPS, SHAPE_SD, simulated_modes, structure
from scipy.stats import norm

import bayes_ssi as bs
from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.sampling.maxima import find_maxima
from bayes_ssi.structures.modal import mac
from bayes_ssi.structures.structure import Requirement
from bayes_ssi.studies.appendages.baselines import frequency_name, hypothesis, mass_name, scale_of
from bayes_ssi.studies.appendages.candidates import PendulumPlace

FACTOR_COV = 0.1
N_MODES = 6  # five in the band, and one above
LOWEST_MODES = 4
MASS_RATIOS = (0.01, 0.05)
LEAST_MOTION = 0.5
# Changes a probability by less than 0.01; a third as much needs up to 64 full solutions to confirm
# each hypothesis.
LOG_EVIDENCE_ERROR = 0.03
NEAR_TRUTH = (0.01 * FREQUENCY_COV, 0.02 * SHAPE_SD)  # errors of the reduced frame, known place


class Hidden(NamedTuple):
    """A pendulum, the number of the mode, from 1, that it is in resonance with, and its share."""

    place: str
    mass: float
    frequency_hz: float
    mode: int
    mass_ratio: float


def hidden_pendulum(frame, truth, rng):
    """One in resonance with a low mode, where that moves."""
    frequencies, shapes = (each[0] for each in frame.modes(truth[None]))
    mode = int(rng.integers(LOWEST_MODES))
    moves = np.abs(shapes[:, mode])  # at unit modal mass
    row = rng.choice(np.flatnonzero(moves >= LEAST_MOTION * moves.max()))
    ratio = rng.uniform(*MASS_RATIOS)
    mass = float(ratio / moves.max() ** 2)
    place = frame.degrees_of_freedom[row]
    return Hidden(place, mass, float(frequencies[mode]), mode + 1, ratio)


def at_sensors(frame, values, data):
    """Frequencies (n,) and shapes at the sensors (n_sensors, n), of as many modes as the data."""
    modes, n = frame.modes(values[None]), len(data.modes)
    shapes = frame.sensor_matrix(data.sensors).apply(modes.shapes)[0]
    return modes.frequencies_hz[0, :n], shapes[:, :n]


def best_fit(ranking, name):
    """The full model and its parameters (n_parameters,) at the draw of greatest likelihood."""
    posterior = next(each for each in ranking.posteriors if each.name == name)
    model_class = next(each for each in ranking.study.model_classes if each.name == name)
    best = posterior.values[posterior.log_likelihoods.argmax()]
    full = model_class.structure.full
    return full, best[: len(full.parameters)]


def cpu_seconds():
    """CPU time of this process, and of its workers that have ended."""
    usages = (resource.getrusage(each) for each in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def all_full_solutions(result):
    """Number of full solutions of a search: of the basis that all share, and of each class."""
    of_bases, confirming = [], 0
    for posterior in result.ranking.posteriors:
        for remark in posterior.remarks:
            if count := re.search(r"reduced to \d+ by (\d+) full solutions", remark):
                of_bases.append(int(count.group(1)))
            elif count := re.search(r"(\d+) full solutions at draws", remark):
                confirming += int(count.group(1))
    shared = min(of_bases)
    return shared + sum(each - shared for each in of_bases) + confirming


def candidates(path, frame, with_directions):
    """The measured degrees of freedom, and for each maybe two more of its node.

    The file does not say which degrees of freedom are those of a node. But elements couple them to
    the same ones: of all that have a mass, the two that have the most of these in common.
    """
    labels = list(frame.degrees_of_freedom)
    if with_directions:
        coupled = (abs(bs.read_matrix(path, "K0")) > 0.0).astype(float)
        mass = bs.read_matrix(path, "M0").diagonal()
        number = np.asarray(coupled.sum(axis=0)).ravel()
        for label in frame.degrees_of_freedom:
            row = int(label.split()[1]) - 1
            common = (coupled @ coupled[:, [row]]).toarray().ravel()
            alike = np.where(mass > 0.0, common / (number + number[row] - common), 0.0)
            labels += [f"dof {i + 1}" for i in np.argsort(-alike)[1:3]]
    return [bs.Candidate(label, label) for label in dict.fromkeys(labels)]


class Compared(NamedTuple):
    """A true value against 5, 50 and 95 % of a posterior."""

    true: float
    low: float
    median: float
    high: float

    @property
    def covered(self):
        return self.low <= self.true <= self.high

    @property
    def deviations(self):
        """How many standard deviations the truth is above the median, on a logarithmic scale."""
        width = np.log(self.high / self.low) / (2.0 * norm.ppf(0.95))
        return np.log(self.true / self.median) / width

    def __str__(self):
        inside = "covered" if self.covered else "not covered"
        return (
            f"{self.median:.4g} ({self.low:.4g} to {self.high:.4g}), true {self.true:.4g}, "
            f"{self.deviations:+.1f} sd: {inside}"
        )


class Outcome(NamedTuple):
    """One search: the true place's rank and probability, and the appendage if it hangs there."""

    seed: int
    rank: int
    probability: float
    alike: float
    mass: Compared
    frequency: Compared
    n_full_solutions: int
    cpu_seconds: float


class Simulated(NamedTuple):
    """A test of the frame, with the values of the frame's parameters (n_parameters,)."""

    frame: bs.MatrixStructure
    values: np.ndarray
    hidden: Hidden
    carrying: bs.MatrixStructure
    data: bs.ModalData


def simulated(path, seed):
    rng = np.random.default_rng(seed)
    frame = structure(path, GROUPS["columns by storey"], FACTOR_COV, N_MODES)
    values = np.array([p.prior.from_normal(rng.standard_normal()) for p in frame.parameters])
    hidden = hidden_pendulum(frame, values, rng)
    carrying = frame.with_element(bs.Pendulum(hidden.place, hidden.mass, hidden.frequency_hz))
    return Simulated(frame, values, hidden, carrying, simulated_modes(carrying, values, rng))


def at_known_place(path, seeds):
    """Masses and frequencies of the posteriors that know the place, by Laplace's approximation.

    Without a search, many tests say whether the truth is where these posteriors say it is.
    """
    error = bs.ErrorModel(FREQUENCY_COV, SHAPE_SD)
    reduced, deviations = None, []
    for seed in seeds:
        frame, values, hidden, _, data = simulated(path, seed)
        # All tests are of one frame. Factors within a few per cent of the true ones matter.
        near = values * np.random.default_rng(seed).lognormal(0.0, 0.02, (8, len(values)))
        reduced = (reduced or frame.reduced()).accurate_at(Requirement(near, *NEAR_TRUTH))
        baseline = bs.ModelClass("frame", reduced, data, error, pairing="any")
        place = PendulumPlace(bs.Candidate(hidden.place, hidden.place))
        known = hypothesis(baseline, (place,))
        ratio = hidden.mass / scale_of(baseline).mass
        true = {mass_name(place): ratio, frequency_name(place): hidden.frequency_hz}
        true |= dict(zip((p.name for p in frame.parameters), values, strict=True))
        z = np.array([p.prior.to_normal(true[p.name]) for p in known.parameters])
        maxima = find_maxima(class_target(known), z[None])
        spread = np.sqrt(np.diag(maxima.covariances[0]))
        columns = [known.parameter_names.index(name) for name in list(true)[:2]]
        deviations.append(((z - maxima.z[0]) / spread)[columns])
    for name, own in zip(("mass", "frequency"), np.transpose(deviations), strict=True):
        inside = int((np.abs(own) < norm.ppf(0.95)).sum())
        print(
            f"{name} at the known place: within 90 % intervals {inside} of {len(own)}; mean "
            f"{own.mean():+.2f}, root mean square {np.sqrt(np.mean(own**2)):.2f} sd"
        )


def searched(path, seed, workers, with_directions):
    """Simulate a test, search it, and print what comes out."""
    frame, truth, hidden, carrying, data = simulated(path, seed)
    error = bs.ErrorModel(FREQUENCY_COV, SHAPE_SD)
    baseline = bs.ModelClass("frame", frame.reduced(), data, error, pairing="any")
    places = candidates(path, frame, with_directions)
    settings = bs.SearchSettings(number_weights=(1.0, 1.0))
    sampling = bs.SamplingSettings(log_evidence_error=LOG_EVIDENCE_ERROR)
    begun, cpu_begun = perf_counter(), cpu_seconds()
    result = bs.search(baseline, settings, seed, sampling, bs.Run(workers), candidates=places)
    seconds, cpu = perf_counter() - begun, cpu_seconds() - cpu_begun

    record, checks = result.record, result.ranking.comparison.failed_checks
    places = record.places_by_probability
    names = [each.place.candidate.name for each in places]
    rank = names.index(hidden.place)
    # Of those alike, not all are sampled.
    best = next(each for each in record.hypotheses if each.is_sampled and each.features)
    (first,) = best.features
    fitted = at_sensors(*best_fit(result.ranking, best.name), data)
    true = at_sensors(carrying, truth, data)
    off, alike = np.abs(fitted[0] / true[0] - 1.0).max(), np.diag(mac(fitted[1], true[1])).min()
    there = places[rank]
    outcome = Outcome(
        seed,
        rank + 1,
        places[rank].probability,
        alike,
        Compared(hidden.mass, *there.amounts["mass"]),
        Compared(hidden.frequency_hz, *there.amounts["frequency_hz"]),
        all_full_solutions(result),
        cpu,
    )
    print(
        f"seed {seed}: {hidden.mass_ratio:.1%} of the modal mass of mode {hidden.mode} at "
        f"{hidden.place}; {len(data.modes)} modes identified\n"
        f"  an appendage {record.probability_of_any:.4f}; true place ranks {rank + 1} with "
        f"{places[rank].probability:.4f}; first is {names[0]} with {places[0].probability:.4f}; "
        f"the best fit of {first.place.candidate.name} is within {off:.2%} of the true "
        f"frequencies, MAC {alike:.5f} or more\n"
        f"  at the true place: mass {outcome.mass}\n"
        f"                     frequency {outcome.frequency}\n"
        f"  at {first.place.candidate.name}: mass {Compared(hidden.mass, *first.amounts['mass'])}\n"
        f"      frequency {Compared(hidden.frequency_hz, *first.amounts['frequency_hz'])}\n"
        f"  {len(record.hypotheses)} hypotheses, {len(result.ranking.posteriors)} sampled, "
        f"{outcome.n_full_solutions} full solutions, "
        f"{len(checks)} failed checks, {seconds:.0f} s, {cpu:.0f} s of CPU time",
        flush=True,
    )
    for check in checks:
        print(f"    (!) {check}")
    return outcome


def print_table(outcomes):
    """All searches, and how often the truth is within the intervals."""
    print("seed  rank  probability   MAC      mass      frequency  full sol.  CPU")
    for each in outcomes:
        deviations = "  ".join(
            f"{compared.deviations:+5.2f} sd{' ' if compared.covered else '*'}"
            for compared in (each.mass, each.frequency)
        )
        print(
            f"{each.seed:4}  {each.rank:4}  {each.probability:11.4f}  {each.alike:.5f}  "
            f"{deviations}  {each.n_full_solutions:9}  {each.cpu_seconds:3.0f} s"
        )
    for name in ("mass", "frequency"):
        compared = [getattr(each, name) for each in outcomes]
        squares = np.mean([each.deviations**2 for each in compared])
        print(
            f"{name}: within 90 % intervals {sum(each.covered for each in compared)} of "
            f"{len(compared)} (* outside); root mean square {np.sqrt(squares):.2f} sd"
        )


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", help="concrete_frame_fe.mat")
    arguments.add_argument("--seeds", type=int, nargs="+", default=[0])
    arguments.add_argument("--workers", type=int, default=2)
    arguments.add_argument("--directions", action="store_true",
                           help="three degrees of freedom of each measured node")  # fmt: skip
    arguments.add_argument("--known-place", action="store_true", help="do not search")
    given = arguments.parse_args()
    if given.known_place:
        at_known_place(given.file, given.seeds)
        return
    print_table([searched(given.file, s, given.workers, given.directions) for s in given.seeds])


if __name__ == "__main__":
    main()
