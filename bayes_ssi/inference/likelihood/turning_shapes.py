"""Mean densities of identified shapes beside two modes that turn together (see ``close_modes``).

Of one turn, whose integrand may be next to flat, have several maxima, be narrower than any grid, or
have a gap where no sensor sees one of the modes.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import ive

from bayes_ssi.foundations.arrays import BoolArray, FloatArray, IntArray, folded, row_sums

TINY = 1e-9  # concentrations that cannot be told from none
ROUNDING = 4.0 * np.finfo(float).eps
# Nodes at equal steps: of the least of these numbers that puts them 0.8 standard deviations of the
# narrowest maximum apart. Sums over every other one are then right to some per cent, and where they
# agree, those over all are right to a higher power of that.
EVEN_TURNS = np.array([64, 128, 256, 512])
PER_STRENGTH = 5.0
EVEN_DISAGREE = 0.005
PER_GAP = 2.0  # the least number that puts a node into every gap that is wider than this:
LEAST_GAP = 0.002
# At first a few about one turn, at so many of these steps over the root of the strength of all
# pulls: 0.8 standard deviations at least. Sums over every other one, which differ by 0.09 % for a
# normal density, are to agree; an integrand with several maxima may do so by chance to half a per
# cent.
FEW_TURNS, STEP, FEW_DISAGREE = 24, 0.4, 0.0015
UNEVEN = 0.3  # of a step, as every other node would be the other's mirror image with 0.5
# Nodes until sums over every other one agree: about the highest turn, then about several.
NUMBERS_OF_NODES = (24, 96, 384, 1536)
DISAGREE = 3e-4
NEGLIGIBLE = -12.0  # exponent below the maximum
IMPROBABLE = -4.5  # the same, of a normal variable three standard deviations from its mean
# Squared length over its mean over turns, below which rounding turns shapes, where such lengths
# reach what rounding leaves of none; sensors see others at every turn, however little.
UNSEEN, VANISHING = 1e-4, 1e-12
LEAST_WIDTH = 1e-6  # of a smaller turn, rounding leaves 1 - cos 2t fewer than four digits
SPREAD = 2.0  # of nodes, in standard deviations of turns
GRID, FINER_GRIDS = 48, 5  # turns at which the highest is sought, and how often anew about it
CACHED = 2**14  # numbers at a time, for arrays that stay in the processor's cache


class TurningShapes(NamedTuple):
    """m identified shapes φ_e beside two modes that turn together, in E cases.

    ``(φ_e·φ(t))²`` and ``|φ(t)|²`` are each a constant and multiples of cos 2t and of sin 2t.
    """

    squares: FloatArray  # (3, m, E)
    lengths: FloatArray  # (3, m, E)
    # (2, m, E), cosine and sine of twice the turn at which the unit shape is nearest to φ_e, times
    # a quarter of the bend of |φ_e·φ(t)|/σ² there.
    pulls: FloatArray
    variances: FloatArray  # (m, E), squared errors σ² of the shapes; infinite where there is none

    @classmethod
    def of(
        cls,
        shapes: FloatArray,
        partners: FloatArray,
        units: FloatArray,
        measured: FloatArray,
        variances: FloatArray,
    ) -> "TurningShapes":
        """Of model shapes cos t · shape + sin t · partner.

        Args:
            shapes: (s, m, E), model shapes at the sensors, of the modes identified.
            partners: the same, of what they turn to: the upper mode, or minus the lower one.
            units: the same, identified unit shapes, 0 where not measured.
            measured: the same, 1 where measured and 0 elsewhere.
            variances: (m, E).
        """
        products = np.array([shapes * shapes, shapes * partners, partners * partners])
        aa, ab, bb = row_sums(products * measured)
        a, b = row_sums(np.array([units * shapes, units * partners]))
        x, y = a * bb - b * ab, b * aa - a * ab  # along the projection of φ_e on the plane
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            square = x * x + y * y
            length = (aa * x * x + 2.0 * ab * x * y + bb * y * y) / square
            bend = abs(a * x + b * y) / np.sqrt(square * length)
            bend *= (aa * bb - ab * ab) / (4.0 * length * length * variances)
            pulls = np.array([x * x - y * y, 2.0 * x * y]) * (bend / square)
        squares, lengths = (
            np.array([0.5 * (first + last), 0.5 * (first - last), mixed])
            for first, mixed, last in ((a * a, a * b, b * b), (aa, ab, bb))
        )
        # Not zero by rounding; and of one that no sensor sees, any number.
        lengths[0] = np.where(lengths[0] > 0.0, (1.0 + ROUNDING) * lengths[0], 1.0)
        return cls(squares, lengths, np.nan_to_num(pulls, posinf=0.0, neginf=0.0), variances)

    def distances(self, cos2: FloatArray, sin2: FloatArray) -> FloatArray:
        """1 - |φ_e·φ(t)|, (m, n, E) at turns (n, E)."""
        return np.array([self._distance(e, cos2, sin2) for e in range(len(self.variances))])

    def _distance(self, e: int, cos2: FloatArray, sin2: FloatArray) -> FloatArray:
        """Of one shape, (n, E): arrays that are small enough to be allocated without delay."""
        above, below = (terms[1, e] * cos2 for terms in (self.squares, self.lengths))
        for total, terms in ((above, self.squares), (below, self.lengths)):
            total += terms[2, e] * sin2
            total += terms[0, e]
        above /= below
        np.sqrt(np.clip(above, 0.0, 1.0, out=above), out=above)
        return np.asarray(np.subtract(1.0, above, out=above))

    def are_unseen(self, cos2: FloatArray, sin2: FloatArray) -> BoolArray:
        """Whether sensors see next to nothing of one of the shapes at turns (n, E), (n, E)."""
        constant, of_cos, of_sin = self.lengths[:, :, None]
        lengths = constant + of_cos * cos2 + of_sin * sin2
        vanish = constant - np.hypot(of_cos, of_sin) < VANISHING * constant
        unseen = (lengths < UNSEEN * constant) & vanish & np.isfinite(self.variances)[:, None]
        return np.asarray(unseen.any(axis=0))

    @property
    def highest_exponents(self) -> FloatArray:
        """What -(1 - |φ_e·φ(t)|)/σ² is at the best turn for each shape, (m, E)."""
        strength = np.hypot(*self.pulls)
        with np.errstate(divide="ignore", invalid="ignore"):
            cos2, sin2 = self.pulls / strength
            above, below = (
                constant + of_cos * cos2 + of_sin * sin2
                for constant, of_cos, of_sin in (self.squares, self.lengths)
            )
            distances = 1.0 - np.sqrt(np.clip(above / below, 0.0, 1.0))
        return np.where(strength > TINY, -distances / self.variances, 0.0)

    @property
    def gaps(self) -> FloatArray:
        """Widths (m, E) of the turns at which a shape does not fit, where no sensor sees it.

        Infinite where there is none, or next to none.
        """
        change = np.hypot(*self.lengths[1:])
        with np.errstate(divide="ignore", invalid="ignore"):
            least = np.sqrt((self.lengths[0] - change) / (self.lengths[0] + change))
            widths = least * (1.0 + 1.0 / np.sqrt(0.5 * self.variances))
        seen = np.isfinite(self.variances) & (widths > LEAST_GAP)
        return np.where(seen, widths, np.inf)

    def exponents(self, kappa: FloatArray, cos2: FloatArray, sin2: FloatArray) -> FloatArray:
        """κ' (cos 2t - 1) - Σ (1 - |φ_e·φ(t)|)/σ², (n, E), at turns (n, E)."""
        exponents = np.asarray(kappa * (cos2 - 1.0))
        for e, variances in enumerate(self.variances):
            distances = self._distance(e, cos2, sin2)
            distances /= variances
            exponents -= distances
        return exponents

    def cases(self, which: IntArray) -> "TurningShapes":
        return TurningShapes(*(terms[..., which] for terms in self))


class Turned(NamedTuple):
    """Close modes as their identified shapes see them, in E cases."""

    log_means: FloatArray  # (E,), of exp(-Σ (1 - |φ_e·φ(t)|)/σ²) over turns
    log_gains: FloatArray  # (E,), the same over that at the turn ``angles``
    # (E,), the mean turn under it; the most probable one where shapes fit on both sides of the mean
    # and not there, as at a turn that no sensor sees.
    angles: FloatArray
    distances: FloatArray  # (m, E), 1 - |φ_e·φ(t)| at that turn

    @classmethod
    def of(
        cls, concentrations: FloatArray, shapes: TurningShapes, least: FloatArray | float = -np.inf
    ) -> "Turned":
        """From κ' (E,), infinite where nothing turns, as where no exponent is above ``least`` (E,).

        First a few nodes are about the turn between all pulls. Where that is not the whole
        integral, they are spread evenly, if few resolve the narrowest maximum that there can be.
        Where it takes many, or sums over every other one differ, they are about the highest turn,
        and about each of those that the density of turns or a shape asks for.
        """
        highest = shapes.highest_exponents
        turns = np.isfinite(concentrations) & (row_sums(highest[None])[0] >= least)
        kappa = np.where(turns, concentrations, 0.0)
        means = np.zeros((3, len(kappa)))
        accurate = ~turns
        for some in _parts(np.flatnonzero(turns), FEW_TURNS):
            own = kappa[some], shapes.cases(some), highest[:, some]
            means[:, some], accurate[some] = _about_one_turn(*own)
        left = np.flatnonzero(~accurate)
        if len(left):
            own = kappa[left], shapes.cases(left), highest[:, left]
            means[:, left], accurate = _over_even_turns(*own)
            left = left[~accurate]
        if len(left):
            means[:, left] = _about_turns(kappa[left], shapes.cases(left))
        log_means, top, angles = means
        cosines = _cosines(angles[None])
        distances = shapes.distances(*cosines)[:, 0]
        exponents = row_sums((distances / shapes.variances)[None])[0]
        improbable = kappa * (cosines[0][0] - 1.0) - exponents < top + IMPROBABLE
        unfit = np.flatnonzero(turns & (improbable | shapes.are_unseen(*cosines)[0]))
        if len(unfit):
            of_unfit = shapes.cases(unfit)
            cos2, sin2 = _highest(kappa[unfit], of_unfit)[0]
            angles[unfit] = 0.5 * np.arctan2(sin2, cos2)
            distances[:, unfit] = of_unfit.distances(*_cosines(angles[None, unfit]))[:, 0]
            exponents[unfit] = row_sums((distances[:, unfit] / of_unfit.variances)[None])[0]
        log_means = np.where(turns, log_means - np.log(ive(0, kappa)), -exponents)
        return cls(log_means, log_means + exponents, angles, distances)


def _about_one_turn(
    kappa: FloatArray, shapes: TurningShapes, of_shapes: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """As of `_over_even_turns`, within a few standard deviations of the turn between all pulls.

    The density of turns and that of each shape have one maximum and one minimum. Beyond the ends,
    each is at most what it is at one of them, or at its maximum if that is beyond, too. Where the
    product of these is negligible, nothing else is left out.
    """
    pulls = np.concatenate([np.array([kappa, 0.0 * kappa])[:, None], shapes.pulls], axis=1)
    strengths, total = np.hypot(*pulls), row_sums(pulls)
    c, s = total / np.maximum(np.hypot(*total), TINY)
    reach = 0.5 * FEW_TURNS * STEP / np.sqrt(np.maximum(row_sums(strengths[None])[0], TINY))
    reach = np.minimum(reach, 0.5 * math.pi)
    cos_r, sin_r = _cosines(reach * np.array([[-1.0], [1.0]]))
    ends = c * cos_r - s * sin_r, s * cos_r + c * sin_r
    at_ends = -shapes.distances(*ends).min(axis=1) / shapes.variances
    most = np.concatenate([kappa * (ends[0].max(axis=0) - 1.0)[None], at_ends])
    is_beyond = pulls[0] * c + pulls[1] * s < strengths * cos_r[0]
    of_each = np.concatenate([np.zeros((1, len(kappa))), of_shapes])
    beyond = row_sums(np.where(is_beyond, of_each, most)[None])[0]
    cos2, sin2 = _cosines_of_steps(FEW_TURNS, reach)
    cosines = c * cos2 - s * sin2, s * cos2 + c * sin2
    means, disagreement = _integrated(shapes.exponents(kappa, *cosines), *cosines)
    is_all = (reach >= 0.5 * math.pi) | (beyond < means[1] + NEGLIGIBLE)
    accurate = is_all & (disagreement < FEW_DISAGREE)
    means[0] += np.log(2.0 / math.pi * reach)
    return means, accurate & (2.0 * reach <= FEW_TURNS * shapes.gaps.min(axis=0))


def _over_even_turns(
    kappa: FloatArray, shapes: TurningShapes, of_shapes: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Log integrals, the highest exponents and mean turns (3, E); which are accurate.

    Over turns at equal steps, within the reach of the density of turns: sums converge exponentially
    for integrands that are periodic, or vanish at both ends.
    """
    at_rest = shapes.exponents(kappa, np.ones((1, 1)), np.zeros((1, 1)))[0]
    with np.errstate(divide="ignore"):
        share = (row_sums(of_shapes[None])[0] - at_rest - NEGLIGIBLE) / (2.0 * kappa)  # of sin² t
        reach = np.arcsin(np.sqrt(np.clip(share, 0.0, 1.0)))
    strengths = kappa + row_sums(np.hypot(*shapes.pulls)[None])[0]
    numbers = np.searchsorted(EVEN_TURNS, PER_STRENGTH * reach * np.sqrt(strengths))
    in_gaps = PER_GAP * reach / shapes.gaps.min(axis=0)
    numbers = np.maximum(numbers, np.searchsorted(EVEN_TURNS[:-1], in_gaps))
    means = np.zeros((3, len(kappa)))
    for which, n in enumerate(EVEN_TURNS.tolist()):
        for some in _parts(np.flatnonzero(numbers == which), n):
            cosines = _cosines_of_steps(n, reach[some])
            exponents = shapes.cases(some).exponents(kappa[some], *cosines)
            means[:, some], disagreement = _integrated(exponents, *cosines)
            numbers[some] += disagreement > EVEN_DISAGREE
    means[0] += np.log(2.0 / math.pi * reach)
    return means, numbers < len(EVEN_TURNS)


def _parts(cases: IntArray, n: int) -> list[IntArray]:
    """So many cases at a time that n numbers of each stay in the processor's cache."""
    step = max(CACHED // n, 1)
    return [cases[first : first + step] for first in range(0, len(cases), step)]


def _about_turns(kappa: FloatArray, shapes: TurningShapes) -> FloatArray:
    """As of `_over_even_turns`, of integrands that may have a sharp maximum at any turn.

    Nodes are about the highest turn of a grid; where that will not do, or another of the turns that
    the density of turns or a shape asks for may be a maximum by itself, about each of these, too.
    """
    of_density = np.array([kappa, np.zeros(len(kappa))])[:, None]
    pulls = np.concatenate([of_density, shapes.pulls], axis=1)
    strengths = np.maximum(np.hypot(*pulls), TINY)
    asked = np.where(strengths > TINY, pulls / strengths, [[[1.0]], [[0.0]]])
    heights = shapes.exponents(kappa, *asked)
    top, width, highest, several = _highest(kappa, shapes)
    away = 1.0 - row_sums((asked * top[:, None])[None])[0]
    apart = (away > 2.0 * (4.0 * width) ** 2) & (heights > highest + NEGLIGIBLE)
    several |= apart.any(axis=0) | (highest < heights.max(axis=0))
    centres = np.concatenate([top[:, None], asked], axis=1)
    widths = np.clip(0.5 * SPREAD / np.sqrt(strengths), LEAST_WIDTH, 1.0)
    widths = np.concatenate([width[None], widths])
    means, left = np.zeros((3, len(kappa))), np.arange(len(kappa))
    for attempt, n in enumerate(NUMBERS_OF_NODES):
        nodes = (centres[:, :1], widths[:1]) if attempt == 0 else (centres, widths)
        accurate = np.empty(len(left), dtype=bool)
        for part in _parts(np.arange(len(left)), n * len(nodes[1])):
            some = left[part]
            own = nodes[0][..., some], nodes[1][..., some], kappa[some], shapes.cases(some)
            means[:, some], disagreement = _about_centres(n, *own)
            accurate[part] = disagreement < DISAGREE
        if attempt == 0:
            accurate &= ~several
        left = left[~accurate]
        if not len(left):
            break
    return means


def _highest(
    kappa: FloatArray, shapes: TurningShapes
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """The turns (2, E) with the highest exponents, cosines and sines of twice them.

    And widths and exponents there, and whether the first grid has other maxima that may matter.
    Shapes that disagree are nearest at a turn to which none of them points. About the best of a
    grid, a finer one takes its place several times.
    """
    turns, steps = np.zeros((1, len(kappa))), np.arange(GRID)[:, None] - 0.5 * GRID
    spacing, has_others = math.pi / GRID, np.zeros(len(kappa), dtype=bool)
    for level in range(FINER_GRIDS):
        tried = turns + spacing * steps
        cosines = _cosines(tried)
        exponents = shapes.exponents(kappa, *cosines)
        exponents[shapes.are_unseen(*cosines)] = -np.inf
        if level == 0:
            before, after = (np.roll(exponents, step, axis=0) for step in (1, -1))
            maxima = (exponents > before) & (exponents > after)
            near = exponents > exponents.max(axis=0) + 2.0 * NEGLIGIBLE  # peaks are between turns
            has_others = (maxima & near).sum(axis=0) > 1
        best = exponents.argmax(axis=0), np.arange(len(kappa))
        turns = tried[best][None]
        steps, spacing = np.arange(-4.0, 5.0)[:, None], 0.25 * spacing
    beside = turns + spacing * np.array([[-1.0], [0.0], [1.0]])
    below, at, above = shapes.exponents(kappa, *_cosines(beside))
    bend = np.maximum((2.0 * at - below - above) / spacing**2, 1.0)
    widths = np.clip(SPREAD / np.sqrt(bend), LEAST_WIDTH, 1.0)
    return np.array(_cosines(turns[0])), widths, at, has_others


def _about_centres(
    n: int, centres: FloatArray, widths: FloatArray, kappa: FloatArray, shapes: TurningShapes
) -> tuple[FloatArray, FloatArray]:
    """As of `_integrated`.

    n nodes about each of K centres (2, K, E), cosines and sines of twice a turn c, have Cauchy
    densities q_k of widths (K, E) in tan(t - c): midpoints of equal steps of their distribution
    functions, which converges exponentially for periodic integrands. Each set integrates its part
    q_k²/Σ q_l² of the integrand.
    """
    n_sets, n_cases = widths.shape
    shares = (np.arange(n) + UNEVEN) / n
    tangents = widths * np.tan(math.pi * (shares - 0.5))[:, None, None]
    twice = 2.0 / (1.0 + tangents * tangents)
    cosine, sine = twice - 1.0, twice * tangents
    cos2 = (centres[0] * cosine - centres[1] * sine).reshape(-1, n_cases)
    sin2 = (centres[1] * cosine + centres[0] * sine).reshape(-1, n_cases)
    total = np.zeros(cos2.shape)
    weights = np.empty(cos2.shape)
    for k, (c, s, width) in enumerate(zip(*centres, widths, strict=True)):
        squares = width * width
        density = 2.0 * width / (1.0 + squares - (1.0 - squares) * (cos2 * c + sin2 * s))
        weights[k::n_sets] = density[k::n_sets]
        total += density * density
    weights /= total
    return _integrated(shapes.exponents(kappa, cos2, sin2), cos2, sin2, n_sets * weights, n_sets)


def _integrated(
    exponents: FloatArray,
    cos2: FloatArray,
    sin2: FloatArray,
    weights: FloatArray | float = 1.0,
    n_sets: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """Log means over nodes (n, E), the highest exponents and mean turns (3, E).

    And by how much means over every other node of each set differ (E,), relative to their sum.
    """
    highest = exponents.max(axis=0)
    exponents -= highest
    terms = np.exp(exponents, out=exponents)
    terms *= weights
    by_node = row_sums(terms.reshape(-1, n_sets, terms.shape[1]))
    even, odd = folded(by_node[::2]), folded(by_node[1::2])
    turns = 0.5 * np.arctan2(folded(terms * sin2), folded(terms * cos2))
    log_means = np.log((even + odd) / len(terms)) + highest
    return np.array([log_means, highest, turns]), np.abs(even - odd) / (even + odd)


def _cosines_of_steps(n: int, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Those of n turns (n, E) at equal steps, within ``reach`` (E,) of none."""
    return _cosines((np.arange(n)[:, None] + UNEVEN) * (2.0 * reach / n) - reach)


def _cosines(turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosines and sines of twice some turns."""
    return np.cos(2.0 * turns), np.sin(2.0 * turns)
