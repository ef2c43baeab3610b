"""The spectral model of a narrow band: its derivatives, its information and its evidence."""

from itertools import product

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import block_diag, null_space

from bayes_ssi.measurements.records.local_fit import Fitter, _Steps
from bayes_ssi.measurements.records.local_model import (
    DIRECT_SDS,
    LOG_RANGE_OF_FORCES,
    IndependentLoads,
    Model,
    OneSource,
    basis,
    coordinates,
)
from bayes_ssi.measurements.records.spectra import (
    LocalSpectra,
    Resonances,
    Spectra,
    local_spectra,
    noise_scales,
)

R, K = 3, 60


def data_of(matrices, width=0.01):
    frequencies = np.linspace(1.7, 2.3, len(matrices))
    r = matrices.shape[1]
    n = len(matrices)
    return LocalSpectra(
        frequencies, np.full(n, width), np.full(n, 5.0), matrices, np.full(r, 0.1), np.eye(r),
        np.eye(r), np.zeros((n, 0, r), dtype=complex), np.zeros((r, 0)), Resonances.none(r),
        np.zeros((n, 0), dtype=complex),
    )  # fmt: skip


def random_model(rng, drive_kind, m=2, p=1):
    shapes = rng.standard_normal((R, m)) + 0.05j * rng.standard_normal((R, m))
    shapes *= np.exp(-0.5j * np.angle((shapes**2).sum(0)))
    shapes /= np.linalg.norm(shapes, axis=0)
    modes = Resonances(np.array([1.95, 2.08])[:m], np.array([0.015, 0.02])[:m], shapes)

    def normal(*size):
        return rng.standard_normal(size) + 1j * rng.standard_normal(size)

    half = normal(3, R, R)
    backgrounds = 0.02 * (half + half.conj().swapaxes(1, 2))
    backgrounds[0] += np.eye(R)
    if drive_kind == "loads":
        forces = 1j * np.array([0.3, 0.2])[:m] * shapes + 0.02 * normal(R, m)
        drive = IndependentLoads(0.02 * normal(R, p), forces)
    else:
        drive = OneSource(0.3 * normal(3, R), 0.1 * normal(p), 0.2 * normal(m))
    neighbour = Resonances(np.array([2.6]), np.array([0.02]), np.eye(R)[:, :1].astype(complex))
    return Model(backgrounds, modes, drive), neighbour


def drawn(e, weight, rng):
    """Spectral matrices of so many transforms with covariances (K, R, R)."""
    normal = rng.standard_normal((K, R, weight, 2)) @ [1.0, 1.0j] / np.sqrt(2.0)
    transforms = np.linalg.cholesky(e) @ normal
    return data_of(transforms @ transforms.conj().swapaxes(1, 2) / weight)


def with_real_shapes(model):
    real = model.modes.shapes.real / np.linalg.norm(model.modes.shapes.real, axis=0)
    return model._replace(modes=model.modes._replace(shapes=real.astype(complex)))


def covariances_of(model, neighbour):
    plain = data_of(np.tile(np.eye(R, dtype=complex), (K, 1, 1))).beside(neighbour)
    return model.covariances(Fitter(plain, False).data)


def fitter_and_model(drive_kind, seed=0):
    rng = np.random.default_rng(seed)
    model, neighbour = random_model(rng, drive_kind)
    data = drawn(covariances_of(model, neighbour), 5, rng)
    return Fitter(data.beside(neighbour), drive_kind != "loads"), model


def test_a_block_sees_the_mean_response_over_its_width():
    """Against quadrature of h = 1 / (1 - β² - 2iζβ), in blocks wider than the resonance."""
    data = data_of(np.zeros((5, R, R)), width=0.3)
    mode = Resonances(np.array([2.01]), np.array([0.004]), np.ones((1, 1), complex))
    for centre, mean in zip(data.frequencies_hz, mode.responses(data)[:, 0], strict=True):

        def h(f):
            beta = 2.01 / f
            return 1.0 / (1.0 - beta**2 - 0.008j * beta)

        ends = centre - 0.15, centre + 0.15
        parts = [
            quad(lambda f, part=part: part(h(f)), *ends, points=[2.01], limit=200)[0] / 0.3
            for part in (np.real, np.imag)
        ]
        assert mean == pytest.approx(complex(*parts), rel=1e-6)


def test_coordinates_of_hermitian_matrices_keep_lengths():
    rng = np.random.default_rng(1)
    half = rng.standard_normal((R, R)) + 1j * rng.standard_normal((R, R))
    matrix = half + half.conj().T
    own = coordinates(matrix)
    np.testing.assert_allclose(np.einsum("a,aij->ij", own, basis(R)), matrix, atol=1e-12)
    assert own @ own == pytest.approx(np.linalg.norm(matrix) ** 2)


@pytest.mark.parametrize("drive_kind", ["loads", "one source"])
@pytest.mark.parametrize("has_phases", [False, True])
def test_the_slope_is_that_of_the_likelihood(drive_kind, has_phases):
    """By central differences along every coordinate."""
    fitter, model = fitter_and_model(drive_kind)
    if not has_phases:
        model = with_real_shapes(model)
    usual = np.maximum(model.drive.sizes(model.modes), 1e-12)
    steps = _Steps(fitter, model, model.covariances(fitter.data), has_phases, usual)

    def misfit(step):
        return fitter.misfit(steps.moved(step).covariances(fitter.data))

    plain = slope_of_the_likelihood(steps, fitter)
    scale = np.sqrt(steps.information.diagonal().clip(1e-6))
    small = np.diag(1e-6 / scale)
    differences = [(misfit(-step) - misfit(step)) / (2.0 * step.sum()) for step in small]
    np.testing.assert_allclose(plain / scale, differences / scale, atol=2e-4)


def slope_of_the_likelihood(steps, fitter):
    slope = np.zeros(steps.size)
    smooth = 3 * R * R
    for i, power in enumerate(fitter.data.powers):
        slope[i * R * R : (i + 1) * R * R] = power @ steps.slopes
    slope[smooth:] = np.einsum("kpa,ka->p", steps.derivatives, steps.slopes)
    return slope


@pytest.mark.parametrize("drive_kind", ["loads", "one source"])
def test_the_information_is_the_curvature_where_the_model_is_exact(drive_kind):
    fitter, model = fitter_and_model(drive_kind)
    e = model.covariances(fitter.data)
    exact = data_of(e)._replace(floor=np.zeros(R))
    fitter = Fitter(exact.beside(fitter.data.neighbours), fitter.one_source)
    steps = _Steps(fitter, model, e, True, np.maximum(model.drive.sizes(model.modes), 1e-12))
    rng = np.random.default_rng(5)
    scale = np.sqrt(steps.information.diagonal())
    least = fitter.misfit(e)
    for direction in rng.standard_normal((6, steps.size)) / scale:
        step = 0.003 * direction
        both = (fitter.misfit(steps.moved(s).covariances(fitter.data)) for s in (step, -step))
        rise = sum(both) - 2.0 * least
        assert rise == pytest.approx(float(step @ steps.information @ step), rel=5e-3)


@pytest.mark.parametrize("coherence", [0.0, 0.95])
def test_modes_are_recovered_with_their_errors(coherence):
    """Of 40 draws from E = H S H* + I: pulls of ln f and ln ζ have unit size, to 11 %.

    Modes whose shapes have the MAC 0.91 have forces that are independent, or all but the same.
    """
    model, neighbour = random_model(np.random.default_rng(3), "loads")
    modes = with_real_shapes(model).modes
    plain = data_of(np.zeros((K, R, R)))
    finer = plain.frequencies_hz[:, None] + np.linspace(-0.5, 0.5, 41) * plain.widths_hz[:, None]
    beta = modes.frequencies_hz / finer[..., None]
    moved = modes.shapes.real / (1.0 - beta**2 - 2j * modes.dampings * beta)[:, :, None]
    powers = 4.0 * modes.dampings * [0.3, 0.2]
    forces = np.sqrt(np.outer(powers, powers)) * (coherence + (1.0 - coherence) * np.eye(2))
    e = (moved @ forces @ moved.conj().swapaxes(2, 3)).mean(1) + np.eye(R)
    pulls = []
    for seed in range(40):
        data = drawn(e - np.diag(plain.floor), 20, np.random.default_rng(seed))
        data = data._replace(weights=np.full(K, 20.0))
        fit = Fitter(data.beside(neighbour), False).fit(modes, has_phases=False)
        assert fit.converged
        assert fit.are_modes.all()
        assert fit.whiteness < 1.3
        sds = np.sqrt(fit.covariance.diagonal()[:4])
        pulls.append(np.log(np.concatenate(fit.modes[:2]) / np.concatenate(modes[:2])) / sds)
    assert np.sqrt(np.square(pulls).mean()) == pytest.approx(1.0, abs=0.25)


def test_one_source_is_followed_where_spectra_are_all_but_singular():
    """Noise of 1e-4 of the power: modes and whiteness are right, and the climb arrives."""
    rng = np.random.default_rng(7)
    model, neighbour = random_model(np.random.default_rng(3), "one source")
    model = with_real_shapes(model)._replace(backgrounds=1e-2 * model.backgrounds)
    data = drawn(covariances_of(model, neighbour), 5, rng)._replace(floor=np.full(R, 1e-4))
    fit = Fitter(data.beside(neighbour), True).fit(model.modes, has_phases=False)
    assert fit.converged
    assert fit.whiteness < fit.allowed_whiteness
    off = np.log(fit.modes.frequencies_hz / model.modes.frequencies_hz)
    assert (np.abs(off) < 4.0 * np.sqrt(fit.covariance.diagonal()[:2])).all()


def test_the_gain_by_a_mode_more_is_large_where_there_is_one():
    """What is left out gains more than a mode costs; beside it there is next to nothing."""
    fitter, model = fitter_and_model("loads", seed=2)
    first, second = (model.modes.at([i]) for i in range(2))
    fit = fitter.fit(first, has_phases=True)
    whole = fitter.fit(model.modes, has_phases=True)
    gain, shape = fitter.gain_of(fit, second)
    assert whole.log_evidence > fit.log_evidence + 10.0
    assert gain > 20.0
    np.testing.assert_array_equal(shape, second.shapes[:, 0])
    assert fitter.gain_of(whole, second._replace(frequencies_hz=np.array([1.75])))[0] < 15.0


def test_noise_is_what_no_other_channel_explains():
    """Of two channels with a common signal and noises of 0.1 and 0.3: their sizes, to a few %."""
    rng = np.random.default_rng(6)
    n_blocks, weight = 200, 20
    common = rng.standard_normal((n_blocks, 1, weight, 2)) @ [1.0, 1.0j] / np.sqrt(2.0)
    noise = rng.standard_normal((n_blocks, 3, weight, 2)) @ [1.0, 1.0j] / np.sqrt(2.0)
    z = common * np.array([1.0, 1.0, 1.0])[:, None] + noise * np.array([0.01, 0.1, 0.3])[:, None]
    matrices = z @ z.conj().swapaxes(1, 2) / weight
    frequencies = np.linspace(1.0, 2.0, n_blocks)
    spectra = Spectra(frequencies, np.full(n_blocks, 0.01), np.full(n_blocks, 20.0), matrices)
    np.testing.assert_allclose(noise_scales(spectra)[1:], [0.1, 0.3], rtol=0.1)
    data = local_spectra(spectra, 2)
    # Directions and the rest together hold all channels.
    whole = np.concatenate([data.to_channels, data.rest_to_channels], axis=1)
    assert np.linalg.matrix_rank(whole) == 3
    np.testing.assert_allclose(data.from_channels @ data.to_channels, np.eye(2), atol=1e-9)


@pytest.mark.parametrize("m", [1, 2])
def test_the_prior_of_forces_that_evidence_takes_integrates_to_one(m):
    """By quadrature over the 2r - 1 directions of each mode's force across i φ, r = 2.

    Along i φ its size s is uniform in logarithm over LOG_RANGE_OF_FORCES: what is left is the
    product of 1 / (s · range). Trapezoids are exact for normal densities to 1e-8 at 0.9 sd.
    """
    rng = np.random.default_rng(8)
    turns = np.array([0.4, 1.3])[:m]
    shapes = np.array([np.cos(turns), np.sin(turns)]).astype(complex)
    modes = Resonances(np.array([1.95, 2.08])[:m], np.array([0.015, 0.02])[:m], shapes)
    half = rng.standard_normal((m, 2, 2))
    scales = 0.01 * np.eye(2) + 0.02 * half @ half.swapaxes(1, 2)
    sizes = np.array([0.3, 0.2])[:m]
    log_integral = 0.0
    for i, scale in enumerate(scales):
        along = np.r_[0.0, 0.0, modes.shapes[:, i].real]  # of i φ; real parts come first
        across = null_space(along[None])
        precision = across.T @ np.linalg.inv(block_diag(scale, scale)) @ across
        axes = across @ np.linalg.cholesky(np.linalg.inv(precision))
        steps = 0.9 * np.arange(-8, 9)
        total = 0.0
        for at in product(steps, repeat=3):
            forces = 1j * sizes * modes.shapes
            move = axes @ at
            forces[:, i] += move[:2] + 1j * move[2:]
            drive = IndependentLoads(np.zeros((2, 0), dtype=complex), forces)
            total += np.exp(-drive.energy(modes, scales))
        log_integral += np.log(total * 0.9**3) - 0.5 * np.linalg.slogdet(precision)[1]
    drive = IndependentLoads(np.zeros((2, 0), dtype=complex), 1j * sizes * modes.shapes)
    expected = -np.log(sizes * LOG_RANGE_OF_FORCES).sum()
    log_integral -= drive.log_normalisation(modes, scales)
    assert log_integral == pytest.approx(expected, abs=1e-8)


def test_the_prior_of_one_source_integrates_to_one():
    """Of direct motion over complex planes, and of a mode's factor over all sizes and phases.

    In plane polar coordinates the density 1 / (π l² range) of a factor's size l gives
    2 ∫ dl / l / range, over sizes l² whose logarithms have that range: one.
    """
    modes = random_model(np.random.default_rng(3), "one source")[0].modes
    none = np.zeros((3, R), dtype=complex), np.zeros(1, dtype=complex)
    factors = np.array([0.2 + 0.1j, -0.3j])
    drive = OneSource(*none, factors)
    log_density = -drive.log_normalisation(modes, np.zeros(0)) - drive.energy(modes, np.zeros(0))
    of_factors = -np.log(np.pi * np.abs(factors) ** 2 * LOG_RANGE_OF_FORCES).sum()
    # Integral of exp(-|d|²/2s²) over both parts of a complex number d is 2π s².
    of_direct = -R * sum(np.log(2.0 * np.pi * sd**2) for sd in DIRECT_SDS.ravel())
    assert log_density == pytest.approx(of_factors + of_direct, abs=1e-9)
