"""``plan``: the sensors, and the configuration, with which the next test says most."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.studies.planning.layout_search import (
    LayoutSearch,
    effective_independence,
    largest_mac,
)
from bayes_ssi.studies.planning.layout_values import Sensors, SimulatedPlan, Worth, mean
from bayes_ssi.studies.planning.plan_record import (
    CLASS,
    Change,
    ConfigurationPlan,
    Layout,
    Plan,
)
from bayes_ssi.studies.planning.plan_settings import PLANNING, PlanSettings
from bayes_ssi.studies.planning.planned_class import PlannedClass
from bayes_ssi.studies.planning.planned_study import (
    Quantity,
    check_aim,
    checked_sensors,
    known_classes,
    planned_classes,
    worth_of,
)
from bayes_ssi.studies.ranking.study import Study


@checked
def plan(
    study: Study,
    n_sensors: int,
    *,
    aim: str | Quantity = CLASS,
    candidates: Sequence[Candidate | str] | None = None,
    fixed: Sequence[str] = (),
    excluded: Sequence[str] = (),
    configurations: Sequence[str] | None = None,
    after: Any = None,
    settings: PlanSettings | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Plan:
    """Choose the sensors of a test for what it is to answer, before it is made.

    Tests are simulated from every model class under its likelihood: errors, missed and spurious
    modes. Which mode is which is not known to a test before it is made, so that all pairings are
    possible, and classes that differ in their pairing alone are one.

    Args:
        study: its data give the band of the planned test and the errors of its identification.
        n_sensors: number of sensors.
        aim: "class" for which model class holds; "parameters" for all parameters of the structures,
            or the name of one; or a function for a prediction, given a structure and parameter
            values (B, n_parameters), returning (B,) or (B, q).
        candidates: where sensors may be, labels of degrees of freedom or of sensors, or Candidates;
            all degrees of freedom that all classes have, if None and these are few, else the
            sensors of the study's data.
        fixed: names of candidates that are measured in any case.
        excluded: names of candidates that cannot be.
        configurations: alternatives, names of the study's configurations; all of them if None.
        after: a ranking or stored result of the study: the planned test is the next one. Before any
            test, with the prior, if None.
        settings: how many tests to simulate, and how precisely.
        seed: of all that is random.
        progress: called with what is done, and the completed share of the work.

    Raises:
        ValueError: there are fewer candidates than sensors, a candidate, class, parameter or
            configuration does not exist, the aim is the class and there is only one, or the result
            is not one of this study.
    """
    settings = settings or PlanSettings()
    known = known_classes(study, after)
    names = configurations or known[0].model_class.configuration_names
    report = progress or (lambda _name, _done: None)
    plans = []
    request = _Request(n_sensors, aim, fixed, excluded, settings, seed)
    for name in dict.fromkeys(names):
        classes = planned_classes(known, name, candidates)
        plans.append(_configuration_plan(classes, name, request, partial(report, name)))
    return Plan(
        study=study.name,
        aim=aim if isinstance(aim, str) else getattr(aim, "__name__", "prediction"),
        n_sensors=n_sensors,
        classes={each.model_class.name: each.probability for each in known},
        is_after_a_test=after is not None,
        n_tests=settings.n_tests,
        n_draws=settings.n_draws,
        seed=seed,
        configurations=tuple(plans),
    )


class _Request(NamedTuple):
    n_sensors: int
    aim: str | Quantity
    fixed: Sequence[str]
    excluded: Sequence[str]
    settings: PlanSettings
    seed: int

    def simulated(self, classes: Sequence[PlannedClass]) -> SimulatedPlan:
        return SimulatedPlan.of(classes, self.settings.n_tests, self.settings.n_draws, self.seed)


def _configuration_plan(
    classes: Sequence[PlannedClass], name: str, request: _Request, report: Callable[[float], None]
) -> ConfigurationPlan:
    """The layouts for one configuration."""
    names = tuple(place.name for place in classes[0].candidates)
    sides = checked_sensors(names, request.n_sensors, request.fixed, request.excluded)
    check_aim(classes, request.aim)
    report(0.0)
    valuation = _Valuation(request.simulated(classes), request.aim)
    report(0.4)
    search = _search(valuation.plan, request.aim, *sides)
    habit = effective_independence(valuation.shapes, request.n_sensors, sides[0])
    found = _found(search, habit, valuation.shapes, request.n_sensors)
    by_number = [*found.smaller, found.best[0]]
    ranked = sorted(found.best, key=lambda sensors: -valuation.layout(sensors).gain)
    by_number[-1] = best = ranked[0]
    numbered = tuple(map(valuation.layout, by_number))
    largest = max(layout.gain for layout in numbered)
    report(0.7)
    test = classes[0].test
    better = _Valuation(
        request.simulated([replace(c, test=replace(test, factor=SMALLER)) for c in classes]),
        request.aim,
    )
    worth = valuation.worth(best)
    changed = better.worth(best).values - worth.values
    present = tuple(i for i, each in enumerate(names) if each in test.sensors)
    compared = {"effective independence": habit, "the sensors of the data": present}
    compared["all candidates"] = tuple(sorted((*sides[0], *sides[1])))
    bias = mean(valuation.plan, worth.bias).value
    structure = classes[0].structure
    heights = structure.heights()
    probabilities = valuation.plan.probabilities
    report(1.0)
    return ConfigurationPlan(
        name=name,
        candidates=classes[0].candidates,
        heights={each: heights[each] for each in names if each in heights},
        best=valuation.layout(best),
        others=tuple(map(valuation.layout, ranked[1:])),
        compared={key: valuation.layout(layout) for key, layout in compared.items() if layout},
        by_number=numbered,
        knee=next(
            len(each.sensors) for each in numbered if each.gain >= PLANNING.enough * largest
        ),
        left_out=tuple(
            valuation.change(best, tuple(j for j in best if j != i), names[i])
            for i in best
            if i not in sides[0] and len(best) > 1
        ),
        added=tuple(
            sorted(
                (valuation.change(best, tuple(sorted((*best, i))), names[i])
                 for i in sides[1] if i not in best),
                key=lambda change: -change.gain,
            )
        ),
        smaller_errors=Change(
            f"{'identification errors' if test.states_errors else 'all errors'} half as large",
            *mean(valuation.plan, changed),
        ),
        greatest=(
            float(-(probabilities * np.log(probabilities)).sum()) if request.aim == CLASS else None
        ),
        is_exhaustive=search.is_exhaustive(request.n_sensors),
        n_tried=len(search.tried),
        other_start=found.other_start,
        effective_draws=float(np.median(worth.draws)),
        bias=bias,
        failed_checks=tuple(_failed_checks(worth, bias)),
        geometry=structure.geometry,
    )  # fmt: skip


SMALLER = 0.5  # of errors: a record is four times as long


class _Valuation:
    """Layouts valued with all simulated tests."""

    def __init__(self, plan: SimulatedPlan, aim: str | Quantity) -> None:
        self.plan = plan
        self._worth = worth_of(plan, aim)
        self._known: dict[Sensors, Worth] = {}
        self._is_of_class = aim == CLASS

    def worth(self, sensors: Sensors) -> Worth:
        if sensors not in self._known:
            self._known[sensors] = self._worth(self.plan.sums(sensors))
        return self._known[sensors]

    def layout(self, sensors: Sensors) -> Layout:
        worth = self.worth(sensors)
        gain, naming = mean(self.plan, worth.values), mean(self.plan, worth.named)
        planned = self.plan.classes[0]
        return Layout(
            tuple(planned.candidates[i].name for i in sensors),
            planned.test.band_hz,
            gain.value,
            gain.error,
            naming.value if self._is_of_class else None,
            naming.error if self._is_of_class else None,
            largest_mac(self.shapes[list(sensors)]) if len(sensors) > 1 else None,
        )

    def change(self, best: Sensors, other: Sensors, what: str) -> Change:
        """What another layout would change, on the same tests."""
        return Change(what, *mean(self.plan, self.worth(other).values - self.worth(best).values))

    @cached_property
    def shapes(self) -> FloatArray:
        """Of the most probable class (n_candidates, n_modes) in the band, before the test."""
        planned = max(self.plan.classes, key=lambda each: each.probability)
        modes = planned.modes(planned.before[0][None])
        low, high = planned.test.band_hz
        inside = (modes.frequencies_hz[0] > low) & (modes.frequencies_hz[0] < high)
        return modes.shapes[0][:, inside if inside.any() else slice(None)]


def _search(
    plan: SimulatedPlan, aim: str | Quantity, fixed: Sensors, free: Sensors
) -> LayoutSearch:
    """A search on some of the simulated tests."""
    some = plan.part(*PLANNING.n_searched)
    worth = worth_of(some, aim)
    return LayoutSearch(some, lambda sums: mean(some, worth(sums).values).value, fixed, free)


class _Found(NamedTuple):
    smaller: list[Sensors]  # the best layouts of fewer sensors
    best: list[Sensors]  # of all sensors, the best first
    other_start: float | None


def _found(search: LayoutSearch, habit: Sensors, shapes: FloatArray, n_sensors: int) -> _Found:
    layouts: list[Sensors] = []
    for number in range(max(1, len(search.fixed)), n_sensors + 1):
        if number == 1:  # no shape is measured: one place is as good as another
            layouts.append(effective_independence(shapes[list(search.free)], 1))
        else:
            layouts.append(search.best(number, layouts[-1] if layouts else search.fixed))
    other_start = None
    if not search.is_exhaustive(n_sensors) and n_sensors > 1:
        other_start = search.tried[search.exchanged(habit)] - search.tried[layouts[-1]]
    tried = [each for each in search.tried if len(each) == n_sensors]
    best = sorted(tried, key=search.tried.__getitem__, reverse=True)[: PLANNING.n_shown]
    return _Found(layouts[:-1], best or layouts[-1:], other_start)


def _failed_checks(worth: Worth, bias: float) -> Iterator[str]:
    thin = float((worth.draws < PLANNING.least_draws).mean())
    if thin > PLANNING.most_thin:
        yield (
            f"in {100.0 * thin:.0f} % of the simulated tests evidences rest on fewer than "
            f"{PLANNING.least_draws:g} effective draws; simulate with more draws"
        )
    if not abs(bias) <= PLANNING.most_bias:
        yield f"few draws bias the gain by about {bias:+.3f} nats; simulate with more draws"
