"""The Liverpool frame with and without its blade: the data, the hypotheses and their ranking."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from conftest import kept_study
from importance import log_evidence

import bayes_ssi as bs

MODES = {
    "bare": [3.89, 3.94, 11.38, 11.46, 17.15, 17.54],  # Hz
    "bare, torsion": [6.96, 19.89, 30.41],
    "with blade": [3.65, 3.90, 3.95, 11.13, 11.31, 16.93, 17.18, 17.73],
    "with blade, torsion": [6.89, 19.56, 29.80],
}
# Log evidences by full sampling where bending and torsion are one test, and about where the
# posterior lies: mean, standard deviation.
SAMPLED = {"x and y": -3.52, "y": -7.83, "x": -7.91, "mass only": -12.20}
POSTERIOR = {
    "k x": (1.26, 0.03), "k y": (1.28, 0.03), "k torsion": (1.21, 0.024),
    "storey 1 / 2": (0.70, 0.02), "storey 3 / 2": (0.91, 0.03), "roof mass": (0.032, 0.019),
    "blade mass x": (0.0093, 0.0045), "blade frequency x": (3.72, 0.05),
    "blade mass y": (0.017, 0.010), "blade frequency y": (17.2, 0.3),
    "frequency_cov": (0.0088, 0.002),
}  # fmt: skip

study = functools.partial(kept_study, "liverpool_frame")


def model_class(name):
    return study().only([name]).model_classes[0]


def test_the_modes_that_were_identified():
    for candidate in study().model_classes:
        assert candidate.configuration_names == tuple(MODES)
        for test in candidate.configurations:
            np.testing.assert_array_equal(test.data.frequencies_hz, MODES[test.name])
            assert not test.data.sensors
        # The modes that a class leaves out are those that move the blade most.
        with_blade = candidate.configuration("with blade")
        spurious = set(with_blade.data.labels) - set(with_blade.pairing)
        left_out = {"x and y": set(), "x": {"Ay"}, "y": {"Ax"}, "mass only": {"Ax", "Ay"}}
        assert spurious == left_out[candidate.name]
    study().require_same_data()


def test_the_bare_frame_is_the_same_in_all_classes():
    assert len({id(c.configurations[0].structure) for c in study().model_classes}) == 1
    names = [set(c.parameter_names) for c in study().model_classes]
    assert names[0] < names[1] < names[3]
    assert names[3] - names[0] == {"blade mass x", "blade frequency x", "blade mass y",
                                   "blade frequency y"}  # fmt: skip


@pytest.mark.parametrize("name", SAMPLED)
def test_evidence_is_that_of_importance_sampling(name):
    """Two more tests in which no other mode is spurious have a probability of e^-0.1 each."""
    estimate, error = log_evidence(model_class(name), POSTERIOR)
    assert error < 0.06
    assert estimate == pytest.approx(SAMPLED[name] - 0.2, abs=0.03 + 4.0 * error)


def test_bending_and_torsion_do_not_couple():
    """One building that moves in x, y and torsion has the modes of both structures."""
    candidate = model_class("x and y")
    values = candidate.values(np.random.default_rng(0).standard_normal((5, 11)))
    modes = {
        test.name: likelihood.modes(own).frequencies_hz
        for test, likelihood, own in candidate.parts(values)
    }
    bending = candidate.configuration("with blade").structure
    twisting = candidate.configuration("with blade, torsion").structure
    whole = replace(bending, torsional_stiffnesses=twisting.stiffnesses)
    of_whole = whole.modes(
        values[:, [candidate.parameter_names.index(p.name) for p in whole.parameters]]
    )
    n = bending.n_modes - 3  # three are those of torsion, locked
    assert (modes["with blade"][:, n:] > 5.0 * 35.0).all()
    separate = np.concatenate([modes["with blade"][:, :n], modes["with blade, torsion"]], axis=1)
    np.testing.assert_allclose(of_whole.frequencies_hz, np.sort(separate, axis=1), rtol=1e-9)


def test_a_blade_that_vibrates_in_both_directions_fits_both_tests():
    fit = bs.calibrate(model_class("x and y"), 0.0, n_starts=4)
    assert fit.best.objective < 0.007
    values = dict(zip(fit.parameter_names, fit.best.values, strict=True))
    assert values["blade frequency x"] == pytest.approx(3.7, abs=0.15)
    assert values["blade frequency y"] == pytest.approx(17.2, abs=0.6)
    assert 0.002 < values["blade mass x"] < 0.02
    assert 0.002 < values["blade mass y"] < 0.05
    assert [mode.configuration for mode in fit.best.modes] == [
        name for name, modes in MODES.items() for _ in modes
    ]
