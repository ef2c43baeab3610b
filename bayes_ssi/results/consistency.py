"""Whether the parts of a result directory are whole, and belong together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.model_class.configuration import joint_digest
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.comparison import Comparison

__all__ = ["require_record", "require_whole"]

# What every record holds, and of which kind; None where it was not given.
KEYS: dict[str, tuple[type | None, ...]] = {
    "created": (str,),
    "study": (str,),
    "description": (str,),
    "study_file": (str,),
    "seed": (int,),
    "settings": (dict,),
    "prior_weights": (dict, None),
    "data_digest": (str,),
    "versions": (dict,),
    "model_classes": (list,),
    "posteriors": (list,),
    "data": (list,),
}


def require_record(record: Mapping[str, Any]) -> None:
    """Refuse a record that lacks a key, or holds something of another kind.

    Raises:
        ValueError: so it is; the message names the key.
    """
    for key, kinds in KEYS.items():
        if key not in record:
            raise ValueError(f"no {key!r}")
        value = record[key]
        if not any(value is None if kind is None else isinstance(value, kind) for kind in kinds):
            raise ValueError(f"{key!r} cannot be {value!r}"[:200])


def require_whole(
    record: Mapping[str, Any],
    tests: Mapping[str, ModalData],
    posteriors: Sequence[Posterior],
    comparison: Comparison,
) -> None:
    """Refuse parts that are not of one result.

    Raises:
        ValueError: modes, draws or classes are not those that the record is of.
    """
    if joint_digest(tests) != record["data_digest"]:
        raise ValueError("the identified modes are not those that were ranked")
    names = [posterior.name for posterior in posteriors]
    for what, others in (
        ("comparison.json", [row.name for row in comparison.classes]),
        ("'model_classes'", [each["name"] for each in record["model_classes"]]),
    ):
        if not names or sorted(others) != sorted(names):
            raise ValueError(f"{what} and 'posteriors' are not of the same model classes")
    for posterior in posteriors:
        _require_draws(posterior)
        if set(posterior.configuration_names) != set(tests):
            raise ValueError(f"posterior of {posterior.name!r}: other configurations than the data")
        for modes in posterior.configurations:
            unknown = [label for label in modes.pairing if label not in tests[modes.name].labels]
            if unknown:
                raise ValueError(
                    f"posterior of {posterior.name!r}: pairs {unknown[0]!r}, which is not among "
                    "the identified modes"
                )


def _require_draws(posterior: Posterior) -> None:
    n_chains, n_steps, n_parameters = np.shape(posterior.draws)
    n_modes = sum(modes.n_modes for modes in posterior.configurations)
    for what, array, shape in (
        ("log-likelihoods", posterior.log_likelihoods, (n_chains, n_steps)),
        ("frequencies", posterior.frequencies_hz, (n_chains, n_steps, n_modes)),
        ("effective sample sizes", posterior.effective_sample_sizes, (n_parameters,)),
        ("relative spreads", posterior.relative_spreads, (n_parameters,)),
    ):
        if np.shape(array) != shape:
            raise ValueError(
                f"posterior of {posterior.name!r}: {what} of shape {np.shape(array)}, where its "
                f"draws call for {shape}"
            )
    if not posterior.draws.size or not np.isfinite(posterior.draws).all():
        raise ValueError(f"posterior of {posterior.name!r}: draws that are no numbers, or none")
