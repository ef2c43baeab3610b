"""What a change may be: the settings of a comparison of two tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bayes_ssi.parameters.families import NearOne, Uniform
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.studies.search.family import SearchLimits


@dataclass(frozen=True)
class ChangeSettings(SearchLimits):
    """What a change may be, and in how many places there may be one.

    Attributes:
        loss: prior of the share of a parameter that a change takes away; a gain where negative.
        common_sd: standard deviation of a share that all groups lose or gain in common, as by
            temperature or moisture, which is no change of the structure; not considered if None.
        covariate: name of a test → what the common share is proportional to, such as degrees; then
            ``common_sd`` is that of the share at the test that differs most from those before.
        shared: prior of the share of prediction errors that the tests have in common, where the
            class gives none; errors of different tests are independent if None.
        number_weights, branches, most_unsampled, most_sampled: how many changes, and how far the
            search goes, as in :class:`~bayes_ssi.studies.search.family.SearchLimits`.

    Raises:
        ValueError: as :class:`~bayes_ssi.studies.search.family.SearchLimits`; a loss could leave a
            negative stiffness; or the common share's standard deviation is not usable.
        TypeError: a prior is not a prior distribution.
    """

    loss: Prior = field(default_factory=lambda: Uniform(0.0, 1.0))
    common_sd: float | None = None
    covariate: Mapping[str, float] | None = None
    # What is not shared has any order of size, down to a hundredth of an error.
    shared: Prior | None = field(default_factory=lambda: NearOne(1e-4))

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_priors("loss", "shared", optional=("shared",))
        if (highest := self.loss.support[1]) > 1.0:
            raise ValueError(
                f"ChangeSettings: a loss of {highest:g} would leave a negative stiffness; it must "
                f"be at most 1, got {self.loss!r}"
            )
        if self.common_sd is not None and not 0.0 < self.common_sd < 1.0:
            raise ValueError(
                f"ChangeSettings: common_sd must be between 0 and 1, got {self.common_sd!r}"
            )
        if self.covariate is not None and self.common_sd is None:
            raise ValueError("ChangeSettings: a covariate needs common_sd, which is not given")
