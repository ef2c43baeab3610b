"""Spectral matrices by sine tapers, and the model's derivatives, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.records.bayesian_fft import allowed_whiteness
from bayes_ssi.records.observed_curvature import observed_curvature
from bayes_ssi.records.scoring import WeakPrior, most_probable
from bayes_ssi.records.spectra import Spectra, lines_of, spectra
from bayes_ssi.records.spectral_derivatives import derivatives, gain_of_mode
from bayes_ssi.records.spectral_model import SpectralModel, covariances, misfit

Q = [0, 1, 2]


def white_record(rng, n_samples=600, rate=10.0):
    return bs.Record(rng.standard_normal((2, n_samples)), rate, ("a", "b"), "acceleration", "m/s2")


def test_white_noise_has_its_density_and_no_more_information_than_its_lines():
    """The mean over a band is the variance over the rate; its scatter says what blocks count."""
    rng = np.random.default_rng(1)
    means = []
    for _ in range(500):
        lines = lines_of(white_record(rng), (1.0, 4.0), 0.02)
        data = spectra(lines)
        diagonal = data.matrices[:, 0, 0].real
        means.append((lines.n_tapers * diagonal).sum() / lines.n_tapers.sum())
        assert data.weights.sum() < lines.n_tapers.sum() <= 180
    scatter = 0.1 / np.sqrt(data.weights.sum())
    assert np.mean(means) == pytest.approx(0.1, abs=4 * scatter / np.sqrt(500))
    # A standard deviation from 500 has an error of 3.2 %; that of plain lines would be 11 % less.
    assert np.std(means) == pytest.approx(scatter * np.sqrt(means_inflation(lines, data)), rel=0.1)


def means_inflation(lines, data):
    """Variance of the mean weighted by lines over that weighted by information."""
    n, w = lines.n_tapers, data.weights
    return (n**2 / w).sum() / n.sum() ** 2 * w.sum()


def test_the_whiteness_of_few_tapers_scatters_as_allowed():
    """Of 50 blocks of three tapers and four sensors, 2000 times; scatters are known to 2 %."""
    rng = np.random.default_rng(4)
    vectors = rng.standard_normal((2000 * 50, 4, 3, 2)) @ np.sqrt([0.5, -0.5 + 0j])
    matrices = vectors @ vectors.conj().swapaxes(1, 2) / 3.0
    squares = 3.0 * (np.abs(matrices - np.eye(4)) ** 2).sum((1, 2)) / 16.0
    whiteness = squares.reshape(2000, 50).mean(1)
    assert whiteness.mean() == pytest.approx(1.0, abs=4 * whiteness.std() / np.sqrt(2000))
    allowed = allowed_whiteness(np.full(50, 3), 4, 0)
    assert allowed == pytest.approx(1.1 + 3.0 * whiteness.std(), rel=0.06)


def test_what_the_model_says_of_differences_between_lines_is_no_error():
    """Two sensors measure one white process, one of them late by five samples, and their noise.

    The phase turns by 36 to 144 degrees over a block, whose average is no matrix of rank one any
    more: half a percent of the power or more seems incoherent, where the noise is 0.09 %.
    """
    rng = np.random.default_rng(2)
    common = rng.standard_normal(4005)
    samples = np.array([common[5:], common[:-5]]) + 0.03 * rng.standard_normal((2, 4000))
    record = bs.Record(samples, 10.0, ("a", "b"), "acceleration", "m/s2")
    lines = lines_of(record, (1.0, 4.0), 0.2)

    def model(frequencies):
        late = np.exp(-2j * np.pi * frequencies * 0.5)
        direction = np.stack([np.ones_like(late), late], axis=-1)
        coherent = direction[:, :, None] * direction[:, None, :].conj()
        return 0.1 * (coherent + 9e-4 * np.eye(2))

    plain = np.linalg.eigvalsh(spectra(lines).matrices)
    assert (plain[:, 0] / plain[:, 1]).min() > 0.005
    whitened = np.linalg.eigvalsh(spectra(lines, model).matrices)
    # The scatter of the mean over 1200 lines is 3 %, but tapers see the edges of a late process.
    assert whitened[:, 0].mean() == pytest.approx(9e-5, rel=0.25)


def test_a_band_without_lines_is_refused():
    rng = np.random.default_rng(3)
    with pytest.raises(ValueError, match="the record has only 2 lines in the band"):
        lines_of(white_record(rng), (1.0, 1.045), 0.02)


@pytest.fixture
def model_and_data():
    rng = np.random.default_rng(0)
    n, n_columns = 3, 3
    shapes = rng.standard_normal((n, n_columns))
    forces = np.tril(rng.standard_normal((n_columns, 2)) + 1j * rng.standard_normal((n_columns, 2)))
    forces[[0, 1], [0, 1]] = 1.0, 0.5
    model = SpectralModel(
        np.log([1.0, 1.3]),
        np.log([0.02, 0.03]),
        shapes / np.sqrt((shapes**2).sum(0)),
        forces,
        np.log([0.1, 0.2, 0.05]),
        np.array([-1.5, 0.7]),
        1.1,
    )
    frequencies = np.linspace(0.6, 2.0, 60)
    data = Spectra(frequencies, np.full(60, 5.0), np.zeros((60, n, n)), np.zeros(60))
    return model, data, rng


def drawn(covariance, rng):
    """A Wishart matrix of five transforms for each covariance."""
    normal = rng.standard_normal((*covariance.shape[:2], 5, 2)) @ [1.0, 1.0j] / np.sqrt(2.0)
    transforms = np.linalg.cholesky(covariance) @ normal
    return transforms @ transforms.conj().swapaxes(1, 2) / 5


@pytest.mark.parametrize("q", Q)
def test_the_gradient_is_that_of_the_misfit(model_and_data, q):
    model, data, rng = model_and_data
    data = data._replace(matrices=drawn(covariances(model, data.frequencies_hz, q), rng))
    gradient = derivatives(model, data, q).gradient
    steps = 1e-5 * np.eye(len(gradient))
    differences = [
        (misfit(model.moved(step), data, q) - misfit(model.moved(-step), data, q)) / 2e-5
        for step in steps
    ]
    np.testing.assert_allclose(gradient, differences, atol=1e-6 * np.abs(gradient).max())


@pytest.mark.parametrize("q", Q)
def test_the_information_is_the_curvature_where_the_model_is_exact(model_and_data, q):
    model, data, _ = model_and_data
    data = data._replace(matrices=covariances(model, data.frequencies_hz, q))
    exact = derivatives(model, data, q)
    scale = np.sqrt(exact.information.diagonal())
    np.testing.assert_allclose(exact.gradient / scale, 0.0, atol=1e-6)
    rng = np.random.default_rng(5)
    for direction in rng.standard_normal((6, len(scale))) / scale:
        step = 0.01 * direction
        rise = misfit(model.moved(step), data, q) + misfit(model.moved(-step), data, q)
        rise -= 2.0 * exact.misfit
        assert rise == pytest.approx(float(step @ exact.information @ step), rel=2e-3)


def test_the_observed_curvature_is_that_of_the_posterior(model_and_data):
    """Not the expected one, from which the posterior of five transforms a block is far."""
    model, data, rng = model_and_data
    data = data._replace(matrices=drawn(covariances(model, data.frequencies_hz, 0), rng))
    prior = WeakPrior.of(model, data, 0)
    best = most_probable(model, data, 0, prior, 1e-12)
    curvature = observed_curvature(best.model, data, 0, prior, best.curvature)

    def value(step):
        moved = best.model.moved(step)
        shapes = prior.precisions * step**2
        flat = prior.penalty(moved) + 0.5 * shapes[best.model.layout.shapes].sum()
        return misfit(moved, data, 0) + flat

    ratios = []
    for direction in rng.standard_normal((6, len(curvature))) / np.sqrt(curvature.diagonal()):
        rise = value(0.01 * direction) + value(-0.01 * direction) - 2.0 * value(0.0 * direction)
        rises = 1e4 * rise / (direction @ np.stack([curvature, best.curvature]) @ direction)
        ratios.append(rises)
    ratios = np.array(ratios)
    np.testing.assert_allclose(ratios[:, 0], 1.0, rtol=2e-3)
    assert np.abs(ratios[:, 1] - 1.0).max() > 0.02


def test_the_gain_by_a_mode_is_that_of_a_small_step(model_and_data):
    """½ gᵀ I⁻¹ g of the wider model's derivatives, over that without the mode's forces."""
    model, data, rng = model_and_data
    data = data._replace(matrices=drawn(covariances(model, data.frequencies_hz, 0), rng))
    shape = np.array([0.6, 0.0, 0.8])
    wider = replace(
        model,
        log_frequencies=np.append(model.log_frequencies, np.log(1.6)),
        log_dampings=np.append(model.log_dampings, np.log(0.02)),
        shapes=np.insert(model.shapes, 2, shape, axis=1),
        forces=np.insert(model.forces, 2, 0.0, axis=0),
    )
    rows = np.tril_indices(4, -1, 2)[0]
    at = wider.layout
    own = np.concatenate([at.real.start + np.flatnonzero(rows == 2)] * 2)
    own[2:] += at.imaginary.start - at.real.start
    # The rest of the model follows; nothing depends on a mode's parameters without its forces.
    idle = [at.log_frequencies.stop - 1, at.log_dampings.stop - 1, at.shapes.start + 4]
    used = np.setdiff1d(np.arange(at.n_coordinates), [*idle, at.shapes.start + 5])
    exact = derivatives(wider, data, 0)

    def gain(of):
        slope, information = exact.gradient[of], exact.information[np.ix_(of, of)]
        return 0.5 * slope @ np.linalg.solve(information, slope)

    expected = gain(used) - gain(np.setdiff1d(used, own))
    assert gain_of_mode(model, data, 0, (1.6, 0.02, shape)) == pytest.approx(expected, rel=1e-9)
