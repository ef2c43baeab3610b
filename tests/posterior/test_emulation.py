"""Slow structures sampled by emulators of their modes: evidence, cost, and when it is not safe."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from delegating import DelegatingStructure

import bayes_ssi as bs
from bayes_ssi.inference.posterior_sampling.refinement import RefinementSettings
from bayes_ssi.inference.posterior_sampling.sample import with_emulated_structures
from bayes_ssi.inference.workers.cache import POINTS_TO_CHECK
from bayes_ssi.results.predictions.posterior_draws import thinned_draws
from bayes_ssi.studies.ranking.diagnosis import diagnose

ECONOMICAL = bs.SamplingSettings(log_evidence_error=0.05, economical=True)
# Of the structure itself, well beyond what emulators are asked for.
FINER = bs.SamplingSettings(log_evidence_error=0.02, searches=2, effective_sample_size=1000)
ONE_ROUND = RefinementSettings(most_rounds=1)
STOREYS = 3
TRUTH = (1.1, 0.9, 1.05)


class BlackBox(DelegatingStructure):
    """A shear building that shows the lowest modes at two floors, and counts its solutions."""

    def __init__(self, building, n_modes=2):
        super().__init__(building)
        self.n_asked, self._n_modes = 0, n_modes

    @property
    def degrees_of_freedom(self):
        return ("floor 1", "floor 3")

    @property
    def n_modes(self):
        return self._n_modes

    def modes(self, values):
        self.n_asked += len(values)
        frequencies, shapes = self.structure.modes(values)
        return bs.Modes(frequencies[:, : self.n_modes], shapes[:, [0, 2], : self.n_modes])


class FailsWhereSoft(BlackBox):
    """The program stops where the second storey is soft, at some of the posterior."""

    def modes(self, values):
        self.n_asked += len(values)
        if (values[:, 1] < 0.8).any():
            raise ArithmeticError("no equilibrium")
        return super().modes(values)


class Jumps(BlackBox):
    """The first storey stiffens within the posterior, and changes all modes by much."""

    def modes(self, values):
        values = np.array(values)
        values[:, 2] *= np.where(values[:, 0] > 1.1, 1.3, 1.0)
        return super().modes(values)


def of_class(structure, name="black box", **options):
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(1, STOREYS + 1)]
    building = bs.ShearBuilding((1.0,) * STOREYS, [4000.0 * k for k in factors])
    frequencies, shapes = building.modes(np.array([TRUTH]))
    band = (0.0, float(frequencies[0, 1:].mean()))
    measured = frequencies[0, :2], shapes[0, [0, 2], :2]
    data = bs.ModalData.from_arrays(*measured, band, ("floor 1", "floor 3"))
    settings = {"pairing": {"1": 1, "2": 2}, **options}
    return bs.ModelClass(name, structure(building), data, bs.ErrorModel(0.02, 0.1), **settings)


@functools.cache
def sampled_economically(any_pairing=False):
    """A class with a black box, which has counted its solutions, and its posterior."""
    candidate = of_class(BlackBox, **({"pairing": "any"} if any_pairing else {}))
    return candidate, bs.sample(candidate, settings=ECONOMICAL)


@pytest.mark.parametrize("any_pairing", [False, True])
def test_the_evidence_is_that_of_the_structure_itself_in_some_hundred_solutions(any_pairing):
    candidate, result = sampled_economically(any_pairing)
    exact = bs.sample(of_class(BlackBox, pairing=candidate.pairing), settings=FINER)
    # The check of the class before it is sampled counts among the solutions.
    assert candidate.structure.n_asked == result.n_evaluations <= 150
    assert result.failed_checks == ()
    assert result.evidence.error <= 0.05
    error = math.hypot(result.evidence.error, exact.evidence.error)
    assert result.evidence.log_evidence == pytest.approx(exact.evidence.log_evidence, abs=3 * error)
    for row, other in zip(result.summary, exact.summary, strict=True):
        error = math.hypot(row.mean_error, other.mean_error)
        # The draws themselves are not corrected: a twentieth of their spread is allowed for.
        assert row.mean == pytest.approx(other.mean, abs=4.0 * error + 0.05 * other.sd)


def test_runs_of_different_seeds_begin_with_different_solutions():
    """Else they would share the errors of the emulator, which their scatter then hides."""
    first, again, other = (
        with_emulated_structures(of_class(BlackBox), seed, None, None).structure.emulator.x
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    # Only the prior's median is in both.
    assert sum((other == row).all(axis=1).any() for row in first) == 1


def test_points_that_fail_have_no_likelihood_and_are_named():
    """Over two seeds: one claims too small an error in one of twenty."""
    exact = bs.sample(of_class(FailsWhereSoft), settings=FINER).evidence
    results = [
        bs.sample(of_class(FailsWhereSoft), seed, ECONOMICAL, refinement=ONE_ROUND)
        for seed in range(2)
    ]
    evidences = [result.evidence for result in results]
    error = math.hypot(exact.error, math.hypot(*(each.error for each in evidences)) / 2)
    mean = np.mean([each.log_evidence for each in evidences])
    assert mean == pytest.approx(exact.log_evidence, abs=3 * error)
    for result in results:
        assert any("no equilibrium" in check for check in result.failed_checks)


def test_a_model_that_jumps_within_the_posterior_is_right_or_flagged():
    exact = bs.sample(of_class(Jumps), settings=FINER)
    result = bs.sample(of_class(Jumps), settings=ECONOMICAL, refinement=ONE_ROUND)
    off = abs(result.evidence.log_evidence - exact.evidence.log_evidence)
    assert off <= 3.0 * math.hypot(result.evidence.error, exact.evidence.error) or (
        result.failed_checks
    )
    assert result.n_evaluations <= 500


def test_predictions_take_the_structure_itself(tmp_path):
    """Stored frequencies are emulated, and the structure's are not quite the same."""
    candidate = of_class(BlackBox)
    ranking = bs.rank(bs.Study("s", [candidate]), settings=ECONOMICAL)
    bs.save_result(ranking, tmp_path / "r")
    (stored,) = bs.load_result(tmp_path / "r").posteriors
    assert 1e-9 < stored.frequency_error == ranking.posteriors[0].frequency_error < 0.02
    assert thinned_draws(stored, candidate, n_draws=200).structure is candidate.structure
    other = replace(candidate.structure.structure, masses=(1.5, 1.5, 1.5))
    with pytest.raises(ValueError, match="is not the one that was sampled"):
        thinned_draws(stored, replace(candidate, name="black box", structure=BlackBox(other)))


def test_a_mistake_in_the_data_is_named_by_the_emulator():
    """Two channels exchanged; every repair that is fitted is solved once."""
    candidate = of_class(BlackBox)
    test = candidate.configurations[0]
    modes = tuple(replace(mode, shape=mode.shape[::-1]) for mode in test.data.modes)
    exchanged = replace(test, data=replace(test.data, modes=modes))
    candidate = replace(candidate, configurations=(exchanged,), error=bs.ErrorModel(0.02, 0.05))
    posterior = bs.sample(candidate, settings=ECONOMICAL)
    candidate.structure.n_asked = 0
    hint, *_ = diagnose(candidate, posterior)
    assert "channels 'floor 1' and 'floor 3' seem to be exchanged" in hint.mistake
    assert candidate.structure.n_asked < 20


def test_structures_with_small_matrices_are_sampled_as_they_are(tiny_study):
    candidate = tiny_study.model_classes[0]
    one, other = (
        bs.sample(candidate, settings=bs.SamplingSettings(0.05, economical=economical))
        for economical in (True, False)
    )
    np.testing.assert_array_equal(one.draws, other.draws)


def test_an_interrupted_run_solves_nothing_twice(tmp_path):
    """Ended after some batches, it is resumed to the same result."""

    class Interrupted(BlackBox):
        left = math.inf

        def modes(self, values):
            self.left -= len(values)
            if self.left < 0:
                raise KeyboardInterrupt
            return super().modes(values)

    _, whole = sampled_economically()
    candidate, run = of_class(Interrupted), bs.Run(checkpoint=tmp_path / "c")
    candidate.structure.left = 35
    with pytest.raises(KeyboardInterrupt):
        bs.sample(candidate, settings=ECONOMICAL, run=run)
    candidate.structure.left = math.inf
    resumed = bs.sample(candidate, settings=ECONOMICAL, run=run)
    # But for the first ones, to see that the model is still the same.
    assert candidate.structure.n_asked - POINTS_TO_CHECK == whole.n_evaluations
    assert resumed.n_evaluations == whole.n_evaluations
    np.testing.assert_array_equal(resumed.draws, whole.draws)
    assert resumed.evidence == whole.evidence


def test_workers_share_the_solutions_and_change_nothing(copied_workers):
    _, one = sampled_economically()
    two = bs.sample(of_class(BlackBox), settings=ECONOMICAL, run=bs.Run(copied_workers))
    np.testing.assert_array_equal(one.draws, two.draws)
    assert one.evidence == two.evidence
