"""Numbers that decide how plans are computed, each with its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PlanSettings:
    """How much a plan computes.

    Attributes:
        n_tests: simulated tests of all model classes together; the standard error of a gain falls
            with its square root, 0.01 to 0.02 nats at the default.
        n_draws: parameter values of each class about each simulated test, whose average is the
            class's evidence for that test.

    Raises:
        ValueError: one of them is below 50.
    """

    n_tests: int = 1000
    n_draws: int = 200

    def __post_init__(self) -> None:
        for name in ("n_tests", "n_draws"):
            if getattr(self, name) < 50:
                raise ValueError(
                    f"PlanSettings: {name} must be at least 50, got {getattr(self, name)!r}"
                )


@dataclass(frozen=True)
class PlanningNumbers:
    """What users do not choose."""

    array_size: int = 4_000_000  # numbers in the largest array of a batch: 32 MB stay in reach
    n_for_moments: int = 2000  # draws of which mean and covariance are taken
    # The first look for parameter values that a simulated test may come from: draws of the class,
    # and the best of them, from which searches start. Fits are rarely exact at more than four.
    n_pool: int = 1000
    n_starts: int = 8
    # Errors of frequencies and shapes that are added at first, about the distance between a test
    # and the nearest draws; and their share in every Gauss-Newton step, none at last.
    first_errors: tuple[float, float] = (0.05, 0.2)
    narrowing: tuple[float, ...] = (1.0, 0.3, 0.05, 0.0)
    most_step: float = 2.0  # standard deviations of the prior, beyond which modes are not linear
    difference: float = 1e-3  # of z, for derivatives
    # Exponents of the shapes at all candidates where parameter values are sought for all layouts,
    # of every other search: some layouts say less than all candidates, some next to nothing.
    shares_of_shapes: tuple[float, ...] = (0.5, 0.0)
    tail: float = 6.0  # degrees of freedom of the Student-t densities that values are drawn from
    # Share of these draws that does not follow the mass of the maxima, in case that is wrong.
    defensive: float = 0.1
    wider_errors: float = 1.5  # of inferred error sizes, of the prior's width
    # A check fails where evidences rest on fewer effective draws than this in more than this share
    # of the simulated tests, or the bias is larger than this, in nats.
    least_draws: float = 5.0
    most_thin: float = 0.1
    most_bias: float = 0.02
    # Of all tests and draws, those with which layouts are searched; the best are valued with all.
    n_searched: tuple[int, int] = (300, 100)
    n_shown: int = 5  # of the best layouts that the search met
    # Of approximate structures, at so many draws, as a share of the errors of the test: added in
    # quadrature, a tenth widens them by half a per cent.
    n_for_accuracy: int = 200
    error_share: float = 0.1
    most_exhaustive: int = 1000  # layouts that are all tried; with more, a greedy search
    most_default_candidates: int = 60  # degrees of freedom that are candidates without being named
    most_exchanges: int = 4  # rounds over all sensors of a layout
    enough: float = 0.95  # of the largest gain, at the knee
    least_probability: float = 1e-3  # classes less probable before the test are left out


PLANNING = PlanningNumbers()
