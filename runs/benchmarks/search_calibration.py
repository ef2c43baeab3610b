"""Is the search for appendages calibrated, and how often does it raise a false alarm?

    python runs/benchmarks/search_calibration.py [--sets 100] [--processes 2]
    python runs/benchmarks/search_calibration.py --on tower --sampled none [--off 0.03]

Simulates ``--sets`` data sets of a structure with one appendage at a place, or a further motion
like one of its modes, drawn as the search's own priors have them, but for the appendage's mass,
which is 0.2 to 20 % of the mean floor mass, evenly in its logarithm, and as many without:
stiffnesses from their priors, modes from the likelihood itself (errors of frequencies and shapes,
missed and spurious modes). Each is searched over all hypotheses of at most one appendage. If
everything is right, hypotheses with a stated probability p are true in a share p of the cases, and
the true mass and frequency of an appendage lie within intervals of the true hypothesis's posterior
as often as these say.

The structure is a three-storey building with ten hypotheses; or ``--on tower``, the tower of
search_scaling.py with 1536 degrees of freedom, three inferred stiffness factors, a pendulum in x or
y at one of three heights, and errors of the model as well as stated ones of the identification.
Data are computed with the full model, and searched with a reduced basis. ``--off`` makes the true
stiffness of the tower's second quarter, which is not inferred, this much higher than the search
assumes.

With ``--sampled all``, every hypothesis is sampled, and the errors of all approximate evidences are
printed; else of those that the search chooses to sample, on the tower until at most half of the
probability may rest on approximate evidences. With ``--sampled none``, all evidences are
approximate. ``--lines`` appends each set's result to a file as it comes, and leaves out the sets
that the file has already.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import beside_tests  # noqa: F401
import numpy as np
from scipy.special import softmax
from scipy.stats import beta, kstest
from search_scaling import tower
from simulated import IdentificationErrors, print_bands, simulate

import bayes_ssi as bs
from bayes_ssi.parameters.priors import Prior
from bayes_ssi.studies.appendages.baselines import (
    choose_baselines,
    frequency_name,
    hypothesis,
    mass_name,
    scale_of,
)
from bayes_ssi.studies.appendages.candidates import AppendagePlace, FurtherMotion
from bayes_ssi.studies.ranking.study import load_study
from bayes_ssi.studies.search.family_search import screened_hypotheses

STUDY = Path(__file__).parents[2] / "model_classes" / "bare_building.py"
# True masses over the mean floor mass, or the median modal mass; the search's prior is wider.
LIGHTEST, HEAVIEST = 0.002, 0.2
# Of the tower: the band has its first three modes, and the fourth is above.
LEVELS, FACTOR_COV, N_MODES, BAND_HZ = 16, 0.1, 4, (0.0, 6.6)
HEIGHTS, AXES = (20.0, 40.0, 60.0), "xy"
MODEL_ERROR = bs.ErrorModel(frequency_cov=0.005, shape_sd=0.03)
IDENTIFICATION_ERRORS = IdentificationErrors(frequency_cov=0.005, shape_sd=0.03)
ALARM = 0.9
NEAR = 0.1


class Question(NamedTuple):
    """What is searched, and what the data come from.

    Attributes:
        baseline: the class that appendages are hung on, with data of the right kind.
        true_baseline: the same as it really is.
        candidates: where appendages may hang.
        frequency: prior of an appendage's frequency, stated since the default follows from data.
        stated: errors that the test states.
        most_unsampled: as in the search's settings.
        sampling: how precisely to sample.
    """

    baseline: bs.ModelClass
    true_baseline: bs.ModelClass
    candidates: tuple[bs.Candidate, ...]
    frequency: bs.LogUniform
    stated: IdentificationErrors | None
    most_unsampled: float = bs.SearchSettings().most_unsampled
    sampling: bs.SamplingSettings = bs.SamplingSettings(log_evidence_error=0.03)


def building() -> Question:
    (baseline,) = load_study(STUDY).model_classes
    candidates = baseline.structure.candidates(baseline.data.sensors)
    return Question(baseline, baseline, candidates, bs.LogUniform(0.5, 6.0), None)


@cache
def tower_class(second_quarter: float) -> tuple[bs.ModelClass, np.ndarray]:
    """The class without appendages, and the coordinates of the tower's nodes."""
    e1, e3, e4 = (bs.Parameter(f"E{i}", bs.LogNormal(1.0, FACTOR_COV)) for i in (1, 3, 4))
    full, nodes = tower(LEVELS, (e1, second_quarter, e3, e4), N_MODES)
    frequencies, shapes = (each[0] for each in full.modes(full.prior_medians()))
    of_any = bs.IdentifiedMode("1", float(frequencies[0]), shapes[:, 0])
    data = bs.ModalData((of_any,), BAND_HZ, full.degrees_of_freedom)
    return bs.ModelClass("tower", full.reduced(), data, MODEL_ERROR, pairing="any"), nodes


def tower_question(off: float) -> Question:
    (baseline, nodes), (true_baseline, _) = tower_class(1.0), tower_class(1.0 + off)
    corner = [np.linalg.norm(nodes - (0.0, 0.0, height), axis=1).argmin() for height in HEIGHTS]
    candidates = tuple(
        bs.Candidate(f"{height:g} m {axis}", f"{node} {axis}")
        for height, node in zip(HEIGHTS, corner, strict=True)
        for axis in AXES
    )
    frequency = bs.LogUniform(0.5, BAND_HZ[1])
    return Question(
        baseline,
        true_baseline,
        candidates,
        frequency,
        IDENTIFICATION_ERRORS,
        most_unsampled=0.5,
        sampling=bs.SamplingSettings(log_evidence_error=0.1, searches=2),
    )


class Searched(NamedTuple):
    """One data set: the true place, each hypothesis's probability, and the distance to resonance.

    ``detuning`` is the relative distance of the appendage's frequency from the nearest mode of the
    building without it; NaN without appendage. ``errors`` are those of Laplace's approximation and
    of screening, in nats, for every hypothesis that was sampled. ``ranks`` are the posterior
    probabilities, under the true hypothesis, of a lower mass and of a lower frequency than the true
    ones; none without appendage at a place, or where the search chose not to sample it.
    """

    truth: str
    probabilities: dict[str, float]
    detuning: float
    failed_checks: tuple[str, ...] = ()
    errors: tuple[tuple[float, float], ...] = ()
    ranks: tuple[float, ...] = ()


class Task(NamedTuple):
    on: str
    off: float
    index: int
    with_appendage: bool
    sampled: str

    def __str__(self) -> str:
        return " ".join(map(str, self))


class Drawn(NamedTuple):
    """A simulated data set.

    Attributes:
        truth: name of the true hypothesis, and ``places`` where its appendage is, if it has one
            at a place.
        appendage: its mass ratio, as the search defines it, and its frequency.
        detuning: as in :class:`Searched`.
        baseline: what is searched.
        settings: of the search.
    """

    truth: str
    places: tuple[AppendagePlace, ...]
    appendage: np.ndarray
    detuning: float
    baseline: bs.ModelClass
    settings: bs.SearchSettings

    def ranks(
        self, parameter_names: Sequence[str], values: np.ndarray, weights: np.ndarray
    ) -> tuple[float, ...]:
        """Those of the appendage, if there is one, among draws of the true hypothesis."""
        if not self.places:
            return ()
        columns = columns_of(parameter_names, self.places[0])
        return tuple((weights @ (values[:, columns] < self.appendage)).tolist())


def columns_of(parameter_names: Sequence[str], place: AppendagePlace) -> list[int]:
    """The columns of an appendage's mass ratio and frequency."""
    names = list(parameter_names)
    return [names.index(mass_name(place)), names.index(frequency_name(place))]


def drawn(task: Task, question: Question) -> Drawn:
    """Draw a truth from the search's own priors, and data from the likelihood."""
    rng = np.random.default_rng([11, task.index, task.with_appendage])
    settings = search_settings(question, bs.LogUniform(LIGHTEST, HEAVIEST), task.sampled)
    name, scale = question.true_baseline.name, scale_of(question.true_baseline)
    study = bs.Study(name, [question.true_baseline])
    family = choose_baselines(study, None, question.candidates, options=settings)
    features: list[AppendagePlace | FurtherMotion] = []
    if task.with_appendage:
        possible = family.features[name]
        weights = [family.prior_weight(name, 1, isinstance(f, FurtherMotion)) for f in possible]
        features = [possible[rng.choice(len(possible), p=np.divide(weights, sum(weights)))]]
    truth = hypothesis(question.true_baseline, features, settings, scale=scale)
    exact = truth.with_structures(lambda structure, _: structure.exact)
    values, data, _ = simulate(exact, rng, question.stated)
    baseline = replace(question.baseline, data=data)
    # The mass to which ratios refer follows from the data, and the true mass must not.
    share = scale.mass / scale_of(baseline).mass
    appendage, detuning = np.empty(0), float("nan")
    places = tuple(each for each in features if not isinstance(each, FurtherMotion))
    if features:
        structure = question.true_baseline.structure
        bare = structure.modes(values[None, : len(structure.parameters)])
        hz = values[truth.parameter_names.index(frequency_name(features[0]))]
        detuning = float(np.abs(hz / bare.frequencies_hz[0] - 1.0).min())
    if places:
        appendage = values[columns_of(truth.parameter_names, places[0])] * (share, 1.0)
    settings = search_settings(question, bs.SearchSettings().mass_ratio, task.sampled)
    return Drawn(truth.name, places, appendage, detuning, baseline, settings)


def one(task: Task) -> Searched:
    """Draw one data set and search it."""
    question = building() if task.on == "building" else tower_question(task.off)
    made = drawn(task, question)
    if task.sampled == "none":
        return screened(made, question, task.index)
    result = bs.search(
        made.baseline, made.settings, task.index, question.sampling, candidates=question.candidates
    )
    rows = result.record.hypotheses
    errors = tuple(
        (row.laplace - row.log_evidence, row.screened - row.log_evidence)
        for row in rows
        if row.is_sampled
    )
    ranks: tuple[float, ...] = ()
    for posterior in result.ranking.posteriors:
        if posterior.name == made.truth:
            n = len(posterior.values)
            ranks = made.ranks(posterior.parameter_names, posterior.values, np.full(n, 1.0 / n))
    probabilities = {row.name: row.probability for row in rows}
    failed_checks = result.ranking.comparison.failed_checks
    return Searched(made.truth, probabilities, made.detuning, failed_checks, errors, ranks)


def screened(made: Drawn, question: Question, seed: int) -> Searched:
    """What screening alone says of a data set."""
    study = bs.Study(made.baseline.name, [made.baseline])
    baselines = choose_baselines(study, None, question.candidates, options=made.settings)
    hypotheses, _ = screened_hypotheses(baselines, seed, bs.Run())
    by_name = {each.model_class.name: each for each in hypotheses.values()}
    shares = softmax([each.approximate_log_mass.log_evidence for each in by_name.values()])
    true = by_name[made.truth]
    values = true.model_class.values(true.screened.z)
    ranks = made.ranks(true.model_class.parameter_names, values, true.screened.weights)
    probabilities = dict(zip(by_name, shares.tolist(), strict=True))
    return Searched(made.truth, probabilities, made.detuning, ranks=ranks)


def search_settings(question: Question, masses: Prior, sampled: str) -> bs.SearchSettings:
    """What an appendage may be, with a prior of its mass ratio."""
    return bs.SearchSettings(
        mass_ratio=masses,
        frequency=question.frequency,
        number_weights=(1.0, 1.0),
        most_unsampled=0.0 if sampled == "all" else question.most_unsampled,
    )


def report(results: list[Searched]) -> None:
    with_one = [result for result in results if not np.isnan(result.detuning)]
    without = [result for result in results if np.isnan(result.detuning)]
    stated = np.array([p for result in results for p in result.probabilities.values()])
    right = np.array([n == result.truth for result in results for n in result.probabilities])
    print(f"All hypotheses of {len(results)} data sets:")
    print_bands(stated, right, (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0))
    best = np.array([max(result.probabilities.values()) for result in results])
    hit = np.array([max(r.probabilities, key=r.probabilities.get) == r.truth for r in results])
    print("The most probable hypothesis of each:")
    print_bands(best, hit, (0.0, 0.2, 0.4, 0.6, 0.8, 1.0))
    alarms = sum(1.0 - result.probabilities["no appendage"] > ALARM for result in without)
    clear = len(without) - alarms
    low, high = beta.ppf([0.025, 0.975], [alarms, alarms + 1], [clear + 1, clear])
    print(
        f"False alarms, an appendage stated with more than {ALARM} where there is none: {alarms} "
        f"of {len(without)} (95 % interval {np.nan_to_num(low):.3f} to {high:.3f})"
    )
    at_places = [r for r in with_one if not r.truth.startswith("motion like mode")]
    for where, own in (
        (f"within {NEAR:.0%} of a mode's frequency", [r for r in at_places if r.detuning < NEAR]),
        ("elsewhere", [r for r in at_places if r.detuning >= NEAR]),
        ("that move like a mode", [r for r in with_one if r not in at_places]),
    ):
        first = sum(max(r.probabilities, key=r.probabilities.get) == r.truth for r in own)
        seen = sum(1.0 - r.probabilities["no appendage"] > ALARM for r in own)
        places = [{k: p for k, p in r.probabilities.items() if k != "no appendage"} for r in own]
        place = sum(max(p, key=p.get) == r.truth for p, r in zip(places, own, strict=True))
        print(
            f"Appendages {where}: {len(own)}; true hypothesis first {first}, true place first "
            f"among places {place}, an appendage stated with more than {ALARM} {seen}"
        )
    report_ranks([result.ranks for result in with_one if result.ranks])
    errors = np.array([error for result in results for error in result.errors])
    for name, own in zip(("Laplace", "Screened"), errors.T, strict=False):
        low, middle, high = np.quantile(own, [0.05, 0.5, 0.95])
        print(
            f"{name} less sampled log evidence, {len(own)} hypotheses: median {middle:.2f}, 90 % "
            f"from {low:.2f} to {high:.2f}, all from {own.min():.2f} to {own.max():.2f} nats"
        )
    flagged = [result for result in results if result.failed_checks]
    print(f"{len(flagged)} of {len(results)} sets with a failed check")
    for check in sorted({check for result in flagged for check in result.failed_checks}):
        print(f"    {check}")


def report_ranks(ranks: Sequence[Sequence[float]]) -> None:
    """How often true masses and frequencies lie within intervals of their posteriors."""
    for name, own in zip(("mass", "frequency"), np.transpose(ranks), strict=False):
        half, most = (int((np.abs(own - 0.5) < 0.5 * share).sum()) for share in (0.5, 0.9))
        print(
            f"True {name} of {len(own)} appendages within the posterior's 50 % interval {half}, "
            f"90 % {most}; ranks are uniform with p = {kstest(own, 'uniform').pvalue:.2f}"
        )


def known(path: Path | None) -> dict[str, Searched]:
    """Results by task, from a file of lines."""
    if path is None or not path.exists():
        return {}
    lines = map(json.loads, path.read_text().splitlines())
    return {task: Searched(*fields) for task, fields in lines}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--on", choices=("building", "tower"), default="building")
    parser.add_argument("--off", type=float, default=0.0, help="of the tower's second quarter")
    parser.add_argument("--sets", type=int, default=100, help="with an appendage, and without")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--sampled", choices=("chosen", "all", "none"), default="chosen")
    parser.add_argument("--lines", type=Path, help="file of results, one a line")
    options = parser.parse_args()
    tasks = [
        Task(options.on, options.off, i, truth, options.sampled)
        for i in range(options.sets)
        for truth in (False, True)
    ]
    results = known(options.lines)
    new = [task for task in tasks if str(task) not in results]
    with ProcessPoolExecutor(options.processes) as pool:
        for task, result in zip(new, pool.map(one, new), strict=True):
            results[str(task)] = result
            if options.lines:
                with options.lines.open("a") as file:
                    file.write(json.dumps([str(task), result]) + "\n")
    report([results[str(task)] for task in tasks])


if __name__ == "__main__":
    main()
