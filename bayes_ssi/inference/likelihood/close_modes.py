"""Close modes turn together: which of them do, how far, and the mean of their shapes' densities.

Errors of a model in the plane of two of its modes, at unit modal mass and with λ = (2πf)²,

    A = diag(λ_i, λ_k) + 2 σ_f λ̄ W,    W_ii ~ N(0, 1), W_ik ~ N(0, ½),

are the ones by which modes of equal frequency have no direction of their own. The frequencies are
those of the model with the error σ_f, and both shapes turn by an angle t in their plane,

    φ_i(t) = cos t φ_i + sin t φ_k,    φ_k(t) = -sin t φ_i + cos t φ_k,
    p(t) = exp(κ cos 2t) / (π I₀(κ)),    κ = d Δ/(2σ_f²),

with Δ and d the relative distances of the two frequencies in the model and as identified (d = Δ
where one of them was not). Far modes turn by σ_f/(√2 Δ), as perturbation theory has it. A shape
error σ_φ contains turns of its own size already: nothing turns where 1/(2√κ) < σ_φ, and elsewhere
κ' takes the place of κ, with 1/κ' = 1/κ - 4σ_φ². The likelihood is the mean over t of the product
of both shapes' densities.

Where the pairing is inferred, the sum over pairings has both orders of the two, each with its own
frequencies and with turns about it: the density of two modes, whichever is whichever. With a given
pairing it is that of these two and of their order.

Only neighbours turn, each mode with one other, the closest ones first, by their identified
frequencies where the pairing is given: of three close modes the two closest turn together, and the
third does not.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from bayes_ssi.foundations.arrays import FloatArray, folded, row_sums

# Beyond this κ' a turn has a standard deviation of less than 5e-4: nothing turns.
MOST_CONCENTRATION = 1e6
TINY = 1e-9  # concentrations that cannot be told from none
ROUNDING = 4.0 * np.finfo(float).eps
# Nodes at equal steps: of the least of these numbers that puts them 0.8 standard deviations of the
# narrowest maximum apart. Sums over every other one are then right to some per cent, and where they
# agree to that, those over all to its fourth power.
EVEN_TURNS = np.array([64, 128, 256, 512])
PER_STRENGTH = 5.0
EVEN_DISAGREE = 0.005
PER_GAP = 2.0  # the least number that puts a node into every gap
LEAST_GAP = 0.002
UNEVEN = 0.3  # of a step, as every other node would be the other's mirror image with 0.5
# Nodes until sums over every other one agree: about the highest turn, then about several.
NUMBERS_OF_NODES = (24, 96, 384, 1536)
DISAGREE = 3e-4
NEGLIGIBLE = -12.0  # exponent below the maximum
IMPROBABLE = -4.5  # the same, of a normal variable three standard deviations from its mean
UNSEEN = 1e-4  # squared length, over its mean over turns, of which rounding leaves few digits
LEAST_WIDTH = 1e-6  # of a smaller turn, rounding leaves 1 - cos 2t fewer than four digits
SPREAD = 2.0  # of nodes, in standard deviations of turns
GRID, FINER_GRIDS = 48, 5  # turns at which the highest is sought, and how often anew about it
CACHED = 2**15  # numbers at a time, for arrays that stay in the processor's cache


class ClosePairs(NamedTuple):
    """C pairs of neighbouring model modes that turn together, in rows of a batch."""

    rows: NDArray[np.intp]  # (C,)
    lower: NDArray[np.intp]  # (C,), the lower one's number from 0; the other is the next
    distances: FloatArray  # (C,), of the model's frequencies, relative to their mean
    variances: FloatArray  # (C, 2), squared prediction errors of frequencies and of shapes

    def concentrations(self, observed: FloatArray, which: NDArray[np.intp]) -> FloatArray:
        """κ' (E,) of some pairs for identified frequencies at these distances, NaN where there are
        not two; infinite where nothing turns.
        """
        distances, (of_frequencies, of_shapes) = self.distances[which], self.variances[which].T
        kappa = 0.5 * np.where(np.isnan(observed), distances, observed) * distances / of_frequencies
        left = 1.0 - 4.0 * of_shapes * kappa
        turns = np.maximum(kappa, TINY) / np.where(left > 0.0, left, 1.0)
        return np.where((left > 0.0) & (turns < MOST_CONCENTRATION), turns, np.inf)

    @property
    def turn_alone(self) -> NDArray[np.bool_]:
        """Whether each turns where not both of its modes were identified, (C,)."""
        every = np.arange(len(self.rows))
        return np.isfinite(self.concentrations(np.full(len(every), np.nan), every))


def relative_distances(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.abs(second - first) / (0.5 * (first + second)))


def close_pairs(
    frequencies_hz: FloatArray,
    observed: FloatArray,
    variances: FloatArray,
    order: FloatArray | float = math.nan,
) -> ClosePairs | None:
    """The pairs that turn together; None where none does.

    Args:
        frequencies_hz: (B, M), of the model.
        observed: (M - 1, 1 or B), distances of identified frequencies of neighbours; infinite for
            neighbours that are not compared, NaN where one of them was not identified.
        variances: (B or 1, 2), squared prediction errors of frequencies and of shapes.
        order: (M - 1, 1), distances by which the closest are chosen; the model's where NaN. Those
            of identified modes make the choice for all rows alike: where it would change from one
            row to the next, the likelihood would have a step.
    """
    distances = relative_distances(frequencies_hz.T[:-1], frequencies_hz.T[1:])
    others = np.where(np.isnan(observed), distances, observed)
    with np.errstate(invalid="ignore"):  # of equal frequencies that are not compared
        near = 2.0 * others * distances * variances[:, 1] < variances[:, 0]  # κ < 1/(4σ_φ²)
    rows = np.flatnonzero(near.any(axis=0))
    if not len(rows):
        return None
    places = np.where(near, np.where(np.isnan(order), distances, order), np.inf).T[rows]
    some, lower = np.nonzero(near.T[rows] & _are_closest(places))
    own = np.broadcast_to(variances, (len(frequencies_hz), 2))[rows[some]]
    return ClosePairs(rows[some], lower, distances[lower, rows[some]], own)


def _are_closest(distances: FloatArray) -> NDArray[np.bool_]:
    """Which of ``distances`` (n, m) are chosen if the least is, then the least of those left, …

    One that was chosen takes its neighbours away. Those that rise one after another from a local
    minimum, which is chosen, are by turns taken away and chosen; between two minima, the highest is
    chosen if neither side takes it away.
    """
    numbers = np.arange(distances.shape[1])
    falls = np.zeros((len(distances), len(numbers) + 1), dtype=bool)
    falls[:, 1:-1] = distances[:, 1:] < distances[:, :-1]
    rises = np.zeros_like(falls)
    rises[:, 1:-1] = distances[:, 1:] >= distances[:, :-1]
    first = np.maximum.accumulate(np.where(rises[:, :-1], 0, numbers), axis=1)
    last = np.where(falls[:, 1:], numbers[-1], numbers)[:, ::-1]
    last = np.minimum.accumulate(last, axis=1)[:, ::-1]
    return np.asarray(((numbers - first) % 2 == 0) & ((last - numbers) % 2 == 0))


class CloseCases(NamedTuple):
    """m identified shapes beside close pairs, in E cases."""

    pairs: NDArray[np.intp]  # (E,), which ones of the close pairs
    columns: NDArray[np.intp]  # (m, E), of the identified shapes; -1 for none
    is_upper: NDArray[np.bool_]  # (m, E or 1), whether the shape is that of the upper mode
    observed: FloatArray  # (E,), distances of the identified frequencies; NaN for one alone

    def modes(self, close: ClosePairs, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The modes identified and what they turn to, (n, m, E), of shapes (B, n, n_modes)."""
        rows, lower = close.rows[self.pairs], close.lower[self.pairs]
        low, high = (shapes[rows, :, lower + i].T[:, None] for i in (0, 1))
        return np.where(self.is_upper, high, low), np.where(self.is_upper, -low, high)

    def turned(self, close: ClosePairs, shapes: FloatArray, angles: FloatArray) -> FloatArray:
        """The modes identified, (n, m, E), turned by angles (E,)."""
        modes, partners = self.modes(close, shapes)
        return np.asarray(np.cos(angles) * modes + np.sin(angles) * partners)


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
        products = shapes * shapes, shapes * partners, partners * partners
        aa, ab, bb = (row_sums((each * measured)[None])[0] for each in products)
        a, b = (row_sums((units * each)[None])[0] for each in (shapes, partners))
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
        above, below = (sums[1, :, None] * cos2 for sums in (self.squares, self.lengths))
        for total, (constant, _, of_sin) in ((above, self.squares), (below, self.lengths)):
            total += of_sin[:, None] * sin2
            total += constant[:, None]
        above /= below
        return np.asarray(1.0 - np.sqrt(np.clip(above, 0.0, 1.0, out=above), out=above))

    def are_unseen(self, cos2: FloatArray, sin2: FloatArray) -> NDArray[np.bool_]:
        """Whether sensors see next to nothing of one of the shapes at turns (n, E), (n, E)."""
        constant, of_cos, of_sin = self.lengths[:, :, None]
        lengths = constant + of_cos * cos2 + of_sin * sin2
        unseen = (lengths < UNSEEN * constant) & np.isfinite(self.variances)[:, None]
        return np.asarray(unseen.any(axis=0))

    @property
    def highest_exponents(self) -> FloatArray:
        """What -Σ (1 - |φ_e·φ(t)|)/σ² can be at most, each shape at the best turn for it, (E,)."""
        strength = np.hypot(*self.pulls)
        with np.errstate(divide="ignore", invalid="ignore"):
            cos2, sin2 = self.pulls / strength
            above, below = (
                constant + of_cos * cos2 + of_sin * sin2
                for constant, of_cos, of_sin in (self.squares, self.lengths)
            )
            distances = 1.0 - np.sqrt(np.clip(above / below, 0.0, 1.0))
        own = np.where(strength > TINY, distances / self.variances, 0.0)
        return -row_sums(own[None])[0]

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
        distances = self.distances(cos2, sin2)
        distances /= self.variances[:, None]
        return np.asarray(kappa * (cos2 - 1.0) - distances.sum(axis=0))

    def cases(self, which: NDArray[np.intp]) -> "TurningShapes":
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

        Nodes are spread evenly where few of them resolve the narrowest maximum that there can be.
        Where it takes many, or sums over every other one differ, they are about the highest turn,
        and about each of those that the density of turns or a shape asks for.
        """
        highest = shapes.highest_exponents
        turns = np.isfinite(concentrations) & (highest >= least)
        kappa = np.where(turns, concentrations, 0.0)
        means = np.zeros((3, len(kappa)))
        left = np.flatnonzero(turns)
        means[:, left], accurate = _over_even_turns(kappa[left], shapes.cases(left), highest[left])
        left = left[~accurate]
        if len(left):
            means[:, left] = _about_turns(kappa[left], shapes.cases(left))
        log_means, top, angles = means
        cosines = _cosines(angles[None])
        improbable = shapes.exponents(kappa, *cosines)[0] < top + IMPROBABLE
        unfit = np.flatnonzero(turns & (improbable | shapes.are_unseen(*cosines)[0]))
        if len(unfit):
            cos2, sin2 = _highest(kappa[unfit], shapes.cases(unfit))[0]
            angles[unfit] = 0.5 * np.arctan2(sin2, cos2)
        distances = shapes.distances(*_cosines(angles[None]))[:, 0]
        exponents = row_sums((distances / shapes.variances)[None])[0]
        log_means = np.where(turns, log_means - np.log(ive(0, kappa)), -exponents)
        return cls(log_means, log_means + exponents, angles, distances)


def _over_even_turns(
    kappa: FloatArray, shapes: TurningShapes, alone_highest: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Log integrals, the highest exponents and mean turns (3, E); which are accurate.

    Over turns at equal steps, within the reach of the density of turns: sums converge exponentially
    for integrands that are periodic, or vanish at both ends.
    """
    at_rest = shapes.exponents(kappa, np.ones((1, 1)), np.zeros((1, 1)))[0]
    with np.errstate(divide="ignore"):
        share = (alone_highest - at_rest - NEGLIGIBLE) / (2.0 * kappa)  # of sin² t
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


def _parts(cases: NDArray[np.intp], n: int) -> list[NDArray[np.intp]]:
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
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
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
    exponents = shapes.exponents(kappa, cos2, sin2)
    return _integrated(exponents, cos2, sin2, n_sets * weights, n_sets)


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
    """Cosines and sines (n, E) of twice n turns at equal steps, within ``reach`` (E,) of none.

    Of sums of two angles, few of which are evaluated.
    """
    step = 4.0 * reach / n
    angles = np.arange(8)[:, None] * step, (8.0 * np.arange(n // 8) + UNEVEN)[:, None] * step
    (c, s), (c_of_8, s_of_8) = (
        (np.cos(each), np.sin(each)) for each in (angles[0], angles[1] - 2.0 * reach)
    )
    cos2 = c_of_8[:, None] * c - s_of_8[:, None] * s
    sin2 = s_of_8[:, None] * c + c_of_8[:, None] * s
    return cos2.reshape(n, -1), sin2.reshape(n, -1)


def _cosines(turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosines and sines of twice some turns."""
    return np.cos(2.0 * turns), np.sin(2.0 * turns)
