"""The most probable modes of a narrow band, their errors and their evidence (Bayesian FFT).

The likelihood is that of complex Wishart matrices, the means of a few transforms in every block
(Yuen and Katafygiotis 2003; Au 2017). Its Fisher information is that of weighted least squares:
w tr(E⁻¹ dE E⁻¹ dE) of each block, so that Fisher scoring converges in a dozen steps.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import BoolArray, ComplexArray, FloatArray
from bayes_ssi.measurements.records.local_model import (
    Model,
    OneSource,
    basis,
    coordinates,
    information_of,
    started,
)
from bayes_ssi.measurements.records.spectra import (
    DAMPING,
    MOST_DAMPING,
    LocalSpectra,
    Resonances,
    turned,
)

LOG_DAMPING_SD = 1.0
SHAPE_SD = 1.0  # of a shape beside its largest part
PHASE_SD = 0.1  # of what is out of phase in it
BACKGROUND_SDS = np.array([10.0, 0.3, 0.1])  # it, its change, its bend
LEAST_FORCES = 1e-4  # over the quiet background; priors of smaller ones stay
SETTLED_GAIN = 0.01  # nats of a step with which a climb ends
MOST_STEPS = 40
ARRIVED_GAIN = 0.5  # nats that Newton's step would gain where a climb has not arrived


@dataclass(frozen=True, eq=False)
class LocalFit:
    """The most probable modes of a band."""

    data: LocalSpectra
    model: Model
    has_phases: bool
    # (2m + 2mr)², of (ln f, ln ζ, shapes' real parts, their imaginary parts), mode by mode in each.
    covariance: FloatArray
    log_likelihood: float
    log_evidence: float
    whiteness: float  # chi-square of the whitened spectra over degrees of freedom
    allowed_whiteness: float
    converged: bool
    covariances: ComplexArray  # (K, r, r), E of each block

    @property
    def modes(self) -> Resonances:
        """In the directions of the band."""
        return self.model.modes

    @property
    def are_modes(self) -> BoolArray:
        """Which resonances are within the band, and damped no more than structures are (m,)."""
        low, high = self.data.band_hz
        f = self.modes.frequencies_hz
        driven = self.model.drive.sizes(self.modes) > 0.0
        return (f > low) & (f < high) & (self.modes.dampings < MOST_DAMPING) & driven

    @property
    def one_source(self) -> bool:
        """Whether one process drives everything."""
        return isinstance(self.model.drive, OneSource)

    def residuals(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies (K,) and chi-square of each block over its number, 1 where all is right."""
        chi, numbers = _chi_square(self.data, self.covariances)
        return self.data.frequencies_hz, chi / numbers


def allowed_whiteness(weights: FloatArray, sizes: FloatArray, n_degrees: float) -> float:
    """1.1, where claimed deviations are too small by a twentieth, and three times the scatter.

    The mean W of w independent Gaussian vectors of n complex components with unit covariance has
    w |W - I|² with the mean n² and the variance 2n² + (4n³ + 2n) / w. Weights are w and sizes n
    of each block, (K,).
    """
    variances = 2.0 * sizes**2 + (4.0 * sizes**3 + 2.0 * sizes) / weights
    return 1.1 + 3.0 * math.sqrt(float(variances.sum())) / n_degrees


class Fitter:
    def __init__(self, data: LocalSpectra, one_source: bool) -> None:
        self.data, self.one_source = data, one_source
        self.matrices = data.matrices + np.diag(data.floor)
        self.r = len(data.floor)  # directions

    def misfit(self, e: ComplexArray) -> float:
        """-ln likelihood without constants; infinite where E is not positive."""
        try:
            factors = np.linalg.cholesky(e)
        except np.linalg.LinAlgError:
            return math.inf
        logs = 2.0 * np.log(factors.diagonal(axis1=1, axis2=2).real).sum(1)
        solved = np.linalg.solve(e, self.matrices)
        traces = np.einsum("kii->k", solved).real
        return float(self.data.weights @ (logs + traces))

    def fit(
        self, start: Resonances | LocalFit, has_phases: bool, most_steps: int = MOST_STEPS
    ) -> LocalFit:
        if isinstance(start, LocalFit):
            model = start.model
        else:
            modes = start
            if not has_phases:
                real = turned(modes.shapes).real
                real = real / np.linalg.norm(real, axis=0)
                modes = modes._replace(shapes=real.astype(complex))
            model = started(self.data, modes, self.one_source)
        # Priors of forces stay as those at the start would have them, and do not vanish.
        usual = np.maximum(model.drive.sizes(model.modes), LEAST_FORCES)
        e = model.covariances(self.data)
        steps = _Steps(self, model, e, has_phases, usual)
        damping = 1e-2
        for _ in range(most_steps):
            value = self.misfit(e) + self._energy(model, steps.scales)
            while damping < 1e8 and (step := steps.step(damping)) is not None:
                trial = steps.moved(step)
                tried_e = trial.covariances(self.data)
                if self.misfit(tried_e) + self._energy(trial, steps.scales) < value:
                    break
                damping = max(10.0 * damping, 1e-4)
            else:
                break
            model, e, damping = trial, tried_e, 0.1 * damping
            steps = _Steps(self, model, e, has_phases, usual)
            if (model.modes.dampings > 2.0 * MOST_DAMPING).any():
                break
        return self._described(model, e, steps)

    def gain_of(self, fit: LocalFit, one: Resonances) -> tuple[float, ComplexArray]:
        """About how many nats a mode more would gain: by its forces alone, at first order.

        And its shape (r,): that of ``one`` under independent loads, and the one that gains most
        where one source drives all.
        """
        at, drive = self.data, fit.model.drive
        usual = np.maximum(drive.sizes(fit.modes), LEAST_FORCES)
        steps = _Steps(self, fit.model, fit.covariances, fit.has_phases, usual)
        left, right = drive.more(at, fit.model.motions(at), one)
        added = 2.0 * coordinates(left[..., None] * right[..., None, :].conj())  # (K, 2c, r²)
        seen = added @ steps.of_blocks
        slope = np.einsum("kpa,ka->p", added, steps.slopes)
        cross = np.concatenate(
            [np.einsum("k,kpa->ap", power, seen) for power in at.powers]
            + [np.einsum("kqa,kpa->qp", steps.derivatives, seen)]
        )
        solved = _solved(steps.curvature, np.column_stack([cross, steps.slope]))
        curvature = np.tensordot(seen, added, ([0, 2], [0, 2])) - cross.T @ solved[:, :-1]
        slope = slope - cross.T @ solved[:, -1]
        step = _solved(curvature, slope)
        shape = one.shapes[:, 0]
        if self.one_source:
            shape = step[0::2] + 1j * step[1::2]
            turn = np.exp(-0.5j * np.angle((shape**2).sum()))
            shape = shape / np.linalg.norm(shape) * turn
        return 0.5 * float(slope @ step), shape

    def _energy(self, model: Model, scales: FloatArray) -> float:
        """The quadratic part of -ln prior density."""
        off = (np.log(model.modes.dampings) - math.log(DAMPING)) / LOG_DAMPING_SD
        value = 0.5 * float(off @ off)
        value += 0.5 * float(((model.modes.shapes.imag / PHASE_SD) ** 2).sum())
        value += 0.5 * float((np.abs(model.backgrounds / BACKGROUND_SDS[:, None, None]) ** 2).sum())
        return value + model.drive.energy(model.modes, scales)

    def _described(self, model: Model, e: ComplexArray, steps: "_Steps") -> LocalFit:
        (low, high), n_modes = self.data.band_hz, model.modes.n_modes
        sign, log_determinant = np.linalg.slogdet(steps.curvature / (2.0 * math.pi))
        misfit = self.misfit(e)
        value = misfit + self._energy(model, steps.scales)
        # The rest of -ln prior density, up to constants of the band.
        normal = steps.precisions[steps.modal][n_modes:] / (2.0 * math.pi)
        of_modes = n_modes * math.log(math.log(high / low)) - 0.5 * float(np.log(normal).sum())
        value += of_modes + model.drive.log_normalisation(model.modes, steps.scales)
        evidence = -value - 0.5 * float(log_determinant) if sign > 0 else -math.inf
        covariance = _solved(steps.curvature, np.eye(steps.size))
        # Of (ln f, ln ζ, real parts, imaginary parts of shapes) by the modes' own coordinates.
        of_shapes = np.concatenate([steps.turns.real, steps.turns.imag])
        jacobian = block_diag(np.eye(2 * n_modes), of_shapes)
        modal = covariance[steps.modal, steps.modal]
        chi, numbers = _chi_square(self.data, e)
        n_free = 1.0 - float(np.trace(covariance @ steps.information)) / (len(e) * self.r**2)
        n_degrees = max(1.0, float(numbers.sum()) * n_free)
        whiteness = float(chi.sum()) / n_degrees
        left = 0.5 * float(steps.slope @ covariance @ steps.slope)
        return LocalFit(
            self.data, model, steps.has_phases, jacobian @ modal @ jacobian.T, -misfit,
            evidence, whiteness,
            allowed_whiteness(self.data.weights, np.sqrt(numbers), n_degrees),
            left < ARRIVED_GAIN, e,
        )  # fmt: skip


def _solved(curvature: FloatArray, right: FloatArray) -> FloatArray:
    """Curvature⁻¹ right, of coordinates of any sizes, some of which may hardly be determined."""
    roots = np.sqrt(curvature.diagonal())
    # What rounding could make singular.
    scaled = curvature / roots / roots[:, None] + 1e-11 * np.eye(len(roots))
    return np.asarray(np.linalg.solve(scaled, (right.T / roots).T).T / roots).T


def _chi_square(data: LocalSpectra, e: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Of the whitened matrices of blocks (K,), and what it is on average where E is right (K,)."""
    inverse = np.linalg.inv(e)
    whitened = inverse @ (data.matrices + np.diag(data.floor)) - np.eye(e.shape[1])
    chi = data.weights * np.einsum("kij,kji->k", whitened, whitened).real
    # The floor does not scatter.
    traces = e.shape[1] - np.einsum("kii,i->k", inverse.real, data.floor)
    return chi, traces**2


class _Steps:
    """Gradient and curvature of -ln posterior at a model, and steps from there.

    Coordinates are those of the backgrounds (3 r²), frequencies, dampings, shapes (r - 1 each,
    twice as many with phases), and real and imaginary parts of the drive's values.
    """

    def __init__(
        self, fitter: Fitter, model: Model, e: ComplexArray, has_phases: bool, usual: FloatArray
    ) -> None:
        modes, data = model.modes, fitter.data
        self.model, self.has_phases = model, has_phases
        self.scales = model.drive.scales(data, modes, usual)
        r, m = fitter.r, len(modes.frequencies_hz)
        inverse: ComplexArray = np.linalg.inv(e)
        inverse = 0.5 * (inverse + inverse.conj().swapaxes(1, 2))
        residual = inverse @ (fitter.matrices - e) @ inverse
        slopes = data.weights[:, None] * coordinates(residual)  # (K, r²)
        information = data.weights[:, None, None] * information_of(inverse)
        derivatives = self._derivatives(fitter)  # (K, P, r²)
        self.slopes, self.of_blocks, self.derivatives = slopes, information, derivatives
        smooth = 3 * r * r
        self.size = smooth + derivatives.shape[1]
        self.modal = slice(smooth, smooth + 2 * m + m * (r - 1) * (1 + has_phases))
        self.curvature, self.slope = np.zeros((self.size, self.size)), np.zeros(self.size)
        seen = derivatives @ information
        self.slope[smooth:] = np.einsum("kpa,ka->p", derivatives, slopes)
        self.curvature[smooth:, smooth:] = np.tensordot(seen, derivatives, ([0, 2], [0, 2]))
        moments = np.tensordot(data.powers[1] ** np.arange(5)[:, None], information, 1)
        for i, power in enumerate(data.powers):
            a = slice(i * r * r, (i + 1) * r * r)
            self.slope[a] = power @ slopes
            cross = np.einsum("k,kpa->pa", power, seen)
            self.curvature[smooth:, a], self.curvature[a, smooth:] = cross, cross.T
            self.curvature[a, :smooth] = np.hstack([*moments[i : i + 3]])
        self.information = self.curvature.copy()
        self._add_prior()

    def _derivatives(self, fitter: Fitter) -> FloatArray:
        """Of E by all coordinates but backgrounds (K, P, r²)."""
        at, modes, drive = fitter.data, self.model.modes, self.model.drive
        h, by_f, by_z = modes.response_slopes(at)
        shapes = modes.shapes
        m = shapes.shape[1]
        tangents = [_tangent(shape, self.has_phases) for shape in shapes.T]
        self.turns = block_diag(np.zeros((0, 0)), *tangents)  # of all shapes, one after another
        motions = at.motions(modes, h)
        forces = drive.forces(at, motions).swapaxes(1, 2)  # (K, m, r)
        n_tangent = tangents[0].shape[1] if m else 0
        left = [(slopes[:, None] * shapes).swapaxes(1, 2) for slopes in (by_f, by_z)]
        left += [h[:, i, None, None] * tangent.T for i, tangent in enumerate(tangents)]
        driven_left, driven_right = drive.columns(at, motions)
        left.append(driven_left)
        right = np.concatenate(
            [forces, forces, np.repeat(forces, n_tangent, axis=1), driven_right], axis=1
        )
        products = np.concatenate(left, axis=1)[..., None] * right[..., None, :].conj()
        return 2.0 * coordinates(products)  # of products and their conjugate transposes

    def _add_prior(self) -> None:
        model, modes = self.model, self.model.modes
        r, m = modes.shapes.shape
        # Uniform priors of frequencies bend nothing; ones keep the curvature positive where a mode
        # has no forces.
        of_others = [*BACKGROUND_SDS**-2.0, 1.0, LOG_DAMPING_SD**-2.0]
        of_shapes = [SHAPE_SD**-2.0, PHASE_SD**-2.0][: 1 + self.has_phases]
        self.precisions = np.concatenate(
            [np.repeat(of_others, [r * r] * 3 + [m, m]), np.tile(np.repeat(of_shapes, r - 1), m)]
        )
        off = np.concatenate(
            [
                coordinates(model.backgrounds).ravel(),
                np.zeros(m),
                np.log(modes.dampings) - math.log(DAMPING),
                self.turns.imag.T @ modes.shapes.imag.T.ravel(),
            ]
        )
        n = len(off)
        self.curvature[range(n), range(n)] += self.precisions
        self.slope[:n] -= self.precisions * off
        of_drive, slope = model.drive.prior(modes, self.scales)
        self.curvature[n:, n:] += of_drive
        self.slope[n:] += slope

    def step(self, damping: float) -> FloatArray | None:
        """A damped step; None where it should gain too little."""
        damped = self.curvature + damping * np.diag(self.curvature.diagonal())
        step = _solved(damped, self.slope)
        return step if 0.5 * float(self.slope @ step) >= SETTLED_GAIN else None

    def moved(self, step: FloatArray) -> Model:
        """The model after a step, shortened where it would leave what is known of modes."""
        modes = self.model.modes
        r, m = modes.shapes.shape
        ends = np.cumsum([3 * r * r, m, m, self.turns.shape[1]])
        _, by_f, by_z, *_ = np.split(step, ends)
        # No farther than a bandwidth, nor to twice the damping.
        steepest = [*np.abs(by_z) / 0.7, *np.abs(by_f) / np.maximum(modes.dampings, 0.003)]
        smooth, by_f, by_z, by_turns, values = np.split(step / max([1.0, *steepest]), ends)
        backgrounds = np.einsum("pa,aij->pij", smooth.reshape(3, r * r), basis(r))
        shapes = modes.shapes + (self.turns @ by_turns).reshape(m, r).T
        lengths = np.linalg.norm(shapes, axis=0) * np.exp(0.5j * np.angle((shapes**2).sum(0)))
        frequencies, dampings = modes.frequencies_hz * np.exp(by_f), modes.dampings * np.exp(by_z)
        return Model(
            self.model.backgrounds + backgrounds,
            Resonances(frequencies, dampings, shapes / lengths),
            self.model.drive.moved(values.view(complex), lengths),
        )


def _tangent(shape: ComplexArray, has_phases: bool) -> ComplexArray:
    """Directions (r, r - 1), or twice as many, in which a shape of unit length can change.

    Its real part is longest at the phase that it has: a change of phase is none of the shape.
    """
    real = shape.real / np.linalg.norm(shape.real)
    full, _ = np.linalg.qr(np.concatenate([real[:, None], np.eye(len(shape))], axis=1))
    across = full[:, 1 : len(shape)].astype(complex)
    return np.concatenate([across, 1j * across], axis=1) if has_phases else across
