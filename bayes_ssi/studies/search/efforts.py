"""What a search may cost: the efforts that a hypothesis may be worth, and when it is worth more."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    n_draws: int  # draws that scan the prior of what the hypothesis adds
    # From the best of these, and of the prior's; without any, importance draws are of the simpler
    # hypothesis alone.
    n_ascents: int
    batch: int  # importance draws; none where the greatest likelihood is enough
    # Whether searches are repeated until they agree, with descents in residuals, and draws are
    # added until the error is the wanted one.
    is_full: bool = False


@dataclass(frozen=True)
class Efforts:
    """The ladder of efforts below sampling, the cheapest first, and what goes on."""

    # Frequencies in steps of 2 %, from the best of which ascents end within a few nats of the
    # greatest likelihood, while evidences are eight and more below it.
    look: Effort = Effort(120, 2, 0)
    # Of the simpler hypothesis, with the new feature all over its prior.
    scan: Effort = Effort(250, 0, 250)
    quick: Effort = Effort(250, 3, 300)  # a hundredth of the evaluations of sampling
    # A region with half a hundredth of the prior is hit by five of 500 draws; an evidence to a few
    # tenths of a nat, in a tenth of the evaluations of sampling.
    full: Effort = Effort(500, 4, 600, is_full=True)
    wanted_error: float = 0.1  # decides whether a hypothesis has a hundredth or a thousandth of all
    # Of importance draws; where the new feature explains nothing, the posterior is the simpler
    # one's times the prior of the rest.
    share_of_simpler: float = 0.5
    most_full: int = 30  # with at most one feature, so many take half a minute in full
    # The error of a quick effort in less than this changes no probability by more than a
    # thousandth.
    share_for_full: float = 3e-3
    most_several: int = 300  # hypotheses with several features that are tried quickly, in a minute
    share_left_out: float = 1e-3  # of what the others have, for all together that a look leaves out
    looked_at_together: int = 32  # more hypotheses in a batch are no faster
    rows_in_cache: int = 256  # more rows of a batch leave the processor's cache
    least_expected: float = 1e-3  # probability of a hypothesis with several features that is tried
    most_expected: int = 300  # number of these
    # An approximate log evidence is too low by so many standard errors at most.
    errors_too_low: float = 3.0
    least_error: float = 0.05  # some hundred draws show no smaller ones
    basis_draws: int = 200  # draws whose modes make the bases of reduced structures
    # Of the data's own errors, for the basis that hypotheses share; full solutions at draws correct
    # the evidence, or enlarge it once.
    error_share: float = 0.5
    # Sampling takes as long as screening five hypotheses; with more, errors of a tenth of a nat,
    # which are independent, change sums little.
    most_sampled: int = 12
    # Baselines included, where each takes some 20 full solutions of a finite-element model.
    most_with_full_solutions: int = 6
    credible: float = 0.95  # share of the probability of all places that the named ones hold


EFFORTS = Efforts()
