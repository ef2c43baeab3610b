"""What the settings do to a ranking, where posteriors lie at their edges: moved, and ranked again.

The end of the band, a prior at whose edge a posterior lies, and the probabilities of missed and
spurious modes are the analyst's choice. Each is moved as far as one may be wrong about it, the
draws of all classes are reweighted, those that do not cover the change sampled again, and the
ranking and the parameters are compared with those before. Only a setting that changes the answer
fails a check; any other is a remark at most.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from bayes_ssi.inference.criticism.edges import AtEdge
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.known_modes import known_at_draws
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.studies.ranking.comparison import (
    PROBABLE,
    SCALE,
    Check,
    Comparison,
    RankedClass,
    class_probabilities,
)
from bayes_ssi.studies.ranking.reweighting import ParameterSpread, reaches_bound, spreads_of
from bayes_ssi.studies.ranking.variations import (
    Variation,
    with_bands,
    with_missed,
    with_spurious,
    with_wider_priors,
)

# Nobody knows the end of a band to a few per cent: filters roll off and identification gets worse
# over about this much of it.
BAND_MOVED = 0.05
# A prior, and the probabilities of missed and spurious modes, may be wrong by this factor in their
# widths and sizes, as in the table of sensitivity.
FACTOR = 2.0
# A check fails where a class's probability moves by more than this, or a parameter of the
# structure by more than this many of its standard deviations, which is the error it is quoted with.
PROBABILITY_MOVED, PARAMETER_MOVED = 0.1, 1.0
# A class that is more probable than another by less than this is level with it: their difference is
# not more than a bare mention on the scale of Bayes factors.
LEVEL = math.exp(0.5 * SCALE[0][0])
# Less probable classes than this, the least probability that is shown, are taken as unchanged.
NEGLIGIBLE = 1e-4


@dataclass(frozen=True)
class Effect:
    """What a moved setting does, in words; whether it changes the answer."""

    words: str
    fails: bool


@dataclass(frozen=True)
class _Moved:
    """A class under a moved setting; ``log_ratio`` is that of its evidences, in nats."""

    log_ratio: float
    before: Sequence[ParameterSpread]
    after: Sequence[ParameterSpread]
    problem: str


def with_settings_checked(
    model_classes: Sequence[ModelClass],
    posteriors: Sequence[Posterior],
    comparison: Comparison,
    sample: Callable[[ModelClass], Posterior],
) -> Comparison:
    """The comparison, in which settings fail a check only where they change the answer.

    Args:
        sample: samples a class again where its draws do not cover a moved setting.
    """
    by_name = {posterior.name: posterior for posterior in posteriors}
    if any(posterior.sensor_shapes is None for posterior in posteriors):
        return comparison
    relevant = [row for row in comparison.classes if row.probability >= NEGLIGIBLE]
    classes = {each.name: each for each in model_classes}
    known = {row.name: known_at_draws(classes[row.name], by_name[row.name]) for row in relevant}
    study = _MovableStudy(comparison, by_name, known, classes, sample)
    rows = [_checked(row, study) for row in comparison.classes]
    if _rests_on_missed_and_spurious(comparison, by_name):
        for subject, vary in (("missed", with_missed), ("spurious", with_spurious)):
            effect = study.effect(_of_identification(subject, vary), comparison.best)
            what = f"the classes differ in how many modes are missed or spurious; {effect.words}"
            rows[0] = _with(rows[0], Check("setting", what, effect.fails))
    return replace(comparison, classes=tuple(rows))


def _checked(row: RankedClass, study: _MovableStudy) -> RankedClass:
    """A class whose edges fail a check where the setting changes the answer."""
    row = replace(row, checks=tuple(check for check in row.checks if check.kind != "edge"))
    if row.probability < PROBABLE:
        return row
    for edge in study.posteriors[row.name].edges:
        problem = study.hidden_beyond(edge, row.name)
        effect = problem or study.effect(_moves_of(edge, study.known[row.name]), row)
        words = f"{edge.statement}; {effect.words}"
        row = _with(row, Check("edge", words, effect.fails))
    return row


def _with(row: RankedClass, check: Check) -> RankedClass:
    return replace(row, checks=(*row.checks, check))


@dataclass(frozen=True)
class _MovableStudy:
    """A comparison that can be made again with a setting moved."""

    comparison: Comparison
    posteriors: dict[str, Posterior]
    known: dict[str, ModelClass]
    classes: dict[str, ModelClass]
    sample: Callable[[ModelClass], Posterior]
    answers: dict[str, dict[str, _Moved]] = field(default_factory=dict)

    def effect(self, moves: Sequence[Variation], row: RankedClass) -> Effect:
        """What the moves do to the ranking, and to the parameters of the class of a row."""
        largest_change, largest_shift = 0.0, 0.0
        for move in moves:
            answers = self._answers(move)
            if problem := self._problem(answers):
                return Effect(f"what {move.name} would change is not known: {problem}", True)
            after = self._probabilities(answers)
            changes = {r.name: after[r.name] - r.probability for r in self.comparison.classes}
            most = max(changes, key=lambda name: abs(changes[name]))
            best = max(after, key=lambda name: after[name])
            shift, parameter = _largest_shift(answers[row.name], self.known[row.name])
            if after[best] > LEVEL * after[self.comparison.best.name]:
                return Effect(f"with {move.name}, {best!r} is the most probable class", True)
            if abs(changes[most]) > PROBABILITY_MOVED:
                words = f"from {after[most] - changes[most]:.2f} to {after[most]:.2f}"
                return Effect(f"with {move.name}, the probability of {most!r} goes {words}", True)
            if shift > PARAMETER_MOVED and row.probability > PROBABILITY_MOVED:
                words = f"{parameter!r} moves by {shift:.1f} of its standard deviation"
                return Effect(f"with {move.name}, {words}", True)
            largest_change = max(largest_change, abs(changes[most]))
            largest_shift = max(largest_shift, shift)
        names = " or ".join(move.name for move in moves)
        return Effect(
            f"with {names}, no probability changes by more than {_up(largest_change)}, and no "
            f"parameter of the structure by more than {_up(largest_shift)} of its standard "
            "deviation",
            False,
        )

    def hidden_beyond(self, edge: AtEdge, name: str) -> Effect | None:
        """An effect that no draw can show, beyond the bound of a prior; None where all can."""
        if edge.parameter is None:
            return None
        posterior, model_class = self.posteriors[name], self.known[name]
        column = posterior.parameter_names.index(edge.parameter)
        bound = model_class.parameters[column].prior.support[edge.end]
        # Zero bounds the quantity itself, such as the size of an error, and not only its prior.
        if bound == 0.0 or not reaches_bound(posterior.values[:, column], bound, edge.end):
            return None
        return Effect(
            f"what a prior beyond {bound:g} would change is not known, because nothing was sampled "
            "there",
            True,
        )

    def _answers(self, move: Variation) -> dict[str, _Moved]:
        """The classes under a move, probable ones sampled again where draws do not cover it.

        Classes at one edge share the answer: the name of a move says what is moved, and how far.
        """
        if move.name in self.answers:
            return self.answers[move.name]
        # One that is less probable than this can hardly lose so much, and there may be dozens.
        rows = self.comparison.classes
        probable = {row.name for row in rows if row.probability > PROBABILITY_MOVED}
        answers = {}
        for name, one in move.reweighted(self.posteriors, self.known).items():
            log_ratio, after, problem = one.log_ratio.log_evidence, one.parameters, one.problem
            if problem and name in probable:
                again = self.sample(move.change(self.classes[name]))
                log_ratio = again.evidence.log_evidence - one.posterior.evidence.log_evidence
                after = spreads_of(again)
                problem = "; ".join(again.failed_checks)
            answers[name] = _Moved(log_ratio, one.before, after, problem)
        self.answers[move.name] = answers
        return answers

    def _problem(self, answers: dict[str, _Moved]) -> str:
        for row in self.comparison.classes:
            if row.probability >= PROBABLE and answers[row.name].problem:
                return f"{row.name!r}: {answers[row.name].problem}"
        return ""

    def _probabilities(self, answers: dict[str, _Moved]) -> dict[str, float]:
        """Probabilities after a move: odds change by the evidences' ratios."""
        rows = self.comparison.classes
        changes = {
            row.name: answers[row.name].log_ratio
            if row.name in answers and not answers[row.name].problem
            else 0.0
            for row in rows
        }
        shares = {row.name: row.probability for row in rows if row.probability > 0.0}
        return dict.fromkeys(changes, 0.0) | class_probabilities(
            {name: changes[name] for name in shares}, shares
        )


def _largest_shift(answer: _Moved, model_class: ModelClass) -> tuple[float, str]:
    """The largest shift of a mean, in posterior standard deviations, and its parameter.

    Of parameters of the structure: sizes of errors are no answer.
    """
    of_structure = {parameter.name for parameter in model_class.structural_parameters}
    shifts = [
        (abs(new.mean - old.mean) / old.sd if old.sd > 0 else 0.0, old.name)
        for old, new in zip(answer.before, answer.after, strict=True)
        if old.name in of_structure
    ]
    return max(shifts, default=(0.0, ""))


def _up(number: float) -> str:
    """A number rounded up to two decimals."""
    return f"{number + 0.005:.2f}"


def _moves_of(edge: AtEdge, model_class: ModelClass) -> list[Variation]:
    if edge.parameter is not None:
        name = f"a prior of {edge.parameter!r} that is {FACTOR:g} times as wide"
        return [Variation(name, partial(with_wider_priors, FACTOR, names={edge.parameter}))]
    test = model_class.configuration(edge.configuration)
    low, high = test.data.band_hz
    identified = test.data.frequencies_hz
    moves = []
    for factor in (1.0 - BAND_MOVED, 1.0 + BAND_MOVED):
        # The identified modes stay inside.
        ends = [low, high]
        ends[edge.end] *= factor
        band = (min(ends[0], float(identified[0])), max(ends[1], float(identified[-1])))
        where = f" of configuration {test.name!r}" if test.name else ""
        name = f"the band{where} {('beginning', 'ending')[edge.end]} at {band[edge.end]:.3g} Hz"
        moves.append(Variation(name, partial(with_bands, {test.name: band})))
    return moves


def _of_identification(
    subject: str, vary: Callable[[float, ModelClass], ModelClass]
) -> list[Variation]:
    return [
        Variation(f"{words} as many {subject} modes", partial(vary, factor))
        for words, factor in (("half", 1.0 / FACTOR), ("twice", FACTOR))
    ]


def _rests_on_missed_and_spurious(comparison: Comparison, posteriors: dict[str, Posterior]) -> bool:
    """Whether probable classes differ in how many identified modes they explain."""
    explained = {
        sum(len(modes.pairing) for modes in posteriors[row.name].configurations)
        for row in comparison.classes
        if row.probability >= PROBABLE
    }
    return len(explained) > 1
