"""A part of the spectrum explained by the modes that the evidence asks for, and their errors.

How close two modes may be and still be told apart follows from the record's length: two equal modes
with the same shape, d half-power bandwidths apart, fit better than one by (π/4) d⁴ ζ f T nats to
leading order in d, whether their forces are coherent or not, since the best single mode takes up
all else.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.local_fit import Fitter, LocalFit
from bayes_ssi.measurements.records.mode_candidates import Prominence
from bayes_ssi.measurements.records.spectra import Resonances, turned

# What modes and explanations must gain to be kept, in nats, and where a mode or two are tried.
NATS_OF_A_MODE = 3.0  # without a clear peak: one in e³ is there; also of one source
MOST_MODES = 8  # of a band; more are not looked for
LEAST_SEPARATION = 0.2  # of two modes, over their mean bandwidth
SHARED_PEAK = 3.0  # times the sum of half bandwidths: modes that are closer share a peak
PAIR_REACH = 2.5  # half bandwidths from the one mode: farther off there were a peak
SAME_SHAPE_MAC = 0.8  # above this, modes of one frequency are one
# One peak in a thousand has a second mode that shows as no peak of its own, and a false pair
# misleads more than a missed one.
NATS_OF_A_PAIR = 7.0
SURE_NATS = 20.0  # beyond which it does not matter whether a climb has quite arrived
FIRST_STEPS_OF_PAIRS = 8  # of all starts
PAIRS_TO_THE_TOP = 3  # the best of the starts


class ExplainedPeak(NamedTuple):
    """A peak of the spectra, and how its explanations compare with one mode with a real shape."""

    modes: tuple[int, ...]  # places of its modes among those of the band
    # By which one mode with phases explains it better, less those by which it is rarer before.
    nats_of_phases: float
    nats_of_two: float | None  # by which two modes do; None if none are fitted there
    is_undecided: bool = False  # one mode or two

    @property
    def probabilities(self) -> tuple[float, float | None]:
        """Of phases, and of two modes."""
        two = -math.inf if self.nats_of_two is None else self.nats_of_two
        shares = softmax([0.0, self.nats_of_phases, two])
        return float(shares[1]), None if self.nats_of_two is None else float(shares[2])


@dataclass(frozen=True, eq=False)
class Explained:
    """A band and its modes; those beside the search are not wanted, but known."""

    fit: LocalFit
    peaks: tuple[ExplainedPeak, ...]
    is_wanted: bool
    halves: tuple[LocalFit, ...] = ()  # its modes in each half of the record, with phases

    def singular_values(self) -> FloatArray:
        """Of the fitted spectral matrices of all channels (K, r), descending."""
        data = self.fit.data
        squares = data.to_channels.T @ data.to_channels
        factors = np.linalg.cholesky(self.fit.covariances)
        turned: ComplexArray = factors.conj().swapaxes(1, 2) @ squares @ factors
        return np.asarray(np.linalg.eigvalsh(turned)[:, ::-1], dtype=np.float64)

    @property
    def excess(self) -> float:
        """Chi-square over what is allowed."""
        return self.fit.whiteness / self.fit.allowed_whiteness

    @property
    def doubt(self) -> str | None:
        """Why errors that are claimed may be wrong; None if all is well."""
        low, high = self.band_hz
        where = f"from {low:.4g} to {high:.4g} Hz"
        if not self.fit.converged:
            return f"{where} the most probable modes were not reached"
        if any(peak.is_undecided for peak in self.peaks):
            return f"{where} it is undecided whether a peak holds one mode or two"
        # The mean of two shapes of one mode is a matrix of rank two, as of two modes.
        pairs = [i for peak in self.peaks if len(peak.modes) > 1 for i in peak.modes]
        if any(half.converged and not half.are_modes[pairs].all() for half in self.halves):
            return (
                f"{where} two modes share a peak of the whole record, but not of each half: does "
                "the shape of one change?"
            )
        if self.excess > 1.0:
            return (
                f"{where} the modes do not explain the spectra (chi-square over degrees of freedom "
                f"{self.fit.whiteness:.2f}, allowed {self.fit.allowed_whiteness:.2f}); errors "
                f"are {math.sqrt(self.fit.whiteness):.2g} times as large as otherwise"
            )
        return None

    def estimates(
        self, places: Sequence[int], channels: Sequence[int]
    ) -> tuple[Resonances, FloatArray]:
        """Some of its modes in some channels, with real shapes, and the covariance of their errors.

        It is that of (ln f, ln ζ, shapes), shapes mode by mode, whose largest components are
        positive. Errors grow by the root of chi-square where that is more than is allowed.
        """
        fit, data = self.fit, self.fit.data
        rest, variances = rest_of_shapes(fit)
        r, m = fit.modes.shapes.shape
        n, n_places = len(channels), len(places)
        to_channels, rest_to_channels = data.to_channels[channels], data.rest_to_channels[channels]
        shapes = np.empty((n, n_places))
        jacobian = np.zeros((n_places * (2 + n), 2 * m * (1 + r)))
        of_rest = np.zeros((n_places * (2 + n), n_places * (2 + n)))
        for k, i in enumerate(places):
            jacobian[k, i] = jacobian[n_places + k, m + i] = 1.0
            full = data.to_channels @ fit.modes.shapes[:, i] + data.rest_to_channels @ rest[:, i]
            turn = np.exp(-0.5j * np.angle((full**2).sum()))
            real = (turn * full).real[channels]
            sign = np.sign(real[np.abs(real).argmax()])
            turn, real = sign * turn, sign * real
            length = np.linalg.norm(real)
            shape = shapes[:, k] = real / length
            across = (np.eye(n) - np.outer(shape, shape)) / length
            rows = slice(2 * n_places + k * n, 2 * n_places + (k + 1) * n)
            at = 2 * m + i * r
            jacobian[rows, at : at + r] = turn.real * (across @ to_channels)
            at += m * r
            jacobian[rows, at : at + r] = -turn.imag * (across @ to_channels)
            outside = across @ rest_to_channels
            of_rest[rows, rows] = variances[i] * outside @ outside.T
        covariance = jacobian @ fit.covariance @ jacobian.T + of_rest
        if self.excess > 1.0:
            covariance *= fit.whiteness
        return fit.modes.at(places)._replace(shapes=shapes), covariance

    def complexity(self, places: Sequence[int], channels: Sequence[int]) -> FloatArray:
        """Modal phase collinearity and mean phase in degrees of some modes (2, m).

        Of shapes with phases, also where the evidence does not ask for these. The collinearity is
        |φᵀφ|² / (φᴴφ)² (Pappa, Elliott and Schenk 1993).
        """
        shapes = turned(complex_shapes(self.fit)[1][np.ix_(channels, places)])
        sizes = np.abs(shapes)
        mpc = np.abs((shapes**2).sum(0)) ** 2 / (sizes**2).sum(0) ** 2
        angles = np.degrees(np.arctan2(np.abs(shapes.imag), np.abs(shapes.real)))
        return np.array([mpc, (sizes * angles).sum(0) / sizes.sum(0)])

    @property
    def band_hz(self) -> tuple[float, float]:
        return self.fit.data.band_hz

    @property
    def modes(self) -> Resonances:
        """In channels; all that the leading directions show."""
        shapes = self.fit.data.to_channels @ self.fit.modes.shapes
        return self.fit.modes._replace(shapes=shapes / np.linalg.norm(shapes, axis=0))


def resolution(fit: LocalFit, i: int) -> float:
    """Half-power bandwidths by which two modes of one shape must differ to be told from one."""
    width = 2.0 * float(fit.modes.half_widths_hz[i])
    n_lines = max(math.e, width / fit.data.line_hz)
    r = fit.modes.shapes.shape[0]
    cost = 0.5 * (3 * r + 1) * math.log(n_lines)
    return float((8.0 * cost / (math.pi * n_lines)) ** 0.25)


def rest_of_shapes(fit: LocalFit) -> tuple[ComplexArray, FloatArray]:
    """Shapes in all other directions (n - r, m), and the variance of each component (m,).

    Cross spectra of these with the leading directions are linear in them.
    """
    data, m = fit.data, fit.modes.shapes.shape[1]
    if not data.rest.shape[1]:
        return np.zeros((0, m), dtype=complex), np.zeros(m)
    factors = np.linalg.inv(np.linalg.cholesky(fit.covariances)).conj().swapaxes(1, 2)
    factors = factors * np.sqrt(data.weights)[:, None, None]
    h = fit.modes.responses(data)
    motions = data.motions(fit.modes, h)
    forces = fit.model.drive.forces(data, motions)
    r = data.matrices.shape[1]
    smooth = data.powers[:2].T[:, :, None, None] * np.eye(r)
    rows = np.concatenate(
        [
            (h[:, None] * forces.conj()).swapaxes(1, 2),
            fit.model.drive.crosses(data, motions),
            smooth.reshape(len(h), 2 * r, r),
        ],
        axis=1,
    )
    regressors = (rows @ factors).swapaxes(1, 2).reshape(-1, rows.shape[1])
    targets = (data.rest @ factors).transpose(0, 2, 1).reshape(-1, data.rest.shape[1])
    products = regressors.conj().T @ regressors
    products += 1e-9 * np.diag(products.diagonal())
    solution = np.linalg.solve(products, regressors.conj().T @ targets)
    variances = 0.5 * np.linalg.inv(products).diagonal().real[:m]
    return solution[:m].T, np.asarray(variances, dtype=np.float64)


def complex_shapes(fit: LocalFit) -> tuple[FloatArray, ComplexArray, FloatArray]:
    """The modes of a band with phases, whether these are needed or not.

    Frequencies (m,) in Hz; turned shapes (n, m) in channels, at unit length; and the covariances
    (m, n, n) of their imaginary parts.
    """
    if not fit.has_phases:
        fit = Fitter(fit.data, fit.one_source).fit(fit, has_phases=True)
    data = fit.data
    rest, variances = rest_of_shapes(fit)
    r, m = fit.modes.shapes.shape
    shapes = data.to_channels @ fit.modes.shapes + data.rest_to_channels @ rest
    lengths = np.linalg.norm(shapes, axis=0)
    of_rest = data.rest_to_channels @ data.rest_to_channels.T
    covariances = np.empty((m, len(shapes), len(shapes)))
    for i in range(m):
        at = slice(2 * m + (m + i) * r, 2 * m + (m + i + 1) * r)
        inside = data.to_channels @ fit.covariance[at, at] @ data.to_channels.T
        covariances[i] = (inside + variances[i] * of_rest) / lengths[i] ** 2
    covariances *= max(1.0, fit.whiteness / fit.allowed_whiteness)
    return fit.modes.frequencies_hz, turned(shapes / lengths), covariances


# The shapes of a pair at first: shares of the one mode's shape, and of what it leaves unexplained.
SHARES_OF_PAIRS = (
    ((1.0, 1.0), (0.3, -0.3)),
    ((1.0, 1.0), (-0.3, 0.3)),
    ((1.0, 0.3), (0.0, 1.0)),
    ((0.3, 1.0), (1.0, 0.0)),
)
# Dampings to either side, dampings over the one mode's, and shares. Pairs of one frequency have the
# second shape that the spectra show there.
STARTS_OF_PAIRS = (
    *((split, 0.7, shares) for split in (0.5, 1.0) for shares in SHARES_OF_PAIRS),
    (0.05, 1.0, ((1.0, 0.0), (0.0, 1.0))),
    (0.05, 1.0, ((0.0, 1.0), (1.0, 0.0))),
)


def with_others(fitter: Fitter, fit: LocalFit, poles: Resonances) -> LocalFit:
    """The fit with those other poles that the evidence asks for, the strongest first."""
    f, known = poles.frequencies_hz, fit.modes
    low, high = fitter.data.band_hz
    apart = np.abs(f[:, None] - known.frequencies_hz)
    widths = poles.half_widths_hz[:, None] + known.half_widths_hz
    new = (apart > LEAST_SEPARATION * widths).all(1)
    others = poles.at((f > low) & (f < high) & new).in_directions(fitter.data)
    unknowns = 2 + 2 * (fitter.r - 1) + 2 * fitter.r
    while others.n_modes and fit.modes.n_modes < MOST_MODES:
        gains = [fitter.gain_of(fit, others.at([i]))[0] for i in range(others.n_modes)]
        best = int(np.argmax(gains))
        if gains[best] < 0.5 * unknowns:
            break
        wider = fitter.fit(fit.modes.joined(others.at([best])), fit.has_phases)
        others = others.without(best)
        if wider.are_modes.all() and wider.log_evidence > fit.log_evidence + NATS_OF_A_MODE:
            fit = wider
    return fit


def without_needless(fitter: Fitter, fit: LocalFit, clear: Sequence[Prominence]) -> LocalFit:
    """The fit without modes whose absence is more probable, the weakest first.

    What has left the band, or has more damping than structures have, is no mode of it; a clear peak
    keeps its mode.
    """
    while fit.modes.n_modes:
        f, half = fit.modes.frequencies_hz, fit.modes.half_widths_hz
        sizes = fit.model.drive.sizes(fit.modes)
        same = [pair for pair in pairwise(np.argsort(f).tolist()) if _are_one(fit, *pair)]
        weaker = (min(pair, key=sizes.__getitem__) for pair in same)
        if wrong := [*np.flatnonzero(~fit.are_modes).tolist(), *weaker]:
            fit = fitter.fit(fit.modes.without(wrong[0]), fit.has_phases)
            continue
        at_peaks = [np.abs(f - peak.frequency_hz) < half + peak.width_hz for peak in clear]
        for i in np.argsort(sizes / fit.modes.dampings**2).tolist():
            if not any(at[i] and at.sum() == 1 for at in at_peaks):
                without = fitter.fit(fit.modes.without(i), fit.has_phases)
                if without.log_evidence > fit.log_evidence - NATS_OF_A_MODE:
                    fit = without
                    break
        else:
            break
    return fit


def share_a_peak(modes: Resonances, i: int) -> bool:
    """Whether there is a next mode, and the two meet before either has a tenth of its power."""
    if i + 1 >= modes.n_modes:
        return False
    apart = modes.frequencies_hz[i + 1] - modes.frequencies_hz[i]
    return bool(apart < SHARED_PEAK * modes.half_widths_hz[i : i + 2].sum())


class OneOrTwo(NamedTuple):
    """How two modes explain a peak in place of one."""

    nats: float | None  # by which two are more probable; None if that is not known
    other: LocalFit | None  # that with two modes in place of one, or with one in place of two
    is_undecided: bool = False  # a comparison that might matter did not arrive


def one_in_place_of(fitter: Fitter, fit: LocalFit, i: int) -> OneOrTwo:
    """One mode in place of modes i and i + 1, which share a peak."""
    pair = [i, i + 1]
    strongest = i + int(fit.model.drive.sizes(fit.modes)[pair].argmax())
    one = fit.modes.at([strongest])
    others = fit.modes.without(*pair)
    middle = np.exp(np.log(fit.modes.frequencies_hz[pair]).mean(keepdims=True))
    starts = (others.joined(one._replace(frequencies_hz=f)) for f in (middle, one.frequencies_hz))
    merged = max(
        (_arrived(fitter, fitter.fit(start, fit.has_phases)) for start in starts),
        key=lambda fit_of_one: fit_of_one.log_evidence,
    )
    # What an unfinished climb has still to gain is little beside hundreds of nats.
    nats = fit.log_evidence - merged.log_evidence + _nats_of_place(fit, pair) - NATS_OF_A_PAIR
    if not (merged.converged and fit.converged) and nats < SURE_NATS:
        return OneOrTwo(None, None, is_undecided=True)
    return OneOrTwo(nats, merged)


def two_in_place_of(fitter: Fitter, fit: LocalFit, i: int) -> OneOrTwo:
    """Two modes in place of mode i."""
    one = fit.modes.at([i])
    frequency, damping = float(one.frequencies_hz[0]), float(one.dampings[0])
    gain, direction = _gain_of_a_second(fitter, fit, one)
    n_unknowns = 2 + (fitter.r - 1) * (1 + fit.has_phases) + 2 * fitter.r
    if gain < 0.8 * n_unknowns:
        return OneOrTwo(None, None)
    others = fit.modes.without(i)
    begun = []
    for split, relative_damping, (of_one, of_rest) in STARTS_OF_PAIRS:
        shapes = one.shapes * np.array(of_one) + direction[:, None] * np.array(of_rest)
        pair = Resonances(
            frequency * (1.0 + split * damping * np.array([-1.0, 1.0])),
            np.full(2, relative_damping * damping),
            shapes / np.linalg.norm(shapes, axis=0),
        )
        begun.append(fitter.fit(others.joined(pair), fit.has_phases, FIRST_STEPS_OF_PAIRS))
    begun.sort(key=lambda started: started.log_likelihood, reverse=True)
    climbed = (_arrived(fitter, fitter.fit(s, fit.has_phases)) for s in begun[:PAIRS_TO_THE_TOP])
    pairs = [two for two in climbed if _is_a_pair(two, frequency, damping)]
    if not pairs:
        return OneOrTwo(None, None)
    best = max(pairs, key=lambda two: two.log_evidence)
    order = np.argsort(best.modes.frequencies_hz)
    if (np.diff(order) < 0).any():
        best = fitter.fit(best.modes.at(order), fit.has_phases)
    nearest = np.sort(np.abs(best.modes.frequencies_hz - frequency).argsort()[:2]).tolist()
    nats = best.log_evidence - fit.log_evidence + _nats_of_place(best, nearest) - NATS_OF_A_PAIR
    if best.converged and (fit.converged or nats > SURE_NATS):
        return OneOrTwo(nats, best)
    return OneOrTwo(None, None, is_undecided=best.log_likelihood > fit.log_likelihood + n_unknowns)


def _arrived(fitter: Fitter, fit: LocalFit) -> LocalFit:
    """The fit, climbed on from where its steps ended."""
    return fit if fit.converged else fitter.fit(fit, fit.has_phases)


def _nats_of_place(fit: LocalFit, pair: Sequence[int]) -> float:
    """Given that a peak holds two modes, the second is within a bandwidth, not anywhere."""
    low, high = fit.data.band_hz
    width = 2.0 * float(fit.modes.dampings[pair].mean())
    apart = float(np.diff(np.log(fit.modes.frequencies_hz[pair]))[0])
    place = math.log(math.log(high / low) / (width * math.sqrt(2.0 * math.pi)))
    return place - 0.5 * (apart / (2.0 * width)) ** 2


def _gain_of_a_second(fitter: Fitter, fit: LocalFit, one: Resonances) -> tuple[float, ComplexArray]:
    """What a second mode at one or on a flank would gain at most, and in which direction (r,)."""
    frequency, damping = float(one.frequencies_hz[0]), float(one.dampings[0])
    # That of most power beyond the fit around it.
    data = fit.data
    near = np.abs(data.frequencies_hz - frequency) <= 2.0 * damping * frequency
    near[np.abs(data.frequencies_hz - frequency).argmin()] = True
    beyond = data.matrices[near] - fit.covariances[near]
    mean = np.einsum("k,kij->ij", data.weights[near], beyond)
    shape = one.shapes[:, 0]
    across = np.eye(len(shape)) - np.outer(shape, shape.conj())
    unexplained: ComplexArray = np.linalg.eigh(across @ mean @ across)[1][:, -1]
    if not fit.has_phases:
        real = turned(unexplained).real
        unexplained = (real / np.linalg.norm(real)).astype(complex)
    gains = []
    for sign in (-1.0, 0.0, 1.0):
        hz = np.array([frequency * (1.0 + sign * damping)])
        # Where the one mode is, another has another shape.
        for shape in (unexplained, one.shapes[:, 0]) if sign else (unexplained,):
            gains.append(fitter.gain_of(fit, Resonances(hz, one.dampings, shape[:, None])))
    gain, direction = max(gains, key=lambda gain_and_shape: gain_and_shape[0])
    return gain, direction if fitter.one_source else unexplained


def _is_a_pair(two: LocalFit, frequency: float, damping: float) -> bool:
    """Whether the two modes nearest to one that they replace are modes, at its peak, and apart."""
    if not two.are_modes.all():
        return False
    nearest = np.abs(two.modes.frequencies_hz - frequency).argsort()[:2]
    f, half = two.modes.frequencies_hz[nearest], two.modes.half_widths_hz[nearest]
    if (np.abs(f - frequency) > PAIR_REACH * max(half.max(), damping * frequency)).any():
        return False
    return not _are_one(two, *nearest.tolist())


def _are_one(fit: LocalFit, i: int, j: int) -> bool:
    """Whether two modes differ neither in frequency nor in shape.

    Where one source drives all, two shapes at one frequency are one complex shape.
    """
    f, half, shapes = fit.modes.frequencies_hz, fit.modes.half_widths_hz, fit.modes.shapes
    alike = fit.one_source or abs(np.vdot(shapes[:, i], shapes[:, j])) ** 2 > SAME_SHAPE_MAC
    return bool(alike and abs(f[i] - f[j]) < LEAST_SEPARATION * (half[i] + half[j]))
