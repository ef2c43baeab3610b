"""Which hidden appendage would make the answer wrong, without a word of it?

The structure at the medians of its priors carries one appendage, of every place, mass and frequency
in turn. Its modes at the sensors, without errors, are ranked by an analyst who knows of none. It
does not matter to a stiffness, or he is warned, or he takes it for another stiffness without a
failed check or a remark. The table has every mode in the band that the sensors see, or lacks one of
the two that the appendage makes of one.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import Displayed, columns
from bayes_ssi.foundations.summaries import weighted_quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.studies.appendages.baselines import (
    Baselines,
    choose_baselines,
    frequency_name,
    frequency_prior,
    in_model_name,
    mass_name,
)
from bayes_ssi.studies.appendages.candidates import VISIBLE_SHARE
from bayes_ssi.studies.appendages.unmodelled import appendage_checks
from bayes_ssi.studies.ranking.checks import ranked
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.approximate_evidence import QUICK, each_in_workers, screen

WRONG = 0.1  # relative error of a stiffness
NOT_NEAR_WRONG = 0.08  # of a quick look's median, below which nothing is sampled
MASSES = (0.03, 0.1, 0.3)  # that vibrate, over the scale of masses
BAND_WIDENED = 1.25
MOST_TRIED = 20  # blind spots in which a remedy is tried, evenly among all
MOST_SENSORS = 12  # further ones, each of which is tried
ROUGH = SamplingSettings(log_evidence_error=0.1)


@dataclass(frozen=True)
class HiddenCase:
    """One appendage that the analyst does not know of, and what he makes of its modes.

    Attributes:
        place: of the appendage, by the name that a search gives it.
        mass: that vibrates, in the structure's unit, and ``frequency_hz``, its own.
        missed: number, from 1, of the mode with it that is not in the table; 0 if all are.
        parameter: the stiffness, or other parameter of the structure, that is most wrong, and
            ``error``, by how much, relative.
        warning: the failed check or remark that the analyst sees, where it is wrong; the first.
    """

    place: str
    mass: float
    frequency_hz: float
    missed: int
    parameter: str = ""
    error: float = 0.0
    warning: str = ""

    @property
    def is_blind(self) -> bool:
        """Whether he is wrong and nothing is said of it."""
        return abs(self.error) > WRONG and not self.warning


@dataclass(frozen=True, eq=False, repr=False)
class BlindSpots(Displayed):
    """The map of hidden appendages over place, mass and frequency.

    Attributes:
        model_class: name of the analyst's.
        cases: every appendage, with all modes and with one missed.
        frequencies_hz: of the structure without it.
        n_tried: blind spots in which remedies were tried, and ``remedies``, how many of these each
            removes, the one that removes most first.
    """

    model_class: str
    cases: tuple[HiddenCase, ...]
    frequencies_hz: tuple[float, ...]
    n_tried: int
    remedies: Mapping[str, int]

    @property
    def blind(self) -> tuple[HiddenCase, ...]:
        """The cases that mislead silently."""
        return tuple(case for case in self.cases if case.is_blind)

    def _line(self) -> str:
        return f"{self.model_class!r}: {len(self.blind)} of {len(self.cases)} cases are blind spots"

    def _rows(self) -> list[dict[str, Any]]:
        return [columns(case) for case in self.cases]


@checked
def blind_spots(
    study: Study,
    *,
    candidates: Sequence[Candidate] | None = None,
    n_frequencies: int = 12,
    run: Run | None = None,
) -> BlindSpots:
    """Map where a hidden appendage would be taken for a stiffness error above 10 %, unsaid.

    Args:
        study: its only class without an appendage, whatever the pairing, is the analyst's; its data
            give the sensors, the band and the errors of identification alone.
        candidates: where appendages may hang, as for a search.
        n_frequencies: of appendages, equally apart in logarithm from half the lowest identified
            one to a quarter above the band.
        run: workers, and progress.

    Raises:
        ValueError: nothing can be hung on a class, there are several, it has several tests, or a
            prior median is zero.
    """
    run = run or Run()
    baselines = choose_baselines(study, candidates=candidates)
    if len(baselines.classes) > 1:
        names = ", ".join(repr(each.name) for each in baselines.classes)
        raise ValueError(f"blind spots: are those of one model class; choose one of {names}")
    (best,) = baselines.classes
    for each in best.structural_parameters:
        if each.prior.quantile(0.5) == 0.0:
            raise ValueError(
                f"blind spots: the prior median of {each.name!r} is zero, and relative errors are "
                "not defined"
            )
    test, structure = _Test(best.data.sensors, best.data.band_hz), best.structure
    others = [each for each in structure.degrees_of_freedom if each not in test.sensors]
    others = others if len(others) <= MOST_SENSORS else []
    own = structure.modes(structure.prior_medians()).frequencies_hz[0]
    cases = list(_cases(baselines, test, others, own, n_frequencies))

    def all_judged(what: str, some: Sequence[_Case], test: _Test) -> list[HiddenCase]:
        with run.working():
            judge = partial(_judged, best, test)
            return each_in_workers(judge, some, run, (what, f"{len(some)} tables"))

    judged = all_judged(best.name, cases, test)
    blind = [case for case, each in zip(cases, judged, strict=True) if each.is_blind]
    tried = blind[:: max(1, -(-len(blind) // MOST_TRIED))]
    remedies = {
        name: sum(not each.is_blind for each in all_judged(name, tried, other))
        for name, other in test.improved(others)
        if tried
    }
    ordered = dict(Counter(remedies).most_common())
    return BlindSpots(best.name, tuple(judged), tuple(own.tolist()), len(tried), ordered)


class _Test(NamedTuple):
    sensors: tuple[str, ...]
    band_hz: tuple[float, float]

    def improved(self, others: Sequence[str]) -> "Iterator[tuple[str, _Test]]":
        """By what is improved: a wider band, or a further sensor."""
        low, high = self.band_hz
        wider = (low, BAND_WIDENED**2 * high)  # above all appendages
        yield f"a band to {wider[1]:.3g} Hz", self._replace(band_hz=wider)
        for each in others:
            yield f"a sensor at {each}", self._replace(sensors=(*self.sensors, each))


class _Real(NamedTuple):
    """The modes of the structure with an appendage."""

    frequencies_hz: FloatArray  # (m,)
    moved: Mapping[str, FloatArray]  # place that a test may measure → its motion (m,)

    def shapes(self, test: _Test) -> FloatArray:
        """At the sensors (n_sensors, m)."""
        rows = [self.moved[each] for each in test.sensors]
        return np.reshape(rows, (-1, len(self.frequencies_hz)))

    def seen(self, test: _Test) -> list[int]:
        """Numbers of the modes in the band that the sensors see, from 1."""
        low, high = test.band_hz
        inside = (self.frequencies_hz > low) & (self.frequencies_hz < high)
        most = np.abs(self.shapes(test)).max(axis=0, initial=0.0)
        inside &= most >= VISIBLE_SHARE * most.max()
        return [int(number) for number in np.flatnonzero(inside) + 1]

    def pair(self, own: int, test: _Test) -> list[int]:
        """Those that the test sees of the two modes next to one of the structure, from 0."""
        return [number for number in self.seen(test) if number in (own + 1, own + 2)]

    def table(self, test: _Test, missed: int, errors: Mapping[str, float | None]) -> ModalData:
        """What is identified of them, without errors."""
        hz = self.frequencies_hz.tolist()
        shapes: Any = self.shapes(test).T if test.sensors else [None] * len(hz)
        numbers = [number for number in self.seen(test) if number != missed]
        modes = [IdentifiedMode(str(n), hz[n - 1], shapes[n - 1], **errors) for n in numbers]
        return ModalData(tuple(modes), test.band_hz, test.sensors)


_Case = tuple[HiddenCase, _Real]


def _cases(
    baselines: Baselines, test: _Test, others: Sequence[str], own: FloatArray, n_frequencies: int
) -> Iterator[_Case]:
    """Every appendage and mode missed; ``own`` are frequencies of the structure without any."""
    (best,) = baselines.classes
    lowest, _ = frequency_prior(best, baselines.tests(best), baselines.options).support
    frequencies = np.geomspace(lowest, BAND_WIDENED * test.band_hz[1], n_frequencies)
    measured = [*test.sensors, *others]
    for place in baselines.appendages(best.name):
        structure = baselines.hypothesis(best, (place,), place.name).structure
        matrix, names = structure.sensor_matrix(measured), [p.name for p in structure.parameters]
        medians = dict(zip(names, structure.prior_medians()[0], strict=True))
        medians[in_model_name(place)] = 0.0  # extra, but for an element given as mass
        for ratio, hz in product(MASSES, frequencies.tolist()):
            values = medians | {mass_name(place): ratio, frequency_name(place): hz}
            modes = structure.modes(np.array([[values[name] for name in names]]))
            moved = dict(zip(measured, matrix.apply(modes.shapes)[0], strict=True))
            real = _Real(modes.frequencies_hz[0], moved)
            mass = ratio * baselines.scales[best.name].mass
            for missed in (0, *real.pair(int(np.abs(np.log(own / hz)).argmin()), test)):
                yield HiddenCase(place.name, mass, hz, missed), real


def _judged(best: ModelClass, test: _Test, case: _Case) -> HiddenCase:
    """What an analyst with the class makes of a case, with the errors of identification stated."""
    hidden, real = case
    errors = {}
    for name in ("frequency_cov", "shape_sd"):
        stated = [size for mode in best.data.modes if (size := getattr(mode, name)) is not None]
        errors[name] = float(np.sqrt(np.square(stated).mean())) if stated else None
    data = real.table(test, hidden.missed, errors)
    (configuration,) = best.configurations
    made = replace(best, configurations=(replace(configuration, data=data, pairing="any"),))
    quick = screen((made, None), 0, QUICK)
    values = made.values(quick.z)
    columns_of = zip(made.parameter_names, values.T, strict=True)
    medians = {name: weighted_quantiles(x, quick.weights)[1] for name, x in columns_of}
    name, error = _most_wrong(made, medians)
    if abs(error) > NOT_NEAR_WRONG:
        study = Study(best.name, [made])
        posteriors = sample_all(study.model_classes, 0, ROUGH, Run())
        ranking = ranked(study, posteriors, 0, ROUGH, Run())
        comparison = ranking.comparison.with_further(appendage_checks(ranking, Run()))
        name, error = _most_wrong(made, {row.name: row.median for row in posteriors[0].summary})
        if abs(error) > WRONG:
            said = (*comparison.failed_checks, comparison.hidden_appendage)
            return replace(hidden, parameter=name, error=error, warning=said[0])
    return replace(hidden, parameter=name, error=error)


def _most_wrong(model_class: ModelClass, medians: Mapping[str, float]) -> tuple[str, float]:
    """The structure's parameter that is furthest from its true value, the median of its prior."""
    own = model_class.structural_parameters
    errors = {each.name: medians[each.name] / each.prior.quantile(0.5) - 1.0 for each in own}
    return max(errors.items(), key=lambda each: abs(each[1]))
