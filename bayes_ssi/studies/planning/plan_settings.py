"""Numbers that decide how plans are computed, each with its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PlanSettings:
    """How much a plan computes.

    Attributes:
        n_tests: simulated tests of all classes together; the error of a gain falls with its root.
        n_draws: of each class about each test, whose average is the class's evidence for it.

    Raises:
        ValueError: one of them is below 50.
    """

    n_tests: int = 1000
    n_draws: int = 200

    def __post_init__(self) -> None:
        if min(self.n_tests, self.n_draws) < 50:
            raise ValueError(f"PlanSettings: both numbers must be at least 50, got {self!r}")


@dataclass(frozen=True)
class PlanningNumbers:
    """What users do not choose."""

    batch: int = 4_000_000  # numbers in the largest array of a batch: 32 MB
    most_kept: int = 1_000_000_000  # numbers of all draws' shapes, 4 GB
    n_for_moments: int = 2000  # draws of which moments are taken
    n_pool: int = 600  # draws of a class, of which those that suit a test start its searches
    n_starts: int = 4  # for each of the layouts that draws serve
    n_of_a_size: int = 2  # layouts that draws serve, of two sensors and of as many as are planned
    # Errors of frequencies and shapes that are added at first, the distance between a test and the
    # nearest draws; and their share in every Gauss-Newton step, none at last.
    first_errors: tuple[float, float] = (0.05, 0.2)
    narrowing: tuple[float, ...] = (1.0, 0.2, 0.0)
    most_step: float = 2.0  # of z, beyond which modes are not linear
    difference: float = 1e-3  # of z, for derivatives
    # Of the densities of draws, where data do not narrow them, as a share of the prior's: modes
    # are not linear beyond, and there are many densities side by side.
    width: float = 0.5
    n_error_sizes: int = 4  # at every point where a search ends, where sizes of errors are inferred
    tail: float = 6.0  # degrees of freedom of the Student-t densities of draws
    # A check fails where evidences rest on fewer effective draws in more than this share of tests,
    # or few draws bias the gain by more nats.
    counts: float = (
        0.01  # probability of a class after a test below which its evidence says nothing
    )
    least_draws: float = 5.0
    most_thin: float = 0.1
    most_bias: float = 0.02
    n_searched: tuple[int, int] = (300, 100)  # tests and draws with which layouts are searched
    n_shown: int = 5  # of the best layouts
    most_exhaustive: int = 500  # layouts that are all tried; with more, the search is greedy
    most_candidates: int = 60  # degrees of freedom that are candidates without being named
    enough: float = 0.95  # of the largest gain, at the knee
    smaller: float = 0.5  # errors, as of a record four times as long
    least_probability: float = 1e-3  # of classes after an earlier test
    n_for_accuracy: int = 200  # draws where approximate structures are made accurate
    approximation: float = 0.1  # errors of approximate structures, as a share of the test's


PLANNING = PlanningNumbers()
