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

__all__ = ["Further", "StoredDraws", "load_draws", "save_draws"]


FREQUENCY, MODE = "frequency_hz", "model_mode"
LOG_LIKELIHOOD, DATUM = "modes", "datum"
IDENTIFIED, IDENTIFIED_MODE = "identified_hz", "identified_mode"
NOISE = 1e-9  # nats
RESERVED = {
    "chain", "draw", FREQUENCY, MODE, LOG_LIKELIHOOD, DATUM, IDENTIFIED, IDENTIFIED_MODE
}  # fmt: skip


class Further(NamedTuple):
    """What arviz makes use of beside the draws.

    Attributes:
        prior: (n_draws, n_parameters), draws of the prior.
        terms: log-likelihoods and predictions datum by datum, or None.
        identified_hz: (n_identified,), what was observed of these predictions.
    """

    prior: FloatArray
    terms: DatumTerms | None
    identified_hz: FloatArray


class StoredDraws(NamedTuple):
    """Arrays of a stored posterior, as in :class:`~bayes_ssi.posterior.posterior.Posterior`.

    ``mode_labels`` name the model modes; numbers from 1 where there is one configuration.
    ``further`` is for other packages, and is not read back.
    """

    parameter_names: tuple[str, ...]
    draws: FloatArray
    log_likelihoods: FloatArray
    frequencies_hz: FloatArray
    mode_labels: tuple[int | str, ...]
    further: Further | None = None


def save_draws(path: Path, stored: StoredDraws) -> None:
    """Write draws to a new netCDF file with the groups that arviz names.

    ``posterior`` and ``prior`` hold a variable for each parameter, ``sample_stats`` the
    log-likelihood (``log_likelihood_total``), ``log_likelihood`` the same datum by datum
    (``modes``), ``posterior_predictive`` the model's frequencies (``frequency_hz``) and the
    identified ones as the class would give them (``identified_hz``), which ``observed_data`` has
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
    if stored.further is not None:
        _add_further(groups, labels, stored.parameter_names, stored.further)
    if _is_first_generation(arviz):
        with warnings.catch_warnings():
            # Every walker is a chain: there may well be more of them than steps.
            warnings.filterwarnings("ignore", "More chains", UserWarning)
            arviz.from_dict(**groups, **labels).to_netcdf(str(path), engine="h5netcdf")
    else:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Found chain dimension to be longer", UserWarning)
            arviz.from_dict(groups, **labels).to_netcdf(path, engine="h5netcdf")


def _add_further(
    groups: dict[str, dict[str, Any]],
    labels: dict[str, Any],
    parameter_names: tuple[str, ...],
    further: Further,
) -> None:
    names = variable_names(parameter_names)
    groups["prior"] = {name: further.prior[None, :, i] for i, name in enumerate(names)}
    terms = further.terms
    if terms is None:
        return
    groups["log_likelihood"] = {LOG_LIKELIHOOD: _never_constant(terms.log_likelihoods)}
    groups["posterior_predictive"][IDENTIFIED] = terms.predicted_hz
    groups["observed_data"] = {IDENTIFIED: further.identified_hz}
    labels["dims"] |= {LOG_LIKELIHOOD: [DATUM], IDENTIFIED: [IDENTIFIED_MODE]}
    labels["coords"] |= {DATUM: list(terms.data), IDENTIFIED_MODE: list(terms.identified)}


def _never_constant(log_likelihoods: FloatArray) -> FloatArray:
    """The same with noise far below any that matters where a datum's term does not vary.

    A spurious mode has the same density at every draw. arviz 1.x fits the tail of each datum's
    weights and refuses one that is a single value.
    """
    constant = np.ptp(log_likelihoods, axis=(0, 1)) == 0.0
    noise = NOISE * np.random.default_rng(0).standard_normal(log_likelihoods.shape[:2])
    return log_likelihoods + np.where(constant, noise[..., None], 0.0)


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
    """Names of the parameters' variables in the file: their own, where netCDF allows them.

    A slash separates groups and becomes an underscore; a name that arviz uses, or that is taken,
    gets an underscore at its end.
    """
    names: list[str] = []
    for parameter_name in parameter_names:
        name = parameter_name.replace("/", "_")
        while name in RESERVED or name in names:
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
