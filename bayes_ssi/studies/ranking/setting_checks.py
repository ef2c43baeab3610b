"""What the settings do to a ranking, where posteriors lie at their edges: moved, and ranked again.

The end of the band, a prior at whose edge a posterior lies, and the probabilities of missed and
spurious modes are the analyst's choice. Each is moved as far as one may be wrong about it, and the
ranking and the parameters are compared with those before. Only a setting that changes the answer
fails a check; any other is a remark at most.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from bayes_ssi.inference.criticism.misfit import AtEdge
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.studies.ranking.comparison import (
    RANKING,
    Check,
    Comparison,
    RankedClass,
    class_probabilities,
)
from bayes_ssi.studies.ranking.variations import (
    SampledClasses,
    Variation,
    Varied,
    reaches_bound,
    spreads_as_sampled,
    with_bands,
    with_missed,
    with_spurious,
    with_wider_priors,
)


def with_settings_checked(
    model_classes: Sequence[ModelClass],
    posteriors: Sequence[Posterior],
    comparison: Comparison,
    sample: Callable[[Sequence[ModelClass]], Sequence[Posterior]],
) -> Comparison:
    """The comparison, in which settings fail a check only where they change the answer.

    Classes whose draws do not cover a moved setting are sampled again, by ``sample``.
    """
    if any(posterior.sensor_shapes is None for posterior in posteriors):
        return comparison
    by_name = {posterior.name: posterior for posterior in posteriors}
    relevant = [
        by_name[row.name] for row in comparison.classes if row.probability >= RANKING.negligible
    ]
    study = _MovableStudy(comparison, SampledClasses.of(model_classes, relevant, sample))
    rows = [_with_edges_checked(row, study) for row in comparison.classes]
    probable = [by_name[row.name] for row in comparison.classes if _is_probable(row)]
    if len({sum(len(test.pairing) for test in each.configurations) for each in probable}) > 1:
        for subject, vary in (("missed", with_missed), ("spurious", with_spurious)):
            moves = [
                Variation(f"half as many {subject} modes", partial(vary, 1.0 / RANKING.varied_by)),
                Variation(f"twice as many {subject} modes", partial(vary, RANKING.varied_by)),
            ]
            what = "the classes differ in how many modes are missed or spurious"
            rows[0] = _with_check(rows[0], "setting", what, study.effect(moves, comparison.best))
    return replace(comparison, classes=tuple(rows))


def _is_probable(row: RankedClass) -> bool:
    return row.probability >= RANKING.probable


def _with_edges_checked(row: RankedClass, study: "_MovableStudy") -> RankedClass:
    row = replace(row, checks=tuple(check for check in row.checks if check.kind != "edge"))
    if _is_probable(row):
        for edge in study.sampled.posteriors[row.name].edges:
            effect = study.hidden_beyond(edge, row.name)
            if effect is None:
                moves = _moves_of(edge, study.sampled.classes[row.name])
                effect = study.effect(moves, row)
            row = _with_check(row, "edge", edge.statement, effect)
    return row


@dataclass(frozen=True)
class Effect:
    """What a moved setting does, in words; whether it changes the answer."""

    words: str
    fails: bool = True


def _with_check(row: RankedClass, kind: str, what: str, effect: Effect) -> RankedClass:
    check = Check(kind, f"{what}; {effect.words}", effect.fails)
    return replace(row, checks=(*row.checks, check))


@dataclass(frozen=True)
class _MovableStudy:
    """A comparison that can be made again with a setting moved."""

    comparison: Comparison
    sampled: SampledClasses
    # By the name of a move, which says what is moved and how far: classes at one edge share them.
    answers: dict[str, dict[str, Varied]] = field(default_factory=dict)

    def effect(self, moves: Sequence[Variation], row: RankedClass) -> Effect:
        """What the moves do to the ranking, and to the parameters of the class of a row."""
        largest_change, largest_shift = 0.0, 0.0
        before = {each.name: each.probability for each in self.comparison.classes}
        for move in moves:
            answers = self._answers(move)
            if problem := self._problem(answers):
                return Effect(f"what {move.name} would change is not known: {problem}")
            after = self._probabilities(answers)
            changes = {name: after[name] - before[name] for name in before}
            most = max(changes, key=lambda name: abs(changes[name]))
            best = max(after, key=lambda name: after[name])
            shift, parameter = self._largest_shift(row.name, answers[row.name])
            # A class that is more probable by less than a bare mention is level with the other.
            level = math.exp(RANKING.bare_mention) * after[self.comparison.best.name]
            if after[best] > level:
                return Effect(f"with {move.name}, {best!r} is the most probable class")
            if abs(changes[most]) > RANKING.probability_moved:
                words = f"from {after[most] - changes[most]:.2f} to {after[most]:.2f}"
                return Effect(f"with {move.name}, the probability of {most!r} goes {words}")
            if shift > RANKING.parameter_moved and row.probability > RANKING.probability_moved:
                words = f"{parameter!r} moves by {shift:.1f} of its standard deviation"
                return Effect(f"with {move.name}, {words}")
            largest_change = max(largest_change, abs(changes[most]))
            largest_shift = max(largest_shift, shift)
        names = " or ".join(move.name for move in moves)
        return Effect(
            f"with {names}, no probability changes by more than {_up(largest_change)}, and no "
            f"parameter of the structure by more than {_up(largest_shift)} of its standard "
            "deviation",
            fails=False,
        )

    def hidden_beyond(self, edge: AtEdge, name: str) -> Effect | None:
        """An effect that no draw can show, beyond the bound of a prior; None where all can."""
        if edge.parameter is None:
            return None
        posterior = self.sampled.posteriors[name]
        column = posterior.parameter_names.index(edge.parameter)
        bound = self.sampled.classes[name].parameters[column].prior.support[edge.end]
        # Zero bounds the quantity itself, such as the size of an error, and not only its prior.
        if bound == 0.0 or not reaches_bound(posterior.values[:, column], bound, edge.end):
            return None
        return Effect(
            f"what a prior beyond {bound:g} would change is not known, because nothing was sampled "
            "there"
        )

    def _answers(self, move: Variation) -> dict[str, Varied]:
        """The classes under a move, probable ones sampled again where draws do not cover it."""
        # One that is less probable than this can hardly lose so much, and there may be dozens.
        probable = {
            row.name
            for row in self.comparison.classes
            if row.probability > RANKING.probability_moved
        }
        if move.name not in self.answers:
            self.answers[move.name] = self.sampled.varied(
                move, lambda one: bool(one.problem) and one.changed.name in probable
            )
        return self.answers[move.name]

    def _problem(self, answers: Mapping[str, Varied]) -> str:
        for row in self.comparison.classes:
            if _is_probable(row) and answers[row.name].problem:
                return f"{row.name!r}: {answers[row.name].problem}"
        return ""

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
        structural = self.sampled.classes[name].structural_parameters
        before = spreads_as_sampled(self.sampled.posteriors[name])[: len(structural)]
        shifts = [
            (abs(new.mean - old.mean) / old.sd if old.sd > 0 else 0.0, old.name)
            for old, new in zip(before, answer.parameters, strict=False)
        ]
        return max(shifts, default=(0.0, ""))


def _up(number: float) -> str:
    """A number rounded up to two decimals."""
    return f"{number + 0.005:.2f}"


def _moves_of(edge: AtEdge, model_class: ModelClass) -> list[Variation]:
    """A wider prior, or the end of the band moved in and out."""
    if edge.parameter is not None:
        factor = RANKING.varied_by
        name = f"a prior of {edge.parameter!r} that is {factor:g} times as wide"
        return [Variation(name, partial(with_wider_priors, factor, names={edge.parameter}))]
    test = model_class.configuration(edge.configuration)
    identified = test.data.frequencies_hz
    where = f" of configuration {test.name!r}" if test.name else ""
    moves = []
    for factor in (1.0 - RANKING.band_moved, 1.0 + RANKING.band_moved):
        ends = list(test.data.band_hz)
        ends[edge.end] *= factor
        # The identified modes stay inside.
        band = (min(ends[0], float(identified[0])), max(ends[1], float(identified[-1])))
        name = f"the band{where} {('beginning', 'ending')[edge.end]} at {band[edge.end]:.3g} Hz"
        moves.append(Variation(name, partial(with_bands, {test.name: band})))
    return moves
