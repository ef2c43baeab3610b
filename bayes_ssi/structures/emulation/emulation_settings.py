"""The numbers by which emulators are fitted, refined and judged."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EmulationSettings:
    # Over the prior, for each coefficient of a polynomial of second degree: one would do without
    # errors.
    solutions_per_coefficient: int = 2
    # At most, for each parameter; where they do not suffice, the error is accepted and reported.
    solutions_per_parameter: int = 70
    # Solutions between two fits, for each parameter: enough to keep workers busy, few enough to be
    # placed by the fit before.
    batch_per_parameter: int = 2
    n_nearest: int = 8  # solutions by which the claimed error at a point is judged
    # The claimed error is that of a typical point, the median: exact solutions at draws correct the
    # rest, and count every point by its share.
    claimed_at: float = 0.5
    # Largest share of the points at which it may be open whether the structure fails: exact
    # solutions at draws correct the rest.
    most_open: float = 0.05
    # Prior precision of the coefficients of the odds of failing: boundaries between two points
    # become sharp, not infinitely.
    failing_precision: float = 1e-3
    # Least and largest share of noise in the variance: rounding errors of the factorisation need
    # the least; a function with jumps takes the most.
    noise: tuple[float, float] = (1e-10, 1e-1)
    # Shortest and longest, in units of the variables' own spread: shorter ones leave points
    # uncorrelated, longer ones are polynomials.
    lengths: tuple[float, float] = (0.1, 100.0)
    # Points from which lengths are estimated: more hardly change them, at a cost of their third
    # power.
    most_fitted: int = 250
    # Coordinates of shapes are useless where their condition number is larger: shapes then hardly
    # resemble the reference shapes.
    worst_condition: float = 1e3
    # Modes are told apart by 1 - MAC and by frequencies: a difference of this share counts like
    # orthogonal shapes.
    frequency_step: float = 0.1
    # Shapes at unit length are usually known five times less precisely than frequencies.
    shape_weight: float = 0.2
    # Weight of modes that are not needed, which should not decide how smooth the others are.
    not_needed: float = 0.01


EMULATION = EmulationSettings()
