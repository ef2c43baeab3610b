"""The ranking of sampled classes, and its checks: what may be wrong with the answer, or does not
change it.

Each checker goes from a ranking to failed checks and remarks. The end of the band, a prior at whose
edge a posterior lies, and the probabilities of missed and spurious modes are the analyst's choice:
each is moved as far as one may be wrong about it, and the ranking and the parameters are compared
with those before. Only a setting that changes the answer fails a check; any other is a remark at
most.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from bayes_ssi.inference.criticism.misfit import AtEdge
from bayes_ssi.inference.model_class.configuration import failed_data_checks
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior, known_at_draws
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.comparison import (
    BARE_MENTION,
    PROBABLE,
    Check,
    Comparison,
    RankedClass,
    at_edges,
    by_evidence,
    class_probabilities,
    failed_sampling,
    misfit_of_best,
)
from bayes_ssi.studies.ranking.diagnosis import with_hints
from bayes_ssi.studies.ranking.study import Ranking, Study
from bayes_ssi.studies.ranking.variations import (
    Variation,
    Varied,
    reaches_bound,
    reweighted,
    sampled_again,
    spreads_as_sampled,
    with_missed,
    with_spurious,
    with_wider_priors,
)

NEGLIGIBLE = 1e-4  # the least probability that is shown; less changes by no setting
# Factor by which widths of priors, and probabilities of missed and spurious modes, may be wrong.
VARIED_BY = 2.0
# Filters roll off and identification gets worse over about this much of a band.
BAND_MOVED = 0.05
# A setting that moves a class's probability by more fails a check, and so does one that moves a
# parameter of the structure by more of its standard deviations: the error it is quoted with.
PROBABILITY_MOVED, PARAMETER_MOVED = 0.1, 1.0

# From a ranking, and workers for what it takes to check it.
Checker = Callable[[Ranking, Run], Iterable[Check]]


def failed_data(ranking: Ranking, _: Run) -> Iterator[Check]:
    """Failed checks of the data, such as of how the modes were identified."""
    yield from (Check("data", words) for words in failed_data_checks(ranking.tests))


def misfit_and_sampling(ranking: Ranking, _: Run) -> Iterator[Check]:
    yield from misfit_of_best(ranking.comparison, ranking.posteriors)
    yield from failed_sampling(ranking.comparison, ranking.posteriors)


def settings_moved(ranking: Ranking, run: Run) -> Iterator[Check]:
    """What settings do to the ranking, where posteriors lie at their edges.

    Classes whose draws do not cover a moved setting are sampled again.
    """
    comparison, posteriors = ranking.comparison, ranking.posteriors
    if any(posterior.sensor_shapes is None for posterior in posteriors):
        yield from at_edges(comparison, posteriors)
        return

    def sample(changed: Sequence[ModelClass]) -> Sequence[Posterior]:
        return sample_all(changed, ranking.seed, ranking.settings, Run(run.workers))

    by_name = {posterior.name: posterior for posterior in posteriors}
    classes = {candidate.name: candidate for candidate in ranking.study.model_classes}
    relevant = [row.name for row in comparison.classes if row.probability >= NEGLIGIBLE]
    known = {name: known_at_draws(classes[name], by_name[name]) for name in relevant}
    study = _MovableStudy(comparison, by_name, known, classes, sample)
    probable = [row for row in comparison.classes if row.probability >= PROBABLE]
    for row in probable:
        yield from (study.at_edge(edge, row) for edge in by_name[row.name].edges)
    tests = (by_name[row.name].configurations for row in probable)
    if len({sum(len(test.pairing) for test in of_class) for of_class in tests}) > 1:
        for subject, vary in (("missed", with_missed), ("spurious", with_spurious)):
            moves = [
                Variation(f"half as many {subject} modes", partial(vary, 1.0 / VARIED_BY)),
                Variation(f"twice as many {subject} modes", partial(vary, VARIED_BY)),
            ]
            what = "the classes differ in how many modes are missed or spurious"
            yield study.moved("setting", what, moves, comparison.best)


CHECKERS: tuple[Checker, ...] = (failed_data, misfit_and_sampling, settings_moved)


def ranked(
    study: Study,
    posteriors: Sequence[Posterior],
    seed: int,
    settings: SamplingSettings,
    run: Run,
    checkers: Sequence[Checker] = CHECKERS,
) -> Ranking:
    """The ranking of sampled classes, checked; with hints if the best does not explain the data."""
    comparison = by_evidence(posteriors, study.prior_weights)
    hinted = with_hints(study.model_classes, posteriors, comparison, run.workers)
    ranking = Ranking(study, hinted, comparison, seed, settings)
    checks = [check for checker in checkers for check in checker(ranking, run)]
    return replace(ranking, comparison=comparison.with_checks(checks))


@dataclass(frozen=True)
class _MovableStudy:
    """A comparison that can be made again with a setting moved."""

    comparison: Comparison
    posteriors: Mapping[str, Posterior]  # of the classes, by their names
    known: Mapping[str, ModelClass]  # with modes known at draws
    classes: Mapping[str, ModelClass]  # as they were sampled
    # How varied ones are sampled where draws do not cover them.
    sample: Callable[[Sequence[ModelClass]], Sequence[Posterior]]
    # By the name of a move, which says what is moved and how far: classes at one edge share them.
    answers: dict[str, dict[str, Varied]] = field(default_factory=dict)

    def at_edge(self, edge: AtEdge, row: RankedClass) -> Check:
        """What an edge at which the posterior of a class lies does to the ranking."""
        if unseen := self._hidden_beyond(edge, row.name):
            return Check("edge", f"{edge.statement}; {unseen}", model_class=row.name)
        moves = _moves_of(edge, self.classes[row.name])
        return self.moved("edge", edge.statement, moves, row)

    def moved(self, kind: str, what: str, moves: Sequence[Variation], row: RankedClass) -> Check:
        """What the moves do to the ranking, and to the parameters of the class of a row."""

        def check(effect: str, fails: bool = True) -> Check:
            return Check(kind, f"{what}; {effect}", fails, row.name)

        largest_change, largest_shift = 0.0, 0.0
        before = {each.name: each.probability for each in self.comparison.classes}
        for move in moves:
            answers = self._answers(move)
            problems = (
                f"{other.name!r}: {answers[other.name].problem}"
                for other in self.comparison.classes
                if other.probability >= PROBABLE and answers[other.name].problem
            )
            if problem := next(problems, ""):
                return check(f"what {move.name} would change is not known: {problem}")
            after = self._probabilities(answers)
            changes = {name: after[name] - before[name] for name in before}
            most = max(changes, key=lambda name: abs(changes[name]))
            best = max(after, key=lambda name: after[name])
            shift, parameter = self._largest_shift(row.name, answers[row.name])
            # A class that is more probable by less than a bare mention is level with the other.
            level = math.exp(BARE_MENTION) * after[self.comparison.best.name]
            if after[best] > level:
                return check(f"with {move.name}, {best!r} is the most probable class")
            if abs(changes[most]) > PROBABILITY_MOVED:
                words = f"from {after[most] - changes[most]:.2f} to {after[most]:.2f}"
                return check(f"with {move.name}, the probability of {most!r} goes {words}")
            if shift > PARAMETER_MOVED and row.probability > PROBABILITY_MOVED:
                words = f"{parameter!r} moves by {shift:.1f} of its standard deviation"
                return check(f"with {move.name}, {words}")
            largest_change = max(largest_change, abs(changes[most]))
            largest_shift = max(largest_shift, shift)
        names = " or ".join(move.name for move in moves)
        # Rounded up to two decimals.
        return check(
            f"with {names}, no probability changes by more than {largest_change + 0.005:.2f}, and "
            f"no parameter of the structure by more than {largest_shift + 0.005:.2f} of its "
            "standard deviation",
            fails=False,
        )

    def _hidden_beyond(self, edge: AtEdge, name: str) -> str:
        """An effect that no draw can show, beyond the bound of a prior; empty where all can."""
        if edge.parameter is None:
            return ""
        posterior = self.posteriors[name]
        column = posterior.parameter_names.index(edge.parameter)
        bound = self.classes[name].parameters[column].prior.support[edge.end]
        # Zero bounds the quantity itself, such as the size of an error, and not only its prior.
        if bound == 0.0 or not reaches_bound(posterior.values[:, column], bound, edge.end):
            return ""
        return (
            f"what a prior beyond {bound:g} would change is not known, because nothing was sampled "
            "there"
        )

    def _answers(self, move: Variation) -> dict[str, Varied]:
        """The classes under a move, probable ones sampled again where draws do not cover it."""
        # One that is less probable than this can hardly lose so much, and there may be dozens.
        probable = {
            row.name for row in self.comparison.classes if row.probability > PROBABILITY_MOVED
        }
        if move.name not in self.answers:
            answers = {
                name: reweighted(self.posteriors[name], known, move.change(known))
                for name, known in self.known.items()
            }
            again = [name for name in answers if answers[name].problem and name in probable]
            sampled = self.sample([move.change(self.classes[name]) for name in again])
            for name, posterior in zip(again, sampled, strict=True):
                answers[name] = sampled_again(answers[name], self.posteriors[name], posterior)
            self.answers[move.name] = answers
        return self.answers[move.name]

    def _probabilities(self, answers: Mapping[str, Varied]) -> dict[str, float]:
        """Probabilities after a move: odds change by the evidences' ratios."""
        rows = self.comparison.classes
        log_ratios = {
            name: 0.0 if each.problem else each.log_ratio.log_evidence
            for name, each in answers.items()
        }
        shares = {row.name: row.probability for row in rows if row.probability > 0.0}
        changes = {name: log_ratios.get(name, 0.0) for name in shares}
        return dict.fromkeys([row.name for row in rows], 0.0) | class_probabilities(changes, shares)

    def _largest_shift(self, name: str, answer: Varied) -> tuple[float, str]:
        """The largest shift of a mean, in posterior standard deviations, and its parameter."""
        # Sizes of errors are no answer.
        structural = self.classes[name].structural_parameters
        before = spreads_as_sampled(self.posteriors[name])[: len(structural)]
        shifts = [
            (abs(new.mean - old.mean) / old.sd if old.sd > 0 else 0.0, old.name)
            for old, new in zip(before, answer.parameters, strict=False)
        ]
        return max(shifts, default=(0.0, ""))


def _moves_of(edge: AtEdge, model_class: ModelClass) -> list[Variation]:
    """A wider prior, or the end of the band moved in and out."""
    if edge.parameter is not None:
        factor = VARIED_BY
        name = f"a prior of {edge.parameter!r} that is {factor:g} times as wide"
        return [Variation(name, partial(with_wider_priors, factor, {edge.parameter}))]
    test = model_class.configuration(edge.configuration)
    identified = test.data.frequencies_hz
    where = f" of configuration {test.name!r}" if test.name else ""
    moves = []
    for factor in (1.0 - BAND_MOVED, 1.0 + BAND_MOVED):
        ends = list(test.data.band_hz)
        ends[edge.end] *= factor
        # The identified modes stay inside.
        band = (min(ends[0], float(identified[0])), max(ends[1], float(identified[-1])))
        name = f"the band{where} {('beginning', 'ending')[edge.end]} at {band[edge.end]:.3g} Hz"
        moves.append(Variation(name, partial(_with_band, test.name, band)))
    return moves


def _with_band(name: str, band_hz: tuple[float, float], candidate: ModelClass) -> ModelClass:
    """The class with another band of one of its tests."""
    tests = (
        replace(test, data=replace(test.data, band_hz=band_hz)) if test.name == name else test
        for test in candidate.configurations
    )
    return replace(candidate, configurations=tuple(tests))
