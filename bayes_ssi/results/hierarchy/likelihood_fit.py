"""The likelihood of one test as a sum of Gaussians, fitted to its values at the stored draws.

At every stored draw the likelihood itself is known, not only how often the draw occurs: the sum is
fitted to its logarithm by least squares. A likelihood that is normal in form is matched exactly in
this way, however few the draws, and its integrals over normal populations are known in closed form.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.mixture import LIGHT_TAILS, fit_mixture
from bayes_ssi.inference.sampling.target import log_standard_normal

# Root mean square error of a log-likelihood, in nats, that is good enough: with that of each of
# a hundred tests, their sum is off by a fifth of a nat, before the draws correct it.
FIT_ERROR = 0.02
# The same of a likelihood that is normal in form, but for rounding.
EXACT_FIT_ERROR = 1e-6
# That are tried, until they lower the error by less than ``LEAST_GAIN``.
NUMBERS_OF_COMPONENTS = (2, 4, 8)
LEAST_GAIN = 0.8  # largest ratio of errors for which more components are worth it
# For each number that is fitted. Likelihoods at draws have no noise: a few pin it down, where
# draws alone would need many.
DRAWS_PER_NUMBER = 4
# With which the stored evidence counts in a fit. It is known to about a hundredth of a nat; by
# a tenth, its error is that of a likelihood known to a thousandth.
EVIDENCE_WEIGHT = 0.1
MOST_EVALUATIONS = 60  # in one search for the least squares


class GaussianSum(NamedTuple):
    """A sum of K functions exp(constant + slope·z - |root·z|²/2) of d coordinates.

    Each is a multiple of a normal density, except that it may be flat in some directions, about
    which the data say nothing.
    """

    constants: FloatArray  # (K,), in nats
    slopes: FloatArray  # (K, d)
    roots: FloatArray  # (K, d, d), upper triangular; root'·root is the precision of a component

    @property
    def precisions(self) -> FloatArray:
        """(K, d, d), positive semi-definite."""
        return np.einsum("kli,klj->kij", self.roots, self.roots)

    def log_sum(self, z: FloatArray) -> FloatArray:
        """The logarithm (n,) of the sum at ``z`` (n, d)."""
        return _shares(self._log_parts(z)[0])[1]

    def _log_parts(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Logarithms of the components (n, K), and root·z (n, K, d)."""
        rooted = np.einsum("kij,nj->nki", self.roots, z)
        squares = np.einsum("nki,nki->nk", rooted, rooted)
        return self.constants + np.einsum("kj,nj->nk", self.slopes, z) - 0.5 * squares, rooted

    def derivatives(self, z: FloatArray) -> FloatArray:
        """Derivatives (n, n_numbers) of :meth:`log_sum` by the numbers of :attr:`flat`."""
        log_parts, rooted = self._log_parts(z)
        shares, _ = _shares(log_parts)
        by_slopes = shares[:, :, None] * z[:, None]
        rows, columns = np.triu_indices(z.shape[1])
        by_roots = -rooted[..., rows] * by_slopes[..., columns]
        parts = [part.reshape(len(z), -1) for part in (shares, by_slopes, by_roots)]
        return np.concatenate(parts, axis=1)

    @property
    def flat(self) -> FloatArray:
        """All numbers in one row, of the roots the upper triangles, below which they are zero."""
        rows, columns = np.triu_indices(self.slopes.shape[1])
        upper = self.roots[:, rows, columns]
        return np.concatenate([self.constants, self.slopes.ravel(), upper.ravel()])

    @classmethod
    def from_flat(cls, numbers: FloatArray, d: int) -> "GaussianSum":
        """The components of d coordinates whose :attr:`flat` is ``numbers``."""
        rows, columns = np.triu_indices(d)
        k = len(numbers) // (1 + d + len(rows))
        constants, slopes, upper = np.split(numbers, [k, k + k * d])
        roots = np.zeros((k, d, d))
        roots[:, rows, columns] = upper.reshape(k, -1)
        return cls(constants, slopes.reshape(k, d), roots)

    @classmethod
    def at_points(
        cls, points: FloatArray, values: FloatArray, gradients: FloatArray, precisions: FloatArray
    ) -> "GaussianSum":
        """Components with given logarithms (K,), gradients and precisions at ``points`` (K, d).

        Negative eigenvalues of the symmetric ``precisions`` (K, d, d) are replaced by zero.
        """
        eigenvalues, vectors = np.linalg.eigh(precisions)
        kept = np.sqrt(np.maximum(eigenvalues, 0.0))
        # R of the QR factors: upper triangular.
        squares = kept[:, :, None] * vectors.transpose(0, 2, 1)
        roots: FloatArray = np.asarray(np.linalg.qr(squares, mode="r"))
        rooted = np.einsum("kij,kj->ki", roots, points)
        slopes = gradients + np.einsum("kij,ki->kj", roots, rooted)
        squares = np.einsum("ki,ki->k", rooted, rooted)
        constants = values - np.einsum("ki,ki->k", slopes, points) + 0.5 * squares
        return cls(constants, slopes, roots)

    def in_coordinates(self, origin: FloatArray, unit: FloatArray) -> "GaussianSum":
        """The same functions of z, where they now are of (z - ``origin``) / ``unit``, each (d,)."""
        roots = self.roots / unit
        at_origin = np.einsum("kij,j->ki", roots, origin)
        slopes = self.slopes / unit + np.einsum("kij,ki->kj", roots, at_origin)
        squares = np.einsum("ki,ki->k", at_origin, at_origin)
        constants = self.constants - (self.slopes / unit) @ origin - 0.5 * squares
        return GaussianSum(constants, slopes, roots)

    def log_integral(self, weight: "GaussianSum") -> tuple[float, FloatArray]:
        """The logarithm of the integral of the sum times one other component, and its derivatives.

        The derivatives are by the numbers of :attr:`flat`.
        """
        precisions = self.precisions + weight.precisions
        slopes = self.slopes + weight.slopes
        means = np.linalg.solve(precisions, slopes[..., None])[..., 0]
        log_determinants = np.linalg.slogdet(precisions / (2.0 * np.pi))[1]
        gained = 0.5 * (np.einsum("ki,ki->k", means, slopes) - log_determinants)
        log_parts = self.constants + weight.constants + gained
        (shares,), (total,) = _shares(log_parts[None])
        squares = np.linalg.inv(precisions) + means[:, :, None] * means[:, None]
        rows, columns = np.triu_indices(means.shape[1])
        by_roots = (
            -shares[:, None] * np.einsum("kij,kjl->kil", self.roots, squares)[:, rows, columns]
        )
        by_slopes = shares[:, None] * means
        return float(total), np.concatenate([shares, by_slopes.ravel(), by_roots.ravel()])

    def integrated_over(self, others: NDArray[np.intp]) -> "GaussianSum":
        """The components of the remaining coordinates, the ``others`` averaged over N(0, I)."""
        d = self.slopes.shape[1]
        kept = np.setdiff1d(np.arange(d), others)
        precisions = self.precisions
        of_others = np.eye(len(others)) + precisions[:, others][:, :, others]
        across = precisions[:, others][:, :, kept]
        of_slopes = np.linalg.solve(of_others, self.slopes[:, others, None])[..., 0]
        of_across = np.linalg.solve(of_others, across)
        log_determinants = np.linalg.slogdet(of_others)[1]
        gained = np.einsum("ki,ki->k", self.slopes[:, others], of_slopes)
        zeros = np.zeros((len(self.constants), len(kept)))
        return GaussianSum.at_points(
            zeros,
            self.constants + 0.5 * (gained - log_determinants),
            self.slopes[:, kept] - np.einsum("kij,ki->kj", across, of_slopes),
            precisions[:, kept][:, :, kept] - np.einsum("kli,klj->kij", across, of_across),
        )


def _shares(log_parts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shares (n, K) of parts in their sum, and its logarithm (n,); faster than scipy's."""
    highest = log_parts.max(axis=1, keepdims=True)
    parts = np.exp(log_parts - highest)
    totals = parts.sum(axis=1, keepdims=True)
    return parts / totals, (np.log(totals) + highest)[:, 0]


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    components: GaussianSum  # the best fit
    second: GaussianSum  # the second best, which tells how uncertain it is
    log_ratios: FloatArray  # (n,), log of the likelihood over that of the components, at the draws

    @property
    def error(self) -> float:
        """Root mean square of the log ratios."""
        return float(np.sqrt(np.mean(self.log_ratios**2)))


def fit_likelihood(
    z: FloatArray, log_likelihoods: FloatArray, log_evidence: float, rng: np.random.Generator
) -> LikelihoodFit:
    """Fit the ``log_likelihoods`` (n,) of one test at draws ``z`` (n, d) of its posterior.

    The number of components grows until that no longer helps.
    """
    fitting = _Fitting(z, log_likelihoods, log_evidence)
    n, d = z.shape
    fits = [fitting.least_squares(fitting.one_component)]
    for count in NUMBERS_OF_COMPONENTS:
        errors = [error for _, error in fits]
        enough = FIT_ERROR if len(fits) > 1 else EXACT_FIT_ERROR
        in_vain = len(fits) > 1 and errors[-1] > LEAST_GAIN * errors[-2]
        few = count * (1 + d + d * (d + 1) // 2) > n / DRAWS_PER_NUMBER
        if min(errors) < enough or few or in_vain:
            break
        fits.append(fitting.least_squares(fitting.mixture(count, rng)))
    fits.sort(key=lambda fit: fit[1])
    best, second = fits[0][0], fits[min(1, len(fits) - 1)][0]
    return LikelihoodFit(
        best.in_coordinates(fitting.origin, fitting.unit),
        second.in_coordinates(fitting.origin, fitting.unit),
        log_likelihoods - best.log_sum(fitting.x),
    )


class _Fitting:
    """What components are fitted to, in coordinates in which the posterior is a standard one.

    With the mean and the standard deviation of the draws, x = (z - origin) / unit.
    """

    def __init__(self, z: FloatArray, log_likelihoods: FloatArray, log_evidence: float) -> None:
        d = z.shape[1]
        self.origin, self.unit = z.mean(axis=0), z.std(axis=0)
        self.x = (z - self.origin) / self.unit
        self.log_likelihoods, self.log_evidence = log_likelihoods, log_evidence
        self.prior = GaussianSum.at_points(
            np.zeros((1, d)),
            log_standard_normal(self.origin[None]) + np.log(self.unit).sum(),
            -(self.origin * self.unit)[None],
            np.diag(self.unit**2)[None],
        )

    def least_squares(self, start: GaussianSum) -> tuple[GaussianSum, float]:
        """The least squares that a search from ``start`` comes to, and their mean's root."""
        from scipy.optimize import least_squares

        n, d = self.x.shape
        off = float(np.sqrt(np.mean((start.log_sum(self.x) - self.log_likelihoods) ** 2)))
        if off < EXACT_FIT_ERROR:
            return start, off
        weight = EVIDENCE_WEIGHT * np.sqrt(n)

        def residuals(numbers: FloatArray) -> FloatArray:
            components = GaussianSum.from_flat(numbers, d)
            try:
                off = components.log_integral(self.prior)[0] - self.log_evidence
            except np.linalg.LinAlgError:
                # A step so far that precisions are rounded to singular: no search may stay there.
                return np.full(n + 1, 1e6)
            return np.append(components.log_sum(self.x) - self.log_likelihoods, weight * off)

        def derivatives(numbers: FloatArray) -> FloatArray:
            components = GaussianSum.from_flat(numbers, d)
            of_integral = weight * components.log_integral(self.prior)[1]
            return np.vstack([components.derivatives(self.x), of_integral])

        search = least_squares(
            residuals, start.flat, derivatives, method="lm", max_nfev=MOST_EVALUATIONS
        )
        return GaussianSum.from_flat(search.x, d), float(np.sqrt(2.0 * search.cost / n))

    @property
    def one_component(self) -> GaussianSum:
        d = self.x.shape[1]
        rows, columns = np.triu_indices(d)
        products = self.x[:, rows] * self.x[:, columns]
        design = np.column_stack([np.ones(len(self.x)), self.x, products])
        coefficients: FloatArray = np.linalg.lstsq(design, self.log_likelihoods)[0].astype(float)
        upper = np.zeros((d, d))
        upper[rows, columns] = coefficients[1 + d :]
        slopes = coefficients[None, 1 : 1 + d]
        return GaussianSum.at_points(
            np.zeros((1, d)), coefficients[:1], slopes, -(upper + upper.T)[None]
        )

    def mixture(self, count: int, rng: np.random.Generator) -> GaussianSum:
        """The shape of a mixture fitted to the draws, divided by the prior."""
        mixture = fit_mixture(self.x, count, LIGHT_TAILS, rng)
        covariances = mixture.factors @ mixture.factors.transpose(0, 2, 1)
        precision = self.prior.precisions[0]
        heights = np.log(mixture.weights) - 0.5 * np.linalg.slogdet(covariances)[1]
        components = GaussianSum.at_points(
            mixture.means,
            heights - self.prior.log_sum(mixture.means),
            mixture.means @ precision - self.prior.slopes,
            np.linalg.inv(covariances) - precision,
        )
        missing = float(np.mean(self.log_likelihoods - components.log_sum(self.x)))
        return GaussianSum(components.constants + missing, components.slopes, components.roots)
