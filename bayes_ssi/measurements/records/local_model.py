"""The spectral matrices of a narrow band: modes, what drives them, and a smooth background.

Around a few modes the spectral matrix of the channels is

    E(f) = B0 + x B1 + x² B2 + Σ_i [h_i(f) φ_i a_i* + conj(h_i(f)) a_i φ_i*],

with x from -1 to 1 over the band, h_i = 1 / (1 - β_i² - 2i ζ_i β_i), β_i = f_i / f: the partial
fractions of any rational spectrum. The modes' forces may be coherent with each other and with all
that lies outside the band, which is in the Hermitian backgrounds B; independent forces alone have
a_i = i s_i φ_i with s_i > 0. All but f, ζ and φ is linear.

Where one process drives everything, as the ground's motion in one direction does, E is all but
singular, and the same spectra are v v* + B0 + x B1 + x² B2 with
v(f) = d0 + x d1 + x² d2 + Σ_i h_i(f) φ_i l_i. Blocks see the mean of h over their width.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.spectra import LocalSpectra, Resonances

COHERENCE_SD = 0.3  # of forces coherent with the background, over the most that can be
NEIGHBOUR_SD = 10.0  # of forces of neighbours, over the quiet background
DIRECT_SDS = np.array([[2.0], [1.0], [0.5]])  # direct motion, its change, its bend
# Of the largest over the smallest that a mode may have; the prior is flat in the logarithm.
LOG_RANGE_OF_FORCES = math.log(1e4)
FLAT_PRECISION = 1e-8  # of flat priors: it keeps curvatures positive
ROOT_2_PI = math.sqrt(2.0 * math.pi)


@cache
def basis(r: int) -> ComplexArray:
    """Orthonormal Hermitian matrices (r², r, r)."""
    basis = np.zeros((r * r, r, r), dtype=complex)
    for i in range(r):
        basis[i * i, i, i] = 1.0
        for j in range(i):
            real, imaginary = basis[i * i + 1 + 2 * j :][:2]
            real[i, j] = real[j, i] = math.sqrt(0.5)
            imaginary[i, j], imaginary[j, i] = 1j * math.sqrt(0.5), -1j * math.sqrt(0.5)
    return basis


@cache
def _projection(r: int) -> FloatArray:
    """From real and imaginary parts of a Hermitian matrix to its coordinates (2r², r²)."""
    return np.asarray(basis(r).reshape(r * r, r * r).view(np.float64).T.copy())


def coordinates(matrices: ComplexArray) -> FloatArray:
    """Of Hermitian matrices (..., r, r) in the basis (..., r²)."""
    r = matrices.shape[-1]
    flat = np.ascontiguousarray(matrices).reshape(*matrices.shape[:-2], r * r)
    return np.asarray(flat.view(np.float64) @ _projection(r))


def information_of(inverse: ComplexArray) -> FloatArray:
    """tr(E⁻¹ B E⁻¹ B') of all pairs of basis matrices, from E⁻¹ of the blocks: (K, r², r²)."""
    k, r = inverse.shape[:2]
    left = inverse.reshape(k * r, r) @ basis(r).transpose(1, 0, 2).reshape(r, -1)
    left = left.reshape(k, r, r * r, r).swapaxes(1, 2).reshape(k, r**3, r)
    return coordinates((left @ inverse).reshape(k, r * r, r, r))


# Left and right (K, 2c, r) of the derivatives of E by the real and imaginary parts of c values, in
# turn: dE = left right* + its Hermitian transpose.
Columns = tuple[ComplexArray, ComplexArray]


def _columns(left: ComplexArray, right: ComplexArray, turn: complex) -> Columns:
    """Of ``left`` (K, c, r) by real parts, which is multiplied by ``turn`` for imaginary ones."""
    parts = np.stack([left, turn * left], axis=2).reshape(len(left), -1, left.shape[2])
    return parts, np.repeat(np.broadcast_to(right, left.shape), 2, axis=1)


class IndependentLoads(NamedTuple):
    """Forces a of p neighbours and m modes: coherent with the background or not."""

    of_neighbours: ComplexArray  # (r, p)
    of_modes: ComplexArray  # (r, m)

    @property
    def values(self) -> ComplexArray:
        """(c,)"""
        return np.concatenate([self.of_neighbours.T.ravel(), self.of_modes.T.ravel()])

    def moved(self, step: ComplexArray, lengths: ComplexArray) -> "IndependentLoads":
        """After a step of the values, and shapes that were divided by ``lengths`` (m,)."""
        r, p = self.of_neighbours.shape
        of_neighbours = self.of_neighbours + step[: r * p].reshape(p, r).T
        of_modes = self.of_modes + step[r * p :].reshape(-1, r).T
        return IndependentLoads(of_neighbours, of_modes * lengths.conj())

    def matrices(self, _at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
        """What the modes add to the background (K, r, r)."""
        forces = np.concatenate([self.of_neighbours, self.of_modes], axis=1)
        resonant = motions.swapaxes(1, 2) @ forces.conj().T
        return np.asarray(resonant + resonant.conj().swapaxes(1, 2))

    def forces(self, _at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
        """a_i of each block (K, r, m)."""
        return np.broadcast_to(self.of_modes, (len(motions), *self.of_modes.shape))

    def columns(self, _at: LocalSpectra, motions: ComplexArray) -> Columns:
        n, r = motions.shape[1:]
        return _columns(
            np.repeat(motions, r, axis=1), np.tile(np.eye(r, dtype=complex), (n, 1)), -1j
        )

    def more(self, at: LocalSpectra, _motions: ComplexArray, one: Resonances) -> Columns:
        """Derivatives by the values of a mode more, with its shape."""
        return self.columns(at, (one.responses(at)[:, None] * one.shapes).swapaxes(1, 2))

    def crosses(self, _at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
        """What else than shapes cross spectra with other directions are linear in (K, c, r)."""
        return motions.conj()

    def sizes(self, modes: Resonances) -> FloatArray:
        """4 ζ s (m,), where s is the part i φ of the forces."""
        along = (modes.shapes.conj() * self.of_modes).sum(0).imag
        return np.asarray(4.0 * modes.dampings * along)

    def scales(self, at: LocalSpectra, modes: Resonances, usual: FloatArray) -> FloatArray:
        """Prior covariances (m, r, r) of forces coherent with all that moves at each mode.

        That is a background of unit power, and the other modes: S_ij of two modal forces gives
        a_i the part φ_j S_ij h_j*(p_i) by partial fractions. Loads that are alike everywhere make
        forces of modes as coherent as their shapes are alike.
        """
        m = len(modes.dampings)
        # On the way to the most probable model forces may all but vanish.
        sizes = self.sizes(modes).clip(0.1 * usual, 10.0 * usual)
        others = modes.beside(at.neighbours)
        along = (at.neighbours.shapes.conj() * self.of_neighbours).sum(0).imag
        of_others = np.r_[sizes, 4.0 * at.neighbours.dampings * along.clip(0.0)]
        beta = others.frequencies_hz / modes.frequencies_hz[:, None]
        damped = beta * (others.dampings + beta * modes.dampings[:, None])
        mac = np.abs(modes.shapes.conj().T @ others.shapes) ** 2
        coherences = 1.0 + (0.5 * COHERENCE_SD**-2 - 1.0) * mac  # over that with the background
        powers = coherences * of_others / ((1.0 - beta**2) ** 2 + 4.0 * damped**2)
        powers[range(m), range(m)] = 0.0
        outer = np.einsum("aj,bj->jab", others.shapes, others.shapes.conj()).real
        motion = np.eye(len(modes.shapes)) + np.einsum("ij,jab->iab", powers, outer)
        return np.asarray(COHERENCE_SD**2 * sizes[:, None, None] * motion)

    def energy(self, modes: Resonances, scales: FloatArray) -> float:
        """The quadratic part of -ln prior of the values."""
        along = (modes.shapes.conj() * self.of_modes).sum(0)
        across = self.of_modes - 1j * modes.shapes * along.imag
        solved = np.linalg.solve(scales, across.T[:, :, None])[:, :, 0]
        value = 0.5 * float((across.T.conj() * solved).real.sum())
        return value + 0.5 * float((np.abs(self.of_neighbours / NEIGHBOUR_SD) ** 2).sum())

    def log_normalisation(self, modes: Resonances, scales: FloatArray) -> float:
        """The rest of -ln prior of the values, up to constants of the band."""
        r, m = modes.shapes.shape
        along = (modes.shapes.conj() * self.of_modes).sum(0).imag
        # Of all directions but one, that of i φ.
        across = np.einsum("im,mij,jm->m", modes.shapes.conj(), scales, modes.shapes).real
        value = (2 * r - 1) * m * math.log(ROOT_2_PI)
        value += float(np.linalg.slogdet(scales)[1].sum() - 0.5 * np.log(across).sum())
        return value + float(np.log(along.clip(1e-9) * LOG_RANGE_OF_FORCES).sum())

    def prior(self, modes: Resonances, scales: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Precision matrix (2c, 2c) and slope (2c,) of ln prior by real and imaginary parts."""
        r = len(modes.shapes)
        n = 2 * self.values.size
        precisions = np.zeros((n, n))
        at = 2 * self.of_neighbours.size
        precisions[range(at), range(at)] = NEIGHBOUR_SD**-2
        for shape, scale in zip(modes.shapes.T, scales, strict=True):
            along = as_reals(1j * shape)
            of_shape = slice(at, at + 2 * r)
            across = np.eye(2 * r) - np.outer(along, along)
            precision = across @ np.kron(np.linalg.inv(scale), np.eye(2)) @ across
            precisions[of_shape, of_shape] = precision + FLAT_PRECISION * np.eye(2 * r)
            at += 2 * r
        return precisions, -precisions @ as_reals(self.values)


class OneSource(NamedTuple):
    """One process that drives everything; methods give what those of independent loads do."""

    direct: ComplexArray  # (3, r), what channels have of it beside resonances, over the band
    of_neighbours: ComplexArray  # (p,), factors l of neighbours
    of_modes: ComplexArray  # (m,), factors l of modes

    @property
    def values(self) -> ComplexArray:
        """(c,)"""
        return np.concatenate([self.direct.ravel(), self.of_neighbours, self.of_modes])

    def moved(self, step: ComplexArray, lengths: ComplexArray) -> "OneSource":
        n = self.direct.size
        smooth, of_neighbours, of_modes = np.split(step, [n, n + len(self.of_neighbours)])
        direct = self.direct + smooth.reshape(self.direct.shape)
        of_modes = (self.of_modes + of_modes) * lengths
        return OneSource(direct, self.of_neighbours + of_neighbours, of_modes)

    def motion(self, at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
        """v (K, r)."""
        factors = np.concatenate([self.of_neighbours, self.of_modes])
        return np.asarray(at.powers.T @ self.direct + factors @ motions)

    def matrices(self, at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
        v = self.motion(at, motions)
        return np.asarray(v[:, :, None] * v[:, None].conj())

    def forces(self, at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
        return self.motion(at, motions)[:, :, None] * self.of_modes.conj()

    def columns(self, at: LocalSpectra, motions: ComplexArray) -> Columns:
        return _columns(_of_one_source(at, motions), self.motion(at, motions)[:, None], 1j)

    def more(self, at: LocalSpectra, motions: ComplexArray, one: Resonances) -> Columns:
        """Derivatives by the values of a mode more, with any shape."""
        left = one.responses(at)[:, :, None] * np.eye(len(one.shapes))
        return _columns(left, self.motion(at, motions)[:, None], 1j)

    def crosses(self, at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
        factors = np.concatenate([at.powers.T, at.of_neighbours], axis=1)
        return np.asarray(factors[:, :, None] * self.motion(at, motions)[:, None].conj())

    def sizes(self, _modes: Resonances) -> FloatArray:
        """4 ζ s (m,), where s is about the part i φ of the forces."""
        return np.asarray(np.abs(self.of_modes) ** 2)

    def scales(self, _at: LocalSpectra, _modes: Resonances, usual: FloatArray) -> FloatArray:
        """Factors of modes may have any size."""
        return usual

    def energy(self, _modes: Resonances, _scales: FloatArray) -> float:
        value = 0.5 * float((np.abs(self.direct / DIRECT_SDS) ** 2).sum())
        return value + 0.5 * float((np.abs(self.of_neighbours / NEIGHBOUR_SD) ** 2).sum())

    def log_normalisation(self, modes: Resonances, _scales: FloatArray) -> float:
        sizes = self.sizes(modes).clip(1e-12)
        value = 2.0 * self.direct.shape[1] * float(np.log(DIRECT_SDS * ROOT_2_PI).sum())
        return value + float(np.log(math.pi * sizes * LOG_RANGE_OF_FORCES).sum())

    def prior(self, _modes: Resonances, _scales: FloatArray) -> tuple[FloatArray, FloatArray]:
        numbers = [self.direct.shape[1]] * 3 + [len(self.of_neighbours), len(self.of_modes)]
        each = [*DIRECT_SDS.ravel() ** -2.0, NEIGHBOUR_SD**-2, FLAT_PRECISION]
        precisions = np.repeat(each, 2 * np.array(numbers))
        # The phase of the whole source is nobody's to know.
        fixed = as_reals(1j * self.values) / np.linalg.norm(self.values)
        return np.diag(precisions) + np.outer(fixed, fixed), -precisions * as_reals(self.values)


def _of_one_source(at: LocalSpectra, motions: ComplexArray) -> ComplexArray:
    """Derivatives of v by the values of one source (K, c, r)."""
    r = motions.shape[2]
    direct = at.powers.T[:, :, None, None] * np.eye(r)
    smooth = direct.reshape(len(motions), 3 * r, r).astype(complex)
    return np.concatenate([smooth, motions], axis=1)


def as_reals(values: ComplexArray) -> FloatArray:
    """Real and imaginary parts of each, in turn."""
    return np.asarray(np.stack([values.real, values.imag], axis=-1).ravel(), dtype=np.float64)


# What drives the modes; all of it is linear in complex values.
Drive = IndependentLoads | OneSource


class Model(NamedTuple):
    """Backgrounds (3, r, r), modes, and what drives them."""

    backgrounds: ComplexArray
    modes: Resonances
    drive: Drive

    def covariances(self, at: LocalSpectra) -> ComplexArray:
        """E (K, r, r)."""
        smooth = np.einsum("pk,pij->kij", at.powers, self.backgrounds)
        return np.asarray(smooth + self.drive.matrices(at, self.motions(at)))

    def motions(self, at: LocalSpectra) -> ComplexArray:
        return at.motions(self.modes, self.modes.responses(at))


def started(at: LocalSpectra, modes: Resonances, one_source: bool) -> Model:
    """A model with modes whose forces have about the size that the spectra show."""
    r, m = modes.shapes.shape
    p = len(at.neighbours.frequencies_hz)
    peak_powers = np.empty(m)
    for i, shape in enumerate(modes.shapes.T):
        nearest = int(np.abs(at.frequencies_hz - modes.frequencies_hz[i]).argmin())
        near = slice(max(0, nearest - 2), nearest + 3)
        power = float((shape.conj() @ at.matrices[near].mean(0) @ shape).real)
        peak_powers[i] = max(power - 1.0, 0.1)
    backgrounds = np.zeros((3, r, r), dtype=complex)
    backgrounds[0] = np.eye(r)
    if not one_source:
        forces = 0.7j * modes.dampings * peak_powers * modes.shapes
        return Model(backgrounds, modes, IndependentLoads(np.zeros((r, p), dtype=complex), forces))
    # The leading singular vectors give v but for the phase of each block, which a reference fixes.
    values, vectors = np.linalg.eigh(at.matrices)
    v = vectors[:, :, -1] * np.sqrt(values[:, -1:])
    motions = at.motions(modes, modes.responses(at))
    source = OneSource(
        np.zeros((3, r), dtype=complex),
        np.zeros(p, dtype=complex),
        (1.4 * modes.dampings * np.sqrt(peak_powers)).astype(complex),
    )
    left = _of_one_source(at, motions).swapaxes(1, 2)
    for _ in range(20):  # least squares of v, and phases that agree with it
        fitted = source.motion(at, motions)
        overlap = (v.conj() * fitted).sum(1)
        turned = v * np.exp(1j * np.angle(overlap))[:, None]
        weights = np.sqrt(at.weights)[:, None] / np.linalg.norm(v, axis=1)[:, None]
        regressors = (left * weights[..., None]).reshape(-1, left.shape[2])
        products = regressors.conj().T @ regressors
        products += 1e-6 * np.diag(products.diagonal().real)
        solved = np.linalg.solve(products, regressors.conj().T @ (turned * weights).ravel())
        direct, *factors = np.split(solved, [3 * r, 3 * r + p])
        source = OneSource(direct.reshape(3, r), *factors)
    backgrounds *= 0.3
    return Model(backgrounds, modes, source)
