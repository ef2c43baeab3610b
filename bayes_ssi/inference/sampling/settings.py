"""How to sample: what users choose, and the numbers by which each part of the engine decides."""

import math
from collections.abc import Callable
from dataclasses import dataclass

# Called with the name of a step and the completed share of it.
StepProgress = Callable[[str, float], None]


def part(
    progress: StepProgress, step: str, index: int = 0, count: int = 1
) -> Callable[[float], None]:
    """Progress of one of ``count`` parts as progress of the whole step."""
    return lambda done: progress(step, (index + done) / count)


@dataclass(frozen=True)
class SamplingSettings:
    """How precisely to sample.

    Attributes:
        log_evidence_error: wanted standard error of the log evidence, in nats.
        particles: number in each compression of the prior; None chooses it by the number of
            parameters.
        searches: least number of independent searches for maxima.
        effective_sample_size: that chains should have, of the bulk and of the tails of every
            parameter, as arviz computes it.
        r_hat: the largest rank-normalised split R-hat that chains should have; where it is larger,
            a check fails (Vehtari et al. 2021 ask for 1.01).
        max_steps: longest chain, in steps, burn-in included.
        economical: with emulators of slow structures in their place, which need some hundred
            solutions; structures with small matrices are sampled as they are.

    Raises:
        ValueError: a setting is not positive, R-hat is not above 1, or there are fewer than 8
            particles per parameter.
    """

    log_evidence_error: float = 0.01
    particles: int | None = None
    searches: int = 4
    effective_sample_size: int = 2000
    r_hat: float = 1.01
    max_steps: int = 10_000
    economical: bool = False

    def __post_init__(self) -> None:
        for name in (
            "log_evidence_error", "particles", "searches", "effective_sample_size", "max_steps",
        ):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise ValueError(
                    f"SamplingSettings: {name} must be positive and finite, got {value!r}"
                )
        if not 1.0 < self.r_hat < math.inf:
            raise ValueError(
                f"SamplingSettings: r_hat must be above 1 and finite, got {self.r_hat!r}"
            )

    def n_particles(self, n_dimensions: int) -> int:
        """The number of particles; ValueError where fewer were requested than these need."""
        if self.particles is None:
            # Of fewer, those at the ends of a thin ridge are lost by chance, level after level: of
            # half as many, so much that errors are twice those claimed.
            return max(1000, 50 * n_dimensions)
        # A quarter of the particles survives a level; to half of those, as many as there are
        # dimensions, the proposals of the others are fitted.
        least = 8 * n_dimensions
        if self.particles < least:
            raise ValueError(
                f"SamplingSettings: particles must be at least {least} for "
                f"{n_dimensions} parameters, got {self.particles!r}"
            )
        return self.particles


@dataclass(frozen=True)
class MaximaSettings:
    """Ascents, and the searches for maxima that they make up; lengths in prior standard deviations.

    Differences are forward first and central second ones, whose truncation and rounding errors
    balance for log-likelihoods of some thousand nats.
    """

    gradient_step: float = 1e-6
    hessian_step: float = 1e-3
    # Steps over which the log posterior falls by more nats are shortened: further away a narrow
    # maximum may have given way to what surrounds it.
    largest_fall: float = 0.1
    # Where a model is noisy: longer steps, over which the log posterior changes by more.
    step_over_noise: float = 0.05  # forward steps over the root of the noise, the best at sd 0.03
    noisy_hessian_step: float = 0.3  # the first, which are shortened as above
    # An ascent along a curved ridge may need more steps: it is continued once.
    steps_of_ascent: int = 60
    longest_step: float = 2.0
    # Tried together, as shares of the BFGS step.
    step_lengths: tuple[float, ...] = (1.0, 0.4, 0.1, 0.01)
    # An ascent ends where a step gains fewer nats, and so within so many standard deviations per
    # coordinate of a maximum.
    least_rise: float = 1e-3
    within: float = 0.1
    # A maximum with less than e^-12, 6 in a million, of the mass is left out.
    negligible_log_mass: float = -12.0
    # Logs of powers of the likelihood that leave the prior as it is, and with which a quadratic
    # reaches no more than 1e-7 nats, which is rounding, above a level; their error costs few draws.
    log_powers: tuple[float, float] = (-20.0, 18.0)
    log_power_error: float = 0.01
    # In fifty dimensions one draw in thirteen is accepted.
    most_rounds_of_draws: int = 50

    # Searches are repeated, up to this multiple of the wanted number, while a maximum with more
    # than this share of the posterior, by Laplace's approximation, was found by only one of them.
    most_times_wanted: int = 3
    least_share: float = 1e-3
    # Prior draws of one search, of 4000 of which a basin with a thousandth of the prior holds four,
    # and ascents at once from the highest local maxima among them.
    draws: int = 4000
    ascents: int = 40
    # Where starts are suggested, which lead to narrow basins, fewer find the wide ones.
    draws_beside_starts: int = 1000
    ascents_beside_starts: int = 10
    # A search climbs on while so many maxima, or more, are expected beyond those that it has
    # reached, but no more than so many times: of a rough posterior, each draw may be near a maximum
    # of its own.
    expected_unseen: float = 0.5
    most_rounds: int = 5


@dataclass(frozen=True)
class RegionSettings:
    """What separates two regions, or two maxima."""

    # Neighbours per draw: enough to connect the draws of one region, in a few dimensions.
    neighbours: int = 8
    # Two maxima, or groups of draws, are separate where every path between them that is tried leads
    # this many nats below the lower one, at one of so many points. At an edge of where the
    # likelihood is positive there is no curvature to tell how far a maximum reaches.
    valley_depth: float = 2.0
    points_between: int = 3
    most_draws: int = 1500
    # Pairs of draws between which two groups are tested. A group of no more draws has most of its
    # neighbours outside, and is no region of its own.
    pairs: int = 4


@dataclass(frozen=True)
class MixtureSettings:
    """Student-t mixtures and how they are fitted."""

    # Degrees of freedom: the variance of importance weights stays finite where a posterior has
    # tails as heavy as those of five; thirty are nearly normal; two serve tails like Cauchy's.
    light_tails: float = 30.0
    heavy_tails: float = 5.0
    heaviest_tails: float = 2.0

    # Weight of components added in case a mixture misses a part of the posterior: the importance
    # weights of the other draws rise by a ninth at most.
    defensive_share: float = 0.1
    # More components must raise the mean log density of held-out draws by so many nats.
    least_gain: float = 0.01
    # A component needs this many draws for each dimension.
    draws_per_dimension: int = 10
    # Numbers of components that are tried.
    counts: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 12, 16)

    def tails_within(self, n_dimensions: int) -> float:
        """Degrees of freedom of proposals within a level, where a density has no tails.

        A component's width varies by 1/√(2 ν). In many dimensions nearly all of a level's volume is
        in a thin shell, which hardly a proposal of varying width hits.
        """
        return self.light_tails * max(1.0, n_dimensions / 5.0)


@dataclass(frozen=True)
class RidgeSettings:
    """Where a ridge is, and how it is followed."""

    # Maxima, those with the most mass first, whose ridges are followed.
    most: int = 8
    # A direction is along the ridge if the posterior has more than this share of the prior's
    # variance in it.
    least_variance: float = 0.1
    # Polynomials are of this degree at most.
    highest_degree: int = 6
    # Their arguments end at this multiple of a component's width: hardly a draw is further out.
    reach: float = 10.0
    # Most coefficients of a thin coordinate: to solve for them takes as long as some ten thousand
    # evaluations of a small structure. Those of three thin in twenty coordinates are fewer, to the
    # third degree.
    most_monomials: int = 1200
    # Points, at least as many again as coefficients, and at least so many more, to know by how much
    # polynomials miss the ridge.
    least_points_left: int = 60
    # Where polynomials are far from a ridge, which they are at few places, components so many times
    # as thick cover it. Their share costs as much of the other draws.
    thicker: float = 3.0
    share_of_thicker: float = 0.15
    # Polynomials are good enough where they widen a ridge by no more than this factor.
    enough: float = 1.1


@dataclass(frozen=True)
class ImportanceSettings:
    """Importance draws: when they are poor, and what is then added."""

    # With a heavier tail of the weights, the error of the estimate cannot be trusted (Vehtari et
    # al. 2024).
    pareto_k_limit: float = 0.7
    # Largest share of the evidence that one draw should carry: it alone would move the log evidence
    # by twice the default wanted error.
    largest_weight: float = 0.02
    # Components are added where others show that a share of the posterior is missing which is this
    # multiple of the wanted error: what chains and particles show of a ridge's end is less than it
    # has.
    least_missing: float = 0.1
    # Each component adds a sixth to the draws, all of them together a factor of six. One that shows
    # what lies beyond the end of a ridge, mostly nothing, adds a thirtieth.
    most_added: int = 12
    added_draws: float = 1 / 6
    added_draws_at_an_end: float = 1 / 30
    # Most posterior draws resampled from one sample, to which mixtures are fitted.
    most_resampled: int = 5000
    # Wanted standard error of the regions' shares, relative to that of the log evidence.
    share_error: float = 0.3


@dataclass(frozen=True)
class CompressionSettings:
    """Levels of the compression of the prior, and the moves above them."""

    # Share of the particles that survives a level: for a given error, from 0.1 to 0.3 takes the
    # fewest evaluations (Zuev, Beck, Au and Katafygiotis 2012).
    surviving: float = 0.25
    # Compression ends where the largest likelihood, in all the prior left, would add no more than
    # this share of the evidence: little beside the error of the estimate.
    negligible_share: float = 1e-2
    # And where all particles are within this many nats of the highest: the prior left around the
    # top of a broad region is so small that particles come upon a narrow one on its slope.
    top: float = 0.2
    # Where most of the prior is impossible, at most this many draws are made for each particle.
    most_drawn: int = 500
    # Moves go on until positions and ranks have lost half of their correlation with where they
    # began, or no more of it is lost.
    correlation_left: float = 0.5
    most_moves: int = 25
    # Particles per dimension that one component of the proposals' mixture is fitted to.
    particles_per_component: int = 30
    # Shares of the maxima's components and of the prior in the proposals.
    maxima_share: float = 0.3
    prior_share: float = 0.02
    # Most particles from which further ascents begin, and of how many they are the local maxima:
    # the time to find neighbours in many dimensions rises with the square of that.
    most_climbers: int = 32
    most_compared: int = 4000


@dataclass(frozen=True)
class ChainSettings:
    """The ensembles: how long they are, and when mixtures are fitted again."""

    # Walkers of one ensemble; the two per dimension that emcee's moves need if that is more. Of
    # longer chains, not of more, R-hat falls.
    walkers: int = 16
    # Steps after which chains are first judged: of two ensembles, enough where a mixture is near
    # the posterior.
    first_steps: int = 150
    # The first share of the steps, which is left out. Walkers begin at importance draws, resampled,
    # or at particles of the posterior.
    burn_in: float = 0.1
    # Steps between two fits of a mixture, and the draws for each effective one above which they are
    # too slow, so that it is fitted again.
    steps_of_adaptation: int = 100
    slow: float = 20.0
    # Most refits of the mixture; they end earlier where a refit raises the efficiency of importance
    # draws by less than this factor.
    most_refits: int = 4
    least_improvement: float = 1.2
    # Below this efficiency importance draws are poor: chains are run to their full length, and the
    # mixture is finally fitted to their draws.
    least_efficiency: float = 0.1
    # A fit of a mixture takes as long as some ten thousand evaluations of a small structure: it
    # pays only where more batches of importance draws than this would be needed without it.
    most_batches: int = 8


@dataclass(frozen=True)
class CheckSettings:
    """When a result is doubted."""

    # Vehtari et al. (2021) ask for it.
    least_effective_sample_size: int = 400
    # The wanted error counts as reached up to this multiple of it.
    error_over_wanted: float = 1.5
    # Estimates that differ by more than this many standard errors of their difference disagree: by
    # chance once in 16,000 times.
    standard_errors: float = 4.0
    # Importance draws may miss a share of the posterior up to this multiple of the evidence's
    # error: the evidence is too low by that share, and two standard errors are no surprise.
    missed_over_error: float = 2.0
    # A region with less of the posterior than this need not be found by every part of the sampling.
    small_share: float = 0.02
    # Nor need one whose part of the prior had, on average, so many of the draws of each search: it
    # was seen, but led to a higher neighbour.
    draws_that_see: float = 5.0
    # An evidence that rests on one value of the likelihood, which more than this share of the prior
    # has, says nothing.
    flat_share: float = 0.9999
    # More noise of a model than this, in nats, is not small beside the errors: of standard
    # deviation s, it raises an evidence by s²/2, half of the wanted error.
    most_noise: float = 0.1


MAXIMA = MaximaSettings()
REGIONS = RegionSettings()
MIXTURES = MixtureSettings()
RIDGES = RidgeSettings()
IMPORTANCE = ImportanceSettings()
COMPRESSION = CompressionSettings()
CHAINS = ChainSettings()
CHECKS = CheckSettings()
