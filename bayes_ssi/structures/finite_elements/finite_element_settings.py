"""The numbers by which solutions of finite-element models, and reduced bases, are decided."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FiniteElementSettings:
    # A model of more degrees of freedom must name its sensors: every mode shape is kept at all of
    # them.
    sensors_named_above: int = 1000
    # Memory for recent solutions: enough for hundreds of draws at 1000 sensors.
    cache_bytes: int = 64_000_000
    # Relative error, to the largest entry, of matrices that other programs wrote, perhaps with nine
    # digits.
    file_rounding: float = 1e-8
    # Modes are computed up to this share above the highest frequency of interest, since frequencies
    # fall as parameters change: by a fifth where a stiffness is a third lower than its median.
    frequency_margin: float = 0.2
    dense_up_to: int = 150  # smaller problems are solved faster as dense ones
    # Modes are counted below a shift that differs from every (2πf)² by this share, and with a
    # factor that solves equations this accurately: closer to singularity, signs of pivots are
    # unreliable.
    count_gap: float = 1e-6
    # By which a free model can be solved, in units of the mean of diagonal stiffness over mass.
    free_shift: float = 1e-8
    rigid_square: float = 1e-4  # a rigid-body mode's (2πf)² is a smaller share of the next one's
    sketch_size: int = 160  # random combinations in the sketch of a residual
    # Factor on their mean square: the square of the norm is larger in 4 of 10 000 cases (χ² with as
    # many degrees of freedom).
    sketch_margin: float = 1.5
    # Combinations that are solved for at a time (a divisor of their number), to take little memory.
    sketch_block: int = 16
    # Eigenvalues that differ by less than this share count as one group: hardly more than the
    # distance of frequencies (half as large) that a test resolves.
    group_within: float = 0.02
    # Modes that move the sensors by less than this share of the most visible mode, at unit modal
    # mass, count as if they moved them by as much: no test identifies them, and their shapes there
    # follow from small asymmetries of the mesh.
    least_visible: float = 0.05
    # Largest errors over the prior: of frequencies, as a fraction, and of shapes at the sensors, at
    # unit length there. Sampling makes them as small as the posterior demands.
    frequency_error: float = 1e-3
    shape_error: float = 0.1
    # Where so many full solutions do not suffice, a larger error is accepted and reported.
    most_full_solutions: int = 150
    # So many in a row that add nothing to a basis: bounds of close modes stay large all the same.
    most_idle: int = 3
    training_points: int = 512  # Sobol points of the prior among which full solutions are placed
    # Directions that add less than this share of the required accuracy to a mode are left out of a
    # basis; some of them together remain below it.
    negligible: float = 0.15
    # Share of the accuracy over the prior that a basis for draws has on average.
    draws_accuracy: float = 0.01


FEM = FiniteElementSettings()
