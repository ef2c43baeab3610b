"""The ranking of sampled classes, and its checks: what may be wrong with the answer, or does not
change it.

Each checker goes from a ranking to failed checks and remarks. The end of the band, a prior at whose
edge a posterior lies, and the probabilities of missed and spurious modes are the analyst's choice:
each is moved as far as one may be wrong about it, and the ranking and the parameters are compared
with those before. Only a setting that changes the answer fails a check; any other is a remark at
most.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

from bayes_ssi.inference.criticism.misfit import AtEdge
from bayes_ssi.inference.model_class.configuration import failed_data_checks
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior, known_at_draws
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.ranking import variations
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.comparison import (
    BARE_MENTION,
    PROBABLE,
    Check,
    RankedClass,
    by_evidence,
    class_probabilities,
    failed_sampling,
    misfit_of_best,
)
from bayes_ssi.studies.ranking.diagnosis import with_hints
from bayes_ssi.studies.ranking.study import Ranking, Study
from bayes_ssi.studies.ranking.variations import Variation, Varied

NEGLIGIBLE = 1e-4  # the least probability that is shown; less changes by no setting
# Factor by which widths of priors, and probabilities of missed and spurious modes, may be wrong.
VARIED_BY = 2.0
# Filters roll off and identification gets worse over about this much of a band.
BAND_MOVED = 0.05
# A setting that moves a class's probability by more fails a check, and so does one that moves a
# parameter of the structure by more of its standard deviations: the error it is quoted with.
PROBABILITY_MOVED, PARAMETER_MOVED = 0.1, 1.0


def ranked(
    study: Study,
    posteriors: Sequence[Posterior],
    seed: int,
    settings: SamplingSettings,
    run: Run,
    searched: Collection[str] = (),
) -> Ranking:
    """The ranking of sampled classes, checked; with hints if the best does not explain the data.

    The bounds of ``searched`` parameters only say where is searched: being near one fails no check.
    """
    comparison = by_evidence(posteriors, study.prior_weights)
    hinted = with_hints(study.model_classes, posteriors, comparison, run.workers)
    ranking = Ranking(study, hinted, comparison, seed, settings)
    checks = [
        *(Check("data", words) for words in failed_data_checks(ranking.tests)),
        *misfit_of_best(comparison, hinted),
        *failed_sampling(comparison, hinted),
        *settings_moved(ranking, run, searched),
    ]
    return replace(ranking, comparison=comparison.with_checks(checks))


def settings_moved(ranking: Ranking, run: Run, searched: Collection[str]) -> Iterator[Check]:
    """What settings do to the ranking, where posteriors lie at their edges.

    Classes whose draws do not cover a moved setting are sampled again.
    """
    comparison, moving = ranking.comparison, _MovableRanking(ranking, run)
    has_shapes = all(posterior.sensor_shapes is not None for posterior in ranking.posteriors)
    probable = [row for row in comparison.classes if row.probability >= PROBABLE]
    for row in probable:
        for edge in ranking.posterior(row.name).edges:
            unmoved = Check("edge", edge.statement, model_class=row.name)
            check = moving.at_edge(edge, row) if has_shapes else unmoved
            only_said = edge.is_near_bound and edge.parameter in searched
            yield replace(check, fails=check.fails and not only_said)
    if not has_shapes:
        return
    tests = (ranking.posterior(row.name).configurations for row in probable)
    if len({sum(len(test.pairing) for test in of_class) for of_class in tests}) > 1:
        what = "the classes differ in how many modes are missed or spurious"
        varied = {"missed": variations.with_missed, "spurious": variations.with_spurious}
        for subject, vary in varied.items():
            moves = {
                f"half as many {subject} modes": partial(vary, 1.0 / VARIED_BY),
                f"twice as many {subject} modes": partial(vary, VARIED_BY),
            }
            yield moving.moved("setting", what, moves, comparison.best)


@dataclass(frozen=True)
class _MovableRanking:
    """A ranking that can be made again with a setting moved."""

    ranking: Ranking
    run: Run
    # By the name of a move, which says what is moved and how far: classes at one edge share them.
    answers: dict[str, dict[str, Varied]] = field(default_factory=dict)

    @property
    def rows(self) -> Sequence[RankedClass]:
        return self.ranking.comparison.classes

    @cached_property
    def classes(self) -> dict[str, ModelClass]:
        """As they were sampled."""
        return {candidate.name: candidate for candidate in self.ranking.study.model_classes}

    @cached_property
    def known(self) -> dict[str, ModelClass]:
        """Those that may matter, with modes known at draws."""
        names = [row.name for row in self.rows if row.probability >= NEGLIGIBLE]
        return {n: known_at_draws(self.classes[n], self.ranking.posterior(n)) for n in names}

    def at_edge(self, edge: AtEdge, row: RankedClass) -> Check:
        """What an edge at which the posterior of a class lies does to the ranking."""
        if edge.parameter is not None:
            posterior = self.ranking.posterior(row.name)
            column = posterior.parameter_names.index(edge.parameter)
            bound = self.classes[row.name].parameters[column].prior.support[edge.end]
            # Zero bounds the quantity itself, such as the size of an error, and not only its prior.
            x = posterior.values[:, column]
            if bound != 0.0 and variations.reaches_bound(x, bound, edge.end):
                unseen = f"what a prior beyond {bound:g} would change is not known, because nothing"
                words = f"{edge.statement}; {unseen} was sampled there"
                return Check("edge", words, model_class=row.name)
        moves = _moves_of(edge, self.classes[row.name])
        return self.moved("edge", edge.statement, moves, row)

    def moved(
        self, kind: str, what: str, moves: Mapping[str, Variation], row: RankedClass
    ) -> Check:
        """What the moves do to the ranking, and to the parameters of the class of a row."""

        def check(effect: str, fails: bool = True) -> Check:
            return Check(kind, f"{what}; {effect}", fails, row.name)

        largest_change, largest_shift = 0.0, 0.0
        before = {each.name: each.probability for each in self.rows}
        for move, change in moves.items():
            answers = self._answers(move, change)
            for other, probability in before.items():
                if probability >= PROBABLE and (problem := answers[other].problem):
                    return check(f"what {move} would change is not known: {other!r}: {problem}")
            after = self._probabilities(answers)
            changes = {name: after[name] - before[name] for name in before}
            most = max(changes, key=lambda name: abs(changes[name]))
            best = max(after, key=lambda name: after[name])
            shift, parameter = self._largest_shift(row.name, answers[row.name])
            # A class that is more probable by less than a bare mention is level with the other.
            level = math.exp(BARE_MENTION) * after[self.rows[0].name]
            if after[best] > level:
                return check(f"with {move}, {best!r} is the most probable class")
            if abs(changes[most]) > PROBABILITY_MOVED:
                words = f"from {after[most] - changes[most]:.2f} to {after[most]:.2f}"
                return check(f"with {move}, the probability of {most!r} goes {words}")
            if shift > PARAMETER_MOVED and row.probability > PROBABILITY_MOVED:
                words = f"{parameter!r} moves by {shift:.1f} of its standard deviation"
                return check(f"with {move}, {words}")
            largest_change = max(largest_change, abs(changes[most]))
            largest_shift = max(largest_shift, shift)
        # Rounded up to two decimals.
        return check(
            f"with {' or '.join(moves)}, no probability changes by more than "
            f"{largest_change + 0.005:.2f}, and no parameter of the structure by more than "
            f"{largest_shift + 0.005:.2f} of its standard deviation",
            fails=False,
        )

    def _answers(self, move: str, change: Variation) -> dict[str, Varied]:
        """The classes under a move, probable ones sampled again where draws do not cover it."""
        # One that is less probable than this can hardly lose so much, and there may be dozens.
        probable = {row.name for row in self.rows if row.probability > PROBABILITY_MOVED}
        if move not in self.answers:
            answers = {
                name: variations.reweighted(self.ranking.posterior(name), known, change(known))
                for name, known in self.known.items()
            }
            again = [name for name in answers if answers[name].problem and name in probable]
            changed = [change(self.classes[name]) for name in again]
            run = Run(self.run.workers)
            sampled = sample_all(changed, self.ranking.seed, self.ranking.settings, run)
            for name, posterior in zip(again, sampled, strict=True):
                before = self.ranking.posterior(name)
                answers[name] = variations.sampled_again(answers[name].changed, before, posterior)
            self.answers[move] = answers
        return self.answers[move]

    def _probabilities(self, answers: Mapping[str, Varied]) -> dict[str, float]:
        """Probabilities after a move: odds change by the evidences' ratios."""
        shares = {row.name: row.probability for row in self.rows if row.probability > 0.0}
        known = {name: each for name, each in answers.items() if not each.problem}
        changes = {n: known[n].log_ratio.log_evidence if n in known else 0.0 for n in shares}
        return {row.name: 0.0 for row in self.rows} | class_probabilities(changes, shares)

    def _largest_shift(self, name: str, answer: Varied) -> tuple[float, str]:
        """The largest shift of a mean, in posterior standard deviations, and its parameter."""
        # Sizes of errors are no answer.
        structural = self.classes[name].structural_parameters
        before = variations.spreads_as_sampled(self.ranking.posterior(name))[: len(structural)]
        shifts = [
            (abs(new.mean - old.mean) / old.sd if old.sd > 0 else 0.0, old.name)
            for old, new in zip(before, answer.parameters, strict=False)
        ]
        return max(shifts, default=(0.0, ""))


def _moves_of(edge: AtEdge, model_class: ModelClass) -> dict[str, Variation]:
    """A wider prior, or the end of the band moved in and out."""
    if edge.parameter is not None:
        name = f"a prior of {edge.parameter!r} that is {VARIED_BY:g} times as wide"
        return {name: partial(variations.with_wider_priors, VARIED_BY, {edge.parameter})}
    test = model_class.configuration(edge.configuration)
    identified = test.data.frequencies_hz
    where = f" of configuration {test.name!r}" if test.name else ""
    moves: dict[str, Variation] = {}
    for factor in (1.0 - BAND_MOVED, 1.0 + BAND_MOVED):
        ends = list(test.data.band_hz)
        ends[edge.end] *= factor
        # The identified modes stay inside.
        band = (min(ends[0], float(identified[0])), max(ends[1], float(identified[-1])))
        name = f"the band{where} {('beginning', 'ending')[edge.end]} at {band[edge.end]:.3g} Hz"
        moves[name] = partial(_with_band, test.name, band)
    return moves


def _with_band(name: str, band_hz: tuple[float, float], candidate: ModelClass) -> ModelClass:
    """The class with another band of one of its tests."""
    tests = (
        replace(test, data=replace(test.data, band_hz=band_hz)) if test.name == name else test
        for test in candidate.configurations
    )
    return replace(candidate, configurations=tuple(tests))
