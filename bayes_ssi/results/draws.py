"""Draws to and from netCDF through arviz: the only module that touches it.

arviz 0.x keeps draws in an ``InferenceData``, arviz 1.x in an xarray ``DataTree``; the files are
the same and each version opens the other's.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.posterior.datum_terms import DatumTerms

__all__ = ["ForOtherPackages", "StoredDraws", "load_draws", "save_draws"]

FREQUENCY, MODE = "frequency_hz", "model_mode"
LOG_LIKELIHOOD, DATUM = "modes", "datum"
IDENTIFIED, IDENTIFIED_MODE = "identified_hz", "identified_mode"
# Names of dimensions and coordinates, which a parameter's variable cannot have.
RESERVED = ("chain", "draw", FREQUENCY, MODE, DATUM, IDENTIFIED, IDENTIFIED_MODE)


class ForOtherPackages(NamedTuple):
    """What arviz uses besides the draws; it is not read back.

    Attributes:
        prior: (n_draws, n_parameters), draws of the prior.
        terms: log-likelihoods and predictions datum by datum, or None.
        identified_hz: (n_identified,), the observations that the terms predict.
    """

    prior: FloatArray
    terms: DatumTerms | None
    identified_hz: FloatArray


class StoredDraws(NamedTuple):
    """Arrays of a stored posterior, as in :class:`~bayes_ssi.posterior.posterior.Posterior`.

    ``mode_labels`` name the model modes: numbers from 1 where there is one configuration.
    """

    parameter_names: tuple[str, ...]
    draws: FloatArray
    log_likelihoods: FloatArray
    frequencies_hz: FloatArray
    mode_labels: tuple[int | str, ...]
    for_others: ForOtherPackages | None = None


def save_draws(path: Path, stored: StoredDraws) -> None:
    """Write draws to a new netCDF file with the groups that arviz names.

    ``posterior`` and ``prior`` hold a variable for each parameter, ``sample_stats`` the
    log-likelihood (``log_likelihood_total``), ``log_likelihood`` the same datum by datum
    (``modes``), ``posterior_predictive`` the model's frequencies (``frequency_hz``) and the
    identified ones as the class predicts them (``identified_hz``), which ``observed_data`` holds
    as they were identified.
    """
    arviz = _import_arviz()
    groups: dict[str, dict[str, Any]] = {
        "posterior": {
            name: stored.draws[..., i]
            for i, name in enumerate(variable_names(stored.parameter_names))
        },
        "sample_stats": {"log_likelihood_total": stored.log_likelihoods},
        "posterior_predictive": {FREQUENCY: stored.frequencies_hz},
    }
    labels: dict[str, Any] = {
        "dims": {FREQUENCY: [MODE]},
        "coords": {MODE: list(stored.mode_labels)},
    }
    if stored.for_others is not None:
        _add_groups(groups, labels, stored.parameter_names, stored.for_others)
    if _is_first_generation(arviz):
        with warnings.catch_warnings():
            # Every walker is a chain: there may well be more of them than steps.
            warnings.filterwarnings("ignore", "More chains", UserWarning)
            arviz.from_dict(**groups, **labels).to_netcdf(str(path), engine="h5netcdf")
    else:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Found chain dimension to be longer", UserWarning)
            arviz.from_dict(groups, **labels).to_netcdf(path, engine="h5netcdf")


def _add_groups(
    groups: dict[str, dict[str, Any]],
    labels: dict[str, Any],
    parameter_names: tuple[str, ...],
    for_others: ForOtherPackages,
) -> None:
    names = variable_names(parameter_names)
    groups["prior"] = {name: for_others.prior[None, :, i] for i, name in enumerate(names)}
    terms = for_others.terms
    if terms is None:
        return
    data, log_likelihoods = _varying_terms(terms)
    groups["log_likelihood"] = {LOG_LIKELIHOOD: log_likelihoods}
    groups["posterior_predictive"][IDENTIFIED] = terms.predicted_hz
    groups["observed_data"] = {IDENTIFIED: for_others.identified_hz}
    labels["dims"] |= {LOG_LIKELIHOOD: [DATUM], IDENTIFIED: [IDENTIFIED_MODE]}
    labels["coords"] |= {DATUM: data, IDENTIFIED_MODE: list(terms.identified)}


def _varying_terms(terms: DatumTerms) -> tuple[list[str], FloatArray]:
    """Names and log-likelihoods of the data; constant terms are part of the first that varies.

    A spurious mode has the same density at every draw. Leave-one-out cross-validation fits the
    tail of each term's distribution, which a constant has not; the term that it is added to only
    shifts by it, so the sum over the data stays the same.
    """
    names, constant = np.array(terms.data), np.ptp(terms.log_likelihoods, axis=(0, 1)) == 0.0
    if constant.all():
        return names.tolist(), terms.log_likelihoods
    log_likelihoods = terms.log_likelihoods[..., ~constant]
    log_likelihoods[..., 0] += terms.log_likelihoods[0, 0, constant].sum()
    first, *others = names[~constant].tolist()
    return [" and ".join([first, *names[constant]]), *others], log_likelihoods


def load_draws(path: Path, parameter_names: tuple[str, ...]) -> StoredDraws:
    """Read draws that :func:`save_draws` wrote.

    Raises:
        ValueError: the file is missing, damaged, or lacks a group or a parameter.
    """
    import h5py  # the files are plain netCDF: arviz, which takes seconds to import, is not needed

    try:
        with h5py.File(path, "r") as file:
            posterior = file["posterior"]
            columns = [posterior[name][...] for name in variable_names(parameter_names)]
            predictive = file["posterior_predictive"]
            labels = predictive[MODE][...].tolist()
            return StoredDraws(
                parameter_names,
                np.stack(columns, axis=-1),
                file["sample_stats"]["log_likelihood_total"][...],
                predictive[FREQUENCY][...],
                tuple(each.decode() if isinstance(each, bytes) else each for each in labels),
            )
    except PermissionError:
        raise ValueError(f"{path}: cannot be read: permission denied") from None
    except (OSError, KeyError, ValueError, AttributeError, TypeError) as error:
        raise ValueError(
            f"{path}: not a stored posterior of this package: {' '.join(str(error).split())}"
        ) from error


def variable_names(parameter_names: Sequence[str]) -> list[str]:
    """Names of the parameters' variables: their own, with underscores as far as netCDF needs.

    An underscore takes the place of a slash, and is added to a name that is reserved or taken.
    """
    names: list[str] = []
    for parameter_name in parameter_names:
        name = parameter_name.replace("/", "_")
        while name in (*RESERVED, *names):
            name += "_"
        names.append(name)
    return names


def _import_arviz() -> ModuleType:
    with warnings.catch_warnings():
        # arviz 0.23 announces version 1 at every import.
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    return arviz


def _is_first_generation(arviz: ModuleType) -> bool:
    return int(arviz.__version__.split(".")[0]) == 0
