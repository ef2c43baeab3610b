"""The likelihood of one test as a sum of Gaussians, fitted to its values at the stored draws.

At every stored draw the likelihood itself is known, not only how often the draw occurs: the sum is
fitted to its logarithm by least squares. A likelihood that is normal in form is matched exactly in
this way, however few the draws, and its integrals over normal populations are known in closed form.

A component is a function exp(-q/2) of d coordinates z, with a quadratic q = (z, 1)·Q·(z, 1): a
multiple of a normal density, except that it may be flat in some directions, about which the data
say nothing. Its form Q (d + 1, d + 1) is symmetric. Products of components add forms, and a linear
map of the coordinates turns one into another.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.mixture import LIGHT_TAILS, fit_mixture

# Root mean square error of a log-likelihood, in nats, that is good enough: with that of each of
# a hundred tests, their sum is off by a fifth of a nat, before the draws correct it.
FIT_ERROR = 0.02
# The same of a likelihood that is normal in form, but for rounding.
EXACT_FIT_ERROR = 1e-6
# That are tried until the error is small. A search may end in a poor minimum, beyond which more
# components lead: one or two that are hardly better than fewer are no reason to stop.
NUMBERS_OF_COMPONENTS = (2, 4, 8)
# For each number that is fitted. Likelihoods at draws have no noise: a few pin it down, where
# draws alone would need many.
DRAWS_PER_NUMBER = 4
# With which the stored evidence counts in a fit. It is known to about a hundredth of a nat; by
# a tenth, its error is that of a likelihood known to a thousandth.
EVIDENCE_WEIGHT = 0.1
MOST_EVALUATIONS = 60  # in one search for the least squares


def log_parts(forms: FloatArray, z: FloatArray) -> FloatArray:
    """Logarithms (n, K) of components with ``forms`` (K, d + 1, d + 1) at ``z`` (n, d)."""
    points = np.insert(z, z.shape[1], 1.0, axis=1)
    return -0.5 * ((points @ forms) * points).sum(axis=-1).T


def log_sum(forms: FloatArray, z: FloatArray) -> FloatArray:
    """The logarithm (n,) of the sum of components at ``z`` (n, d)."""
    return _shares(log_parts(forms, z))[1]


def _shares(parts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shares (n, K) of parts given by logarithms, and the log (n,) of their sum."""
    highest = parts.max(axis=1, keepdims=True)
    numbers = np.exp(parts - highest)
    totals = numbers.sum(axis=1, keepdims=True)
    return numbers / totals, (np.log(totals) + highest)[:, 0]


def mapped(forms: FloatArray, origins: FloatArray, units: FloatArray) -> FloatArray:
    """Forms (..., d + 1, d + 1) of x, where those given are of z = origin + unit·x, (..., d)."""
    d = forms.shape[-1] - 1
    squares, slopes = forms[..., :d, :d], forms[..., d, :d]
    at_origin = np.einsum("...ij,...j->...i", squares, origins) + slopes
    x = np.empty((*np.broadcast_shapes(at_origin.shape, units.shape)[:-1], d + 1, d + 1))
    x[..., :d, :d] = units[..., :, None] * squares * units[..., None, :]
    x[..., d, :d] = x[..., :d, d] = units * at_origin
    x[..., d, d] = ((at_origin + slopes) * origins).sum(axis=-1) + forms[..., d, d]
    return x


def standard_form(d: int) -> FloatArray:
    """The form (d + 1, d + 1) of N(0, I), times (2π)^(d/2)."""
    return np.diag(np.append(np.ones(d), 0.0))


def log_integrals(forms: FloatArray) -> FloatArray:
    """Logarithms (...) of the integrals of components (..., d + 1, d + 1), over (2π)^(d/2).

    Raises:
        numpy.linalg.LinAlgError: a component is flat in a direction.
    """
    d = forms.shape[-1] - 1
    # The last row of the Cholesky factor is solved for by the others.
    bordered = forms.copy()
    bordered[..., d, d] = np.finfo(float).max
    factors = np.linalg.cholesky(bordered)
    log_roots = np.log(np.einsum("...ii->...i", factors[..., :d, :d])).sum(axis=-1)
    gained = np.einsum("...i,...i->...", factors[..., d, :d], factors[..., d, :d])
    return np.asarray(0.5 * (gained - forms[..., d, d]) - log_roots)


def averaged(forms: FloatArray, others: NDArray[np.intp]) -> FloatArray:
    """Forms (K, m + 1, m + 1) of the other coordinates, these averaged over N(0, I)."""
    kept = np.setdiff1d(np.arange(forms.shape[1]), others)
    inner = forms[:, others][:, :, others] + np.eye(len(others))
    across = forms[:, others][:, :, kept]
    left = forms[:, kept][:, :, kept] - across.swapaxes(1, 2) @ np.linalg.solve(inner, across)
    left[:, -1, -1] += np.linalg.slogdet(inner)[1]
    return np.asarray(left)


class LikelihoodFit(NamedTuple):
    """The likelihood of one test as a function of d coordinates."""

    z: FloatArray  # (n, d), the draws at which it is known
    log_ratios: FloatArray  # (n,), log of the likelihood over that of the components, there
    components: FloatArray  # (K, d + 1, d + 1), forms of the best fit
    second: FloatArray  # likewise of the second best, which tells how uncertain it is

    def within(self, columns: Sequence[int]) -> "LikelihoodFit":
        """The fit as a function of some coordinates, the others averaged over N(0, I)."""
        others = np.setdiff1d(np.arange(self.z.shape[1]), columns)
        of_both = (averaged(forms, others) for forms in (self.components, self.second))
        return LikelihoodFit(self.z[:, columns], self.log_ratios, *of_both)


def fit_likelihood(
    z: FloatArray, log_likelihoods: FloatArray, log_evidence: float, rng: np.random.Generator
) -> LikelihoodFit:
    """Fit the ``log_likelihoods`` (n,) of one test at draws ``z`` (n, d) of its posterior.

    The number of components grows until the error is small or draws are too few.
    """
    n, d = z.shape
    # In coordinates x in which the posterior is a standard one.
    origin, unit = z.mean(axis=0), z.std(axis=0)
    x, prior = (z - origin) / unit, mapped(standard_form(d), origin, unit)
    prior[d, d] -= 2.0 * np.log(unit).sum()
    known = x, log_likelihoods, prior, log_evidence
    fits = [_least_squares(_one_component(x, log_likelihoods), *known)]
    for count in NUMBERS_OF_COMPONENTS:
        errors = [error for _, error in fits]
        enough = FIT_ERROR if len(fits) > 1 else EXACT_FIT_ERROR
        few = count * (1 + d + d * (d + 1) // 2) > n / DRAWS_PER_NUMBER
        if min(errors) < enough or few:
            break
        start = _mixture_over_prior(x, prior, count, rng)
        start[:, d, d] -= 2.0 * np.mean(log_likelihoods - log_sum(start, x))
        fits.append(_least_squares(start, *known))
    fits.sort(key=lambda fit: fit[1])
    best, second = fits[0][0], fits[min(1, len(fits) - 1)][0]
    of_z = (mapped(forms, -origin / unit, 1.0 / unit) for forms in (best, second))
    return LikelihoodFit(z, log_likelihoods - log_sum(best, x), *of_z)


def _one_component(x: FloatArray, log_likelihoods: FloatArray) -> FloatArray:
    """The form (1, d + 1, d + 1) of a quadratic fitted to the log-likelihoods at x (n, d)."""
    points = np.insert(x, x.shape[1], 1.0, axis=1)
    rows, columns = np.triu_indices(points.shape[1])
    coefficients = np.linalg.lstsq(points[:, rows] * points[:, columns], log_likelihoods)[0]
    upper = np.zeros((1, *[points.shape[1]] * 2))
    upper[:, rows, columns] = coefficients
    return _not_rising(-(upper + upper.swapaxes(1, 2)))


def _mixture_over_prior(
    x: FloatArray, prior: FloatArray, count: int, rng: np.random.Generator
) -> FloatArray:
    """Forms (K, d + 1, d + 1) of a mixture fitted to draws x (n, d), divided by the prior."""
    mixture = fit_mixture(x, count, LIGHT_TAILS, rng)
    d, (means, factors) = x.shape[1], (mixture.means, mixture.factors)
    about_means = np.zeros((len(means), d + 1, d + 1))
    about_means[:, :d, :d] = np.linalg.inv(factors @ factors.swapaxes(1, 2))
    about_means[:, d, d] = 2.0 * (np.linalg.slogdet(factors)[1] - np.log(mixture.weights))
    ones = np.ones(d)
    return mapped(_not_rising(about_means - mapped(prior, means, ones)), -means, ones)


def _not_rising(forms: FloatArray) -> FloatArray:
    """Components with the same values and slopes at zero that rise away from it in no direction."""
    roots = _roots(forms)
    forms[:, :-1, :-1] = roots.swapaxes(1, 2) @ roots
    return forms


def _roots(forms: FloatArray) -> FloatArray:
    """Upper triangular R (K, d, d), R'·R the part of a form without its negative eigenvalues."""
    eigenvalues, vectors = np.linalg.eigh(forms[:, :-1, :-1])
    kept = np.sqrt(np.maximum(eigenvalues, 0.0))
    return np.asarray(np.linalg.qr(kept[:, :, None] * vectors.swapaxes(1, 2), mode="r"))


def numbers_of(forms: FloatArray) -> FloatArray:
    """What is fitted, in one row: constants, slopes and roots of components."""
    rows, columns = np.triu_indices(forms.shape[1] - 1)
    parts = -0.5 * forms[:, -1, -1], -forms[:, -1, :-1], _roots(forms)[:, rows, columns]
    return np.concatenate([part.ravel() for part in parts])


def forms_of(numbers: FloatArray, d: int) -> tuple[FloatArray, FloatArray]:
    """The forms with these :func:`numbers_of`, in d coordinates, and their roots (K, d, d)."""
    rows, columns = np.triu_indices(d)
    k = len(numbers) // (1 + d + len(rows))
    constants, slopes, upper = np.split(numbers, [k, k + k * d])
    roots, forms = np.zeros((k, d, d)), np.empty((k, d + 1, d + 1))
    roots[:, rows, columns] = upper.reshape(k, -1)
    forms[:, :d, :d] = roots.swapaxes(1, 2) @ roots
    forms[:, d, :d] = forms[:, :d, d] = -slopes.reshape(k, d)
    forms[:, d, d] = -2.0 * constants
    return forms, roots


def sum_by_numbers(forms: FloatArray, roots: FloatArray, z: FloatArray) -> FloatArray:
    """Derivatives (n, n_numbers) of :func:`log_sum` at ``z`` (n, d)."""
    shares, _ = _shares(log_parts(forms, z))
    return _by_numbers(shares, roots, z[:, None], z[:, None, :, None] * z[:, None, None])


def integral_by_numbers(forms: FloatArray, roots: FloatArray, weight: FloatArray) -> FloatArray:
    """Derivatives (1, n_numbers) of the log of the sum's integral over another component."""
    whole = forms + weight
    covariances = np.linalg.inv(whole[:, :-1, :-1])
    means = -(covariances @ whole[:, :-1, -1:])[..., 0]
    shares, _ = _shares(log_integrals(whole)[None])
    squares = covariances + means[:, :, None] * means[:, None]
    return _by_numbers(shares, roots, means[None], squares[None])


def _by_numbers(
    shares: FloatArray, roots: FloatArray, means: FloatArray, squares: FloatArray
) -> FloatArray:
    """Derivatives of log sums (n,) of K parts, from means of z and of its products in each."""
    rows, columns = np.triu_indices(roots.shape[1])
    by_slopes = shares[:, :, None] * means
    by_roots = -shares[:, :, None] * (roots @ squares)[..., rows, columns]
    parts = [part.reshape(len(shares), -1) for part in (shares, by_slopes, by_roots)]
    return np.concatenate(parts, axis=1)


def _least_squares(
    start: FloatArray,
    x: FloatArray,
    log_likelihoods: FloatArray,
    prior: FloatArray,
    log_evidence: float,
) -> tuple[FloatArray, float]:
    """The forms that a search for the least squares comes to, and the root of their mean."""
    from scipy.optimize import least_squares

    n, d = x.shape
    off = float(np.sqrt(np.mean((log_sum(start, x) - log_likelihoods) ** 2)))
    if off < EXACT_FIT_ERROR:
        return start, off
    weight = EVIDENCE_WEIGHT * np.sqrt(n)

    def residuals(numbers: FloatArray) -> FloatArray:
        forms, _ = forms_of(numbers, d)
        try:
            integral = np.logaddexp.reduce(log_integrals(forms + prior))
        except np.linalg.LinAlgError:
            # A step so far that precisions are rounded to singular: no search may stay there.
            return np.full(n + 1, 1e6)
        return np.append(log_sum(forms, x) - log_likelihoods, weight * (integral - log_evidence))

    def derivatives(numbers: FloatArray) -> FloatArray:
        forms, roots = forms_of(numbers, d)
        of_integral = weight * integral_by_numbers(forms, roots, prior)
        return np.concatenate([sum_by_numbers(forms, roots, x), of_integral])

    first = numbers_of(start)
    search = least_squares(residuals, first, derivatives, method="lm", max_nfev=MOST_EVALUATIONS)
    return forms_of(search.x, d)[0], float(np.sqrt(2.0 * search.cost / n))
