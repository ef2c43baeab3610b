"""For tests of searches: places, settings, and evidences that were not sampled."""

from types import SimpleNamespace

import numpy as np

import bayes_ssi as bs
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.studies.appendages.candidates import InfillPlace, PendulumPlace, places_of
from bayes_ssi.studies.search.approximate_evidence import Screened
from bayes_ssi.studies.search.findings import Finding

# As coarse as passes its own checks: where one fails, all is sampled again, with particles.
COARSE = bs.SamplingSettings(
    log_evidence_error=1.0, particles=48, searches=1, r_hat=2.0, effective_sample_size=400
)
# One appendage at most; all sampled.
ONE = bs.SearchSettings(number_weights=(1.0, 1.0), most_unsampled=0.0)
ALL = bs.SearchSettings(most_unsampled=0.0)
PENDULUM_1, PENDULUM_3 = (PendulumPlace(bs.Candidate(str(i), i)) for i in (1, 3))
INFILL_12, INFILL_01 = (InfillPlace(bs.Candidate(f"{i}-{i + 1}", i, to=i + 1)) for i in (1, 0))


def exact_modes(structure, sensors, band_hz, n=None, values=None, **sizes):
    """Data of the lowest ``n`` modes, without errors, at parameter values (n_parameters,).

    Of all modes, at the medians of the priors, unless these are given; ``sizes`` are of errors.
    """
    values = structure.prior_medians() if values is None else np.array([values])
    frequencies, shapes = structure.modes(values)
    at_sensors = structure.sensor_matrix(sensors).apply(shapes)[0, :, :n]
    return bs.ModalData.from_arrays(frequencies[0, :n], at_sensors, band_hz, sensors, **sizes)


def places_of_building(structure):
    """What a search tries on a structure with floors."""
    return places_of(structure.candidates(()))


def by_count(*log_evidences):
    """Log evidence of a class by its number of appendages, and a little by its name."""
    return lambda model_class: (
        log_evidences[len(model_class.structure.appendages)]
        + 0.01 * sum(model_class.name.encode()) / 1000
    )


def screened(model_class, log_evidence, error=0.0):
    """A hypothesis with this approximate evidence, and draws of its prior."""
    names = model_class.parameter_names
    d = len(names)
    z = np.random.default_rng(0).standard_normal((100, d))
    wide = StudentMixture(np.ones(1), np.zeros((1, d)), np.eye(d)[None], np.full(1, 5.0))
    return Screened(names, log_evidence, error, log_evidence, 1, z[:1], z, np.full(100, 0.01), wide)


def place_record(place, probability):
    """A place with this probability of an appendage, of an arbitrary mass and frequency."""
    amounts = {"mass": (0.04, 0.05, 0.06), "frequency_hz": (1.0, 2.0, 3.0)}
    return Finding(place, probability, amounts)


def search_of(places, geometry=None):
    """What drawings take of a search that found these places."""
    ordered = tuple(sorted(places, key=lambda each: -each.probability))
    found = {"places": tuple(places), "places_by_probability": ordered, "geometry": geometry}
    return SimpleNamespace(**found, a_feature="an appendage")


def places_in_space(probabilities, directions=(None,)):
    """Candidates along a line in space, a direction each, with these probabilities."""
    records = []
    for i, probability in enumerate(probabilities):
        direction = directions[i % len(directions)]
        at = (float(i // len(directions)), 0.0, 2.0)
        candidate = bs.Candidate(f"p{i}", f"p{i}", coordinates=at, direction=direction)
        records.append(place_record(PendulumPlace(candidate), probability))
    return records
