"""What a search may cost: the efforts that a hypothesis may be worth, and when it is worth more."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """What one hypothesis may cost.

    Attributes:
        n_draws: draws that scan the prior of what the hypothesis adds.
        n_ascents: from the best of these, and of the prior's; without any, importance draws are of
            the simpler hypothesis alone.
        batch: importance draws; none where the greatest likelihood is enough.
        is_full: whether searches are repeated until they agree, with descents in residuals, and
            draws are added until the error is the wanted one.
    """

    n_draws: int
    n_ascents: int
    batch: int
    is_full: bool = False


@dataclass(frozen=True)
class Efforts:
    """The ladder of efforts below sampling, the cheapest first, and what goes on.

    Attributes:
        look: frequencies in steps of 2 %, from the best of which ascents end within a few nats of
            the greatest likelihood, while evidences are eight and more below it.
        scan: of the simpler hypothesis, with the new feature all over its prior.
        quick: a hundredth of the evaluations of sampling.
        full: a region with half a hundredth of the prior is hit by five of 500 draws; an evidence
            to a few tenths of a nat, in a tenth of the evaluations of sampling.
        wanted_error: decides whether a hypothesis has a hundredth or a thousandth of all.
        share_of_simpler: of importance draws; where the new feature explains nothing, the posterior
            is the simpler one's times the prior of the rest.
        most_full: with at most one feature, so many take half a minute in full.
        share_for_full: the error of a quick effort in less than this changes no probability by more
            than a thousandth.
        most_several: hypotheses with several features that are tried quickly, in a minute.
        share_left_out: of what the others have, for all together that a look leaves out.
        looked_at_together: more hypotheses in a batch are no faster.
        rows_in_cache: more rows of a batch leave the processor's cache.
        least_expected: probability of a hypothesis with several features that is tried.
        most_expected: number of these.
        errors_too_low: an approximate log evidence is too low by so many standard errors at most.
        least_error: some hundred draws show no smaller ones.
        basis_draws: draws whose modes make the bases of reduced structures.
        error_share: of the data's own errors, for the basis that hypotheses share; full solutions
            at draws correct the evidence, or enlarge it once.
    """

    look: Effort = Effort(120, 2, 0)
    scan: Effort = Effort(250, 0, 250)
    quick: Effort = Effort(250, 3, 300)
    full: Effort = Effort(500, 4, 600, is_full=True)
    wanted_error: float = 0.1
    share_of_simpler: float = 0.5
    most_full: int = 30
    share_for_full: float = 3e-3
    most_several: int = 300
    share_left_out: float = 1e-3
    looked_at_together: int = 32
    rows_in_cache: int = 256
    least_expected: float = 1e-3
    most_expected: int = 300
    errors_too_low: float = 3.0
    least_error: float = 0.05
    basis_draws: int = 200
    error_share: float = 0.5


EFFORTS = Efforts()
