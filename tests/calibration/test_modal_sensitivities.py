"""Sensitivities of modes: against those of the eigenvalue problem, and which are proposed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import MODEL_CLASSES, assert_refused, multiplier
from searches import exact_modes

import bayes_ssi as bs
from bayes_ssi.inference.calibration.least_squares import NothingToCalibrateError

N = 3


def model_class(names=("k1", "k2", "k3", "m1"), pairing=None, **errors):
    """Three storeys, whose parameters are stiffnesses and masses; data are its own modes."""

    def times(name):
        return multiplier(name) if name in names else 1.0

    masses = [times(f"m{i}") for i in range(1, N + 1)]
    structure = bs.ShearBuilding(masses, [200.0 * times(f"k{i}") for i in range(1, N + 1)])
    data = exact_modes(structure, structure.degrees_of_freedom, (0.0, 6.0))
    error = bs.ErrorModel(**({"frequency_cov": 0.01, "shape_sd": 0.05} | errors))
    pairing = pairing or {str(i): i for i in range(1, N + 1)}
    return bs.ModelClass("frame", structure, data, error, pairing=pairing)


def test_frequencies_change_as_energies_say():
    """∂ ln f / ∂ ln k_j is half the share of storey j in the strain energy, and so for masses."""
    found = bs.modal_sensitivities(model_class(("k1", "k2", "k3", "m1", "m2", "m3")))
    _, shapes = model_class().structure.modes(model_class().structure.prior_medians())
    drifts = np.diff(shapes[0], axis=0, prepend=0.0)
    strain = drifts**2 / (drifts**2).sum(0)
    kinetic = shapes[0] ** 2 / (shapes[0] ** 2).sum(0)
    expected = {f"k{i + 1}": 0.5 * strain[i] for i in range(N)}
    expected |= {f"m{i + 1}": -0.5 * kinetic[i] for i in range(N)}
    for name, column in zip(found.parameters, found.of_frequencies.T, strict=True):
        np.testing.assert_allclose(column, expected[name], atol=1e-7)
    assert found.modes == ("1", "2", "3")


def test_shapes_change_as_perturbation_theory_says():
    """∂φ_i = Σ_j φ_j (φ_jᵀ ∂K φ_i) / (λ_i - λ_j), without what is along φ_i."""
    found = bs.modal_sensitivities(model_class())
    structure = model_class().structure
    frequencies, shapes = structure.modes(structure.prior_medians())
    squares, vectors = (2.0 * np.pi * frequencies[0]) ** 2, shapes[0]
    change = np.zeros((N, N))
    change[0, 0] = 200.0  # of the first storey, by ln k1
    for i in range(N):
        off = sum(
            vectors[:, j] * (vectors[:, j] @ change @ vectors[:, i]) / (squares[i] - squares[j])
            for j in range(N)
            if j != i
        )
        unit = vectors[:, i] / np.linalg.norm(vectors[:, i])
        off = off / np.linalg.norm(vectors[:, i])
        length = np.linalg.norm(off - unit * (unit @ off))
        assert found.of_shapes[i, found.parameters.index("k1")] == pytest.approx(length, rel=1e-6)


def test_parameters_that_scale_alike_are_not_proposed_together():
    """With frequencies alone, all stiffnesses and all masses say one thing twice."""
    names = ("k1", "k2", "k3", "m1", "m2", "m3")
    whole = model_class(names)
    found = bs.modal_sensitivities(replace(whole, data=whole.data.without_shapes()))
    assert len(found.proposed) == 3  # of three frequencies
    assert found.signals[3:] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert sorted(found.order) == sorted(names)
    assert bs.modal_sensitivities(model_class(frequency_cov=1.0, shape_sd=1.0)).proposed == ()


def test_at_other_medians_and_what_is_refused():
    at = bs.modal_sensitivities(replace(model_class(), priors={"k1": bs.LogNormal(4.0, 0.3)}))
    assert at.of_frequencies[0, 0] < bs.modal_sensitivities(model_class()).of_frequencies[0, 0]
    zero = replace(model_class(), priors={"k2": bs.Normal(0.0, 0.1)})
    assert_refused("the prior median of 'k2' is zero", bs.modal_sensitivities, zero)
    with pytest.raises(NothingToCalibrateError, match="its pairing is 'any'"):
        bs.modal_sensitivities(model_class(pairing="any"))


@pytest.mark.parametrize("with_shapes", [True, False], ids=["shapes", "frequencies alone"])
def test_a_test_of_which_no_mode_is_paired_adds_nothing(with_shapes):
    one = model_class()
    data = one.data if with_shapes else one.data.without_shapes()
    alone, nothing = (
        bs.Configuration(name, one.structure, data, pairing=pairing)
        for name, pairing in (("a", one.pairing), ("b", {}))
    )
    whole = bs.modal_sensitivities(one)
    for tests in ([alone], [alone, nothing], [nothing, alone]):
        found = bs.modal_sensitivities(bs.ModelClass("x", configurations=tests, error=one.error))
        assert found.modes == ("a: 1", "a: 2", "a: 3")
        np.testing.assert_array_equal(found.of_frequencies, whole.of_frequencies)
        np.testing.assert_array_equal(found.of_shapes, whole.of_shapes if with_shapes else 0.0)


def test_the_command(run):
    result = run("sensitivities", MODEL_CLASSES / "shear_building.py", "--class", "1-a,3", "--json")
    assert result.exit_code == 0, result.output
    record = json.loads(result.stdout)["sensitivities"]
    assert [each["name"] for each in record] == ["1-a", "3"]
    assert record[1]["parameters"] == ["k1", "k2", "k3", "ks"]
