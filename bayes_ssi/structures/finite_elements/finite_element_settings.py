"""The numbers by which solutions of finite-element models, and reduced bases, are decided."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FiniteElementSettings:
    """Sizes, tolerances and margins.

    Attributes:
        sensors_named_above: a model of more degrees of freedom must name its sensors: every mode
            shape is kept at all of them.
        cache_bytes: memory for recent solutions: enough for hundreds of draws at 1000 sensors.
        file_rounding: relative error, to the largest entry, of matrices that other programs wrote,
            perhaps with nine digits.
        frequency_margin: modes are computed up to this share above the highest frequency of
            interest, since frequencies fall as parameters change: by a fifth where a stiffness is a
            third lower than its median.
        dense_up_to: smaller problems are solved faster as dense ones.
        count_gap: modes are counted below a shift that differs from every (2πf)² by this share,
            and with a factor that solves equations this accurately: closer to singularity, signs
            of pivots are unreliable.
        free_shift: by which a free model can be solved, in units of the mean of diagonal stiffness
            over mass.
        rigid_square: a rigid-body mode's (2πf)² is a smaller share of the next one's.
        sketch_size: random combinations in the sketch of a residual.
        sketch_margin: factor on their mean square: the square of the norm is larger in 4 of 10 000
            cases (χ² with as many degrees of freedom).
        sketch_block: combinations that are solved for at a time (a divisor of their number), to
            take little memory.
        group_within: eigenvalues that differ by less than this share count as one group: hardly
            more than the distance of frequencies (half as large) that a test resolves.
        least_visible: modes that move the sensors by less than this share of the most visible
            mode, at unit modal mass, count as if they moved them by as much: no test identifies
            them, and their shapes there follow from small asymmetries of the mesh.
        negligible: directions that add less than this share of the required accuracy to a mode are
            left out of a basis; some of them together remain below it.
        draws_accuracy: share of the accuracy over the prior that a basis for draws has on average.
    """

    sensors_named_above: int = 1000
    cache_bytes: int = 64_000_000
    file_rounding: float = 1e-8
    frequency_margin: float = 0.2
    dense_up_to: int = 150
    count_gap: float = 1e-6
    free_shift: float = 1e-8
    rigid_square: float = 1e-4
    sketch_size: int = 160
    sketch_margin: float = 1.5
    sketch_block: int = 16
    group_within: float = 0.02
    least_visible: float = 0.05
    negligible: float = 0.15
    draws_accuracy: float = 0.01


FEM = FiniteElementSettings()
