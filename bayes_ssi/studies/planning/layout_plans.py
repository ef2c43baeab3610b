"""``plan``: the sensors, and the configuration, with which the next test says most."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.structures.elements import AddedMass
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.structures.modal import mac
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.appendages.candidates import located, require_distinct
from bayes_ssi.studies.planning import layout_values
from bayes_ssi.studies.planning.layout_values import Gains, Sensors, SimulatedPlan
from bayes_ssi.studies.planning.plan_record import CLASS, PARAMETERS, Layout, Plan
from bayes_ssi.studies.planning.planned_class import PlannedClass, terms_of
from bayes_ssi.studies.ranking.study import Study

DRAWS = (200, 400, 800, 1600)  # of a class about a test, until no check fails
MOST_KEPT = 1_000_000_000  # numbers of all draws' shapes, 4 GB
# Of predicted values, in units of their size and of their correlations: less is rounding.
LEAST_VARIATION = 1e-9
# A check fails where evidences rest on fewer effective draws in more than this share of tests,
# or few draws bias the gain by more nats.
LEAST_DRAWS = 5.0
MOST_THIN = 0.1
MOST_BIAS = 0.02
N_SEARCHED = (300, 100)  # tests and draws with which layouts are searched
N_SHOWN = 5  # of the best layouts
MOST_CANDIDATES = 60  # degrees of freedom that are candidates without being named
ENOUGH_OF_THE_GAIN = 0.95  # of the largest gain, at the knee
LEAST_PROBABILITY = 1e-3  # of classes after an earlier test

# "class", "parameters", the name of one, or a prediction: structure and parameter values
# (B, n_parameters) → (B,) or (B, q).
Aim = str | Callable[[Structure, FloatArray], FloatArray]


@checked
def plan(
    study: Study,
    n_sensors: int,
    *,
    aim: Aim = CLASS,
    candidates: Sequence[Candidate | str] | None = None,
    fixed: Sequence[str] = (),
    excluded: Sequence[str] = (),
    configurations: Sequence[str] | None = None,
    added_masses: Mapping[str, float] | None = None,
    after: Any = None,
    n_tests: int = 1000,
    n_draws: int | None = None,
    seed: int = 0,
    run: Run | None = None,
) -> Plan:
    """Choose the sensors of a test for what it is to answer, before it is made.

    Tests are simulated from every model class under its likelihood, with errors, missed and
    spurious modes. Which mode is which is not known before a test: all pairings are possible, and
    classes that differ in their pairing alone are one.

    Args:
        study: its data give the band of the planned test and the errors of its identification.
        n_sensors: number of sensors.
        aim: "class" for which model class holds; "parameters" for all of the structures, or the
            name of one; or a function for a prediction, given a structure and parameter values
            (B, n_parameters), returning (B,) or (B, q).
        candidates: where sensors may be, labels of degrees of freedom or of sensors, or Candidates;
            the sensors that structures define, else all degrees of freedom, if None.
        fixed: names of candidates that are measured in any case.
        excluded: names of candidates that cannot be.
        configurations: alternatives, names of the study's configurations; all of them if None.
        added_masses: further alternatives, a mass added to each configuration: label of a degree
            of freedom → mass.
        after: a ranking or stored result of the study: the planned test is the next one. Before any
            test, with the prior, if None.
        n_tests: simulated tests of all classes together; the error of a gain falls with its root.
        n_draws: of each class about each test, whose average is the class's evidence for it; if
            None, 200, and more where these leave a check failed.
        seed: of all that is random.
        run: its progress is reported to; nothing else of it is used.

    Raises:
        ValueError: there are fewer candidates than sensors, a candidate, class, parameter or
            configuration does not exist, the aim is the class and there is only one, the result
            is not one of this study, or fewer than 50 tests or draws are asked for.
    """
    for name, number in {"n_tests": n_tests, "n_draws": n_draws}.items():
        if number is not None and number < 50:
            raise ValueError(f"plan: {name} must be at least 50, got {number}")
    known = _known_classes(study, after)
    plans, report = {}, (run or Run()).report
    for name, classes in _alternatives(known, configurations, added_masses or {}).items():
        classes = _with_candidates(classes, candidates)
        _check_aim(classes, aim)
        places = _places(classes[0].candidates, n_sensors, fixed, excluded)
        report(name or study.name, "simulated tests", 0.1)
        for draws in DRAWS if n_draws is None else (n_draws,):
            request = _Planning(classes, n_sensors, aim, *places, n_tests, draws, seed)
            if name in plans and not request.fits:
                break
            plans[name] = request.plan(study.name, name)
            if not plans[name].failed_checks:
                break
        report(name or study.name, "simulated tests", 1.0)
    best = max(plans.values(), key=lambda each: each.best.gain)
    alternatives = {name: each.best for name, each in plans.items()} if len(plans) > 1 else {}
    return replace(best, alternatives=alternatives)


def _known_classes(study: Study, after: Any) -> list[PlannedClass]:
    """The classes with what is known of them; those that are improbable after a test left out."""
    for each in study.model_classes:
        if each.error.is_correlated:
            raise ValueError(
                f"plan: model class {each.name!r} has correlated prediction errors, which need a "
                "pairing; that of a planned test is not known before it"
            )
    if after is None:
        study = study.with_any_pairing()
        weights = dict(study.prior_weights or dict.fromkeys(study.names, 1.0))
    else:
        posteriors: Mapping[str, Posterior] = {each.name: each for each in after.posteriors}
        if not set(posteriors) <= set(study.names):
            study = study.with_any_pairing()
        classes = {model_class.name: model_class for model_class in study.model_classes}
        require_known("plan: the study has no model class", posteriors, classes)
        for name, posterior in posteriors.items():
            if posterior.data_digest != classes[name].data_digest:
                raise ValueError(f"plan: the result of model class {name!r} is of other data")
        weights = {row.name: row.probability for row in after.comparison.classes}
        study = study.only([n for n in weights if weights[n] >= LEAST_PROBABILITY])
    total = sum(weights[name] for name in study.names)
    return [
        PlannedClass(each, each.configurations[0], (), weights[each.name] / total,
                     None if after is None else posteriors[each.name])
        for each in study.model_classes
    ]  # fmt: skip


def _alternatives(
    known: Sequence[PlannedClass], names: Sequence[str] | None, added_masses: Mapping[str, float]
) -> dict[str, list[PlannedClass]]:
    """The classes in each configuration, as it is and with each mass added."""
    tests = {}
    for name in names or known[0].model_class.configuration_names:
        test = name or None
        bare = [replace(each, configuration=each.model_class.configuration(test)) for each in known]
        tests[name or ("no mass added" if added_masses else "")] = bare
        for place, mass in added_masses.items():
            label = f"{mass:g} added at {place}"
            element = AddedMass(mass, ((place, 1.0),), label)
            tests[f"{name}, {label}" if name else label] = [
                each.with_structure(each.structure.with_element(element)) for each in bare
            ]
    return tests


def _with_candidates(
    classes: Sequence[PlannedClass], candidates: Sequence[Candidate | str] | None
) -> list[PlannedClass]:
    """The classes with all candidates on their structures."""
    if candidates is None:
        candidates = _default_candidates(classes)
    places = [Candidate(each, each) if isinstance(each, str) else each for each in candidates]
    require_distinct(places)
    for planned in classes:
        of_class = f"model class {planned.model_class.name!r}: candidate"
        planned.structure.sensor_matrix(terms_of(tuple(places))[0], of_class)
    structures = [each.structure for each in classes]
    drawn = []
    for place in (located(each, structures[0]) for each in places):
        # With coordinates and direction on the first drawing that has it.
        if place.coordinates is None and isinstance(on := place.place, str):
            known = (structure.sensor_location(on) for structure in structures)
            if at := next(filter(None, known), None):
                direction = place.direction or at.direction
                place = replace(place, coordinates=at.position, direction=direction)
        drawn.append(place)
    return [replace(each, candidates=tuple(drawn)).made_accurate() for each in classes]


def _default_candidates(classes: Sequence[PlannedClass]) -> list[str]:
    """Labels that all classes have: of sensors where a structure defines them, else of all."""
    structures = [planned.structure for planned in classes]
    labels: dict[str, None] = {}
    for structure in structures:
        own = [sensor.label for sensor in structure.sensors]
        all_of = [*own, *structure.appendages] if own else structure.degrees_of_freedom
        labels |= dict.fromkeys(all_of)
    if len(labels) > MOST_CANDIDATES:
        labels = dict.fromkeys(classes[0].configuration.data.sensors)

    def has(structure: Structure, label: str) -> bool:
        try:
            return bool(structure.sensor_matrix([label]))
        except ValueError:
            return False

    common = [label for label in labels if all(has(each, label) for each in structures)]
    if not common:
        raise ValueError("plan: the structures have no place in common that a sensor could measure")
    return common


def _places(
    candidates: Sequence[Candidate], n_sensors: int, fixed: Sequence[str], excluded: Sequence[str]
) -> tuple[Sensors, Sensors]:
    """Candidates in every layout, and those that may be."""
    names = [place.name for place in candidates]
    for what, given in (("fixed", fixed), ("excluded", excluded)):
        require_known(f"plan: {what}: no candidate", given, names)
    always = tuple(i for i, name in enumerate(names) if name in fixed)
    free = tuple(i for i, name in enumerate(names) if name not in {*fixed, *excluded})
    if not max(1, len(always)) <= n_sensors <= len(always) + len(free):
        raise ValueError(
            f"plan: a layout of {n_sensors} sensors cannot be had: {len(always)} are fixed, and "
            f"{len(free)} more candidates may be chosen"
        )
    return always, free


def _check_aim(classes: Sequence[PlannedClass], aim: Aim) -> None:
    """Refuse an aim that these classes do not have."""
    if aim == CLASS and len(classes) < 2:
        name = classes[0].model_class.name
        raise ValueError(
            f"plan: the aim 'class' needs two model classes or more, and {name!r} is "
            "alone: classes that differ in their pairing only are one before a test, and "
            "improbable ones are left out after one; choose another aim, such as 'parameters'"
        )
    if isinstance(aim, str) and aim != CLASS:
        names = {p.name for each in classes for p in each.parameters[: each.n_structural]}
        require_known("plan: no aim", [aim], (CLASS, PARAMETERS, *sorted(names)))


def _quantity(planned: PlannedClass, z: FloatArray, aim: Aim) -> FloatArray:
    """What the aim is about, (…, q) at z (…, n_parameters); q is 0 in a class without it."""
    if callable(aim):
        values = aim(planned.structure, planned.structural_values(z.reshape(-1, z.shape[-1])))
        return np.asarray(values, dtype=float).reshape(*z.shape[:-1], -1)
    names = [parameter.name for parameter in planned.parameters[: planned.n_structural]]
    return z[..., [i for i, name in enumerate(names) if aim in (PARAMETERS, name)]]


def _check_variation(before: FloatArray, name: str) -> None:
    """Refuse quantities (B, q) whose covariance is singular: about them information has no end."""
    sds = before.std(axis=0)
    varies = sds > LEAST_VARIATION * np.abs(before).max(axis=0, initial=0.0)
    if not varies.all() or (
        len(sds) > 1 and np.linalg.eigvalsh(np.corrcoef(before, rowvar=False))[0] < LEAST_VARIATION
    ):
        raise ValueError(
            f"plan: the {len(sds)} values that the aim predicts do not vary, or follow from one "
            f"another exactly, in class {name!r}; predict values that do not"
        )


@dataclass(frozen=True, eq=False)
class _Planning:
    """Layouts in one configuration, valued on simulated tests."""

    classes: Sequence[PlannedClass]
    n_sensors: int
    aim: Aim
    fixed: Sensors
    free: Sensors
    n_tests: int
    n_draws: int
    seed: int

    @property
    def fits(self) -> bool:
        """Whether all that is simulated fits into memory."""
        per_draw = sum(c.structure.n_modes for c in self.classes) * len(self.classes[0].candidates)
        return self.n_tests * self.n_draws * per_draw <= MOST_KEPT

    @cached_property
    def _whole(self) -> SimulatedPlan:
        classes, n_tests, n_draws = self.classes, self.n_tests, self.n_draws
        if not self.fits:
            raise ValueError(
                f"plan: {n_tests} tests with {n_draws} draws of {len(classes)} classes at "
                f"{len(classes[0].candidates)} candidates do not fit into memory; take fewer of "
                "one of them"
            )
        layouts = layout_values.served_layouts(self.fixed, self.free, self.n_sensors, self.seed)
        return SimulatedPlan.of(classes, layouts, n_tests, n_draws, self.seed)

    def _gains_of_layouts(self, simulated: SimulatedPlan) -> Callable[[Sensors], Gains]:
        """What a layout gains on simulated tests, computed once for each layout."""
        if self.aim == CLASS:
            return cache(lambda layout: layout_values.class_gains(simulated, layout))
        quantities = []
        for c, (planned, own) in enumerate(zip(simulated.classes, simulated.draws, strict=True)):
            before = _quantity(planned, planned.drawn_before, self.aim)
            _check_variation(before, planned.model_class.name)
            at_draws = _quantity(planned, own.z[simulated.true_class == c], self.aim)
            quantities.append((at_draws, before))
        return cache(lambda layout: layout_values.quantity_gains(simulated, layout, quantities))

    @cached_property
    def _gains(self) -> Callable[[Sensors], Gains]:
        return self._gains_of_layouts(self._whole)

    def _gain(self, layout: Sensors) -> float:
        return self._whole.mean(self._gains(layout).values)[0]

    @cached_property
    def _shapes(self) -> FloatArray:
        """Of the most probable class (n_candidates, n_modes) in the band, before the test."""
        planned = max(self.classes, key=lambda each: each.probability)
        first = planned.posterior is None
        centre = np.zeros(len(planned.parameters)) if first else planned.drawn_before.mean(axis=0)
        modes = planned.modes(centre[None])
        low, high = planned.configuration.data.band_hz
        inside = (modes.frequencies_hz[0] > low) & (modes.frequencies_hz[0] < high)
        return modes.shapes[0][:, inside]

    def _layout(self, sensors: Sensors) -> Layout:
        gains, shapes = self._gains(sensors), self._shapes[list(sensors)]
        between = mac(shapes, shapes)[np.triu_indices(shapes.shape[1], 1)]
        return Layout(
            tuple(self.classes[0].candidates[i].name for i in sensors),
            self.classes[0].configuration.data.band_hz,
            *self._whole.mean(gains.values),
            self._whole.mean(gains.named)[0] if self.aim == CLASS else None,
            float(between.max(initial=0.0)) if len(sensors) > 1 else np.nan,
        )

    def plan(self, study: str, configuration: str) -> Plan:
        """The plan, without alternatives."""
        part = self._whole.part(*N_SEARCHED)
        of_part = self._gains_of_layouts(part)
        search = layout_values.LayoutSearch(
            lambda layout: part.mean(of_part(layout).values)[0], self.fixed, self.free
        )
        habit = layout_values.effective_independence(self._shapes, self.n_sensors, self.fixed)
        numbered = [self.fixed]
        for number in range(max(2, len(self.fixed)), self.n_sensors + 1):
            numbered.append(search.best(number, numbered[-1]))
        # At one sensor no shape is measured: one is as good as another.
        numbered[:1] = [self.fixed or self.free[:1]] if len(self.fixed) < 2 else []
        exhaustive = search.is_exhaustive(self.n_sensors)
        other = numbered[-1] if exhaustive else search.exchanged(habit)
        tried = [layout for layout in search.tried if len(layout) == self.n_sensors]
        some = sorted(tried, key=search.tried.__getitem__)[-N_SHOWN:] or numbered[-1:]
        some.sort(key=self._gain, reverse=True)
        best = numbered[-1] = some[0]
        by_number = tuple(map(self._layout, numbered))
        enough = ENOUGH_OF_THE_GAIN * max(layout.gain for layout in by_number)
        first = self.classes[0]
        measured = first.configuration.data.sensors
        of_data = tuple(i for i, each in enumerate(first.candidates) if each.name in measured)
        compared = {
            "effective independence": habit,
            "sensors of the data": of_data,
            "all candidates": tuple(sorted((*self.fixed, *self.free))),
        }
        p, gains = self._whole.probabilities, self._gains(best)
        bias = self._whole.mean(gains.bias)[0]
        return Plan(
            study=study,
            aim=self.aim if isinstance(self.aim, str) else self.aim.__name__,
            classes={each.model_class.name: each.probability for each in self.classes},
            is_after_a_test=first.posterior is not None,
            configuration=configuration,
            layouts=tuple(map(self._layout, some)),
            compared={what: self._layout(each) for what, each in compared.items() if each},
            alternatives={},
            by_number=by_number,
            knee=min(len(each.sensors) for each in by_number if each.gain >= enough),
            greatest=float(-(p * np.log(p)).sum()) if self.aim == CLASS else None,
            n_tried=len(search.tried),
            is_exhaustive=exhaustive,
            other_start=self._gain(other) - self._gain(best),
            n_tests=len(self._whole.true_class),
            effective_draws=float(np.median(gains.draws)),
            bias=bias,
            failed_checks=tuple(_failed_checks(gains.draws, bias)),
            candidates=first.candidates,
            geometry=first.structure.drawing()[0],
        )


def _failed_checks(draws: FloatArray, bias: float) -> Iterator[str]:
    thin = float((draws < LEAST_DRAWS).mean())
    if thin > MOST_THIN:
        yield (
            f"in {100.0 * thin:.0f} % of the simulated tests evidences rest on fewer than "
            f"{LEAST_DRAWS:g} effective draws; simulate with more draws"
        )
    if not abs(bias) <= MOST_BIAS:
        yield f"few draws bias the gain by about {bias:+.3f} nats; simulate with more draws"
