"""Draws as arviz holds them, and to and from netCDF files that it opens."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.arviz_functions import Group, groups_of, netcdf_file
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.model_at_draws import DatumTerms
from bayes_ssi.inference.posterior.posterior import Posterior, draws_with_shapes

MODEL, FREQUENCY, MODE = "model", "frequency_hz", "model_mode"
LOG_LIKELIHOODS, LOG_LIKELIHOOD, DATUM = "log_likelihood_total", "modes", "datum"
IDENTIFIED, IDENTIFIED_MODE = "identified_hz", "identified_mode"
SHAPES, WITH_SHAPES = "sensor_shapes", "draw_of_all_chains"
# Names of dimensions and coordinates; no parameter's variable can have one of them.
RESERVED = ("chain", "draw", FREQUENCY, MODE, DATUM, IDENTIFIED, IDENTIFIED_MODE)


def save_draws(path: Path, posterior: Posterior) -> None:
    """Write the draws of a posterior to a new netCDF file, as one piece."""
    content = netcdf_file(posterior)
    try:
        with path.open("xb") as file:
            file.write(content)
    except OSError as error:
        error.filename = str(path)  # Python names it where opening fails, but not writing
        raise


@groups_of.register
def _groups(posterior: Posterior) -> dict[str, Group]:
    draw = ("chain", "draw")
    names = variable_names(posterior.parameter_names)
    numbers = [
        (each.name, i) for each in posterior.configurations for i in range(1, each.n_modes + 1)
    ]
    # After the configuration's name if there are several.
    one = posterior.configuration_names == ("",)
    labels_of_modes = [number if one else label_in(name, str(number)) for name, number in numbers]
    modes = {MODE: ([MODE], labels_of_modes)}
    groups: dict[str, Group] = {
        "posterior": {name: (draw, posterior.draws[..., i]) for i, name in enumerate(names)},
        "sample_stats": {LOG_LIKELIHOODS: (draw, posterior.log_likelihoods)},
        MODEL: {FREQUENCY: ([*draw, MODE], posterior.frequencies_hz), **modes},
    }
    if posterior.prior_draws is not None:
        prior = posterior.prior_draws[None]
        groups["prior"] = {name: (draw, prior[..., i]) for i, name in enumerate(names)}
    if posterior.datum_terms is not None:
        terms = posterior.datum_terms
        labels: Group = {IDENTIFIED_MODE: ([IDENTIFIED_MODE], terms.identified)}
        groups["log_likelihood"] = {
            LOG_LIKELIHOOD: ([*draw, DATUM], _varying_terms(terms)),
            DATUM: ([DATUM], terms.data),
        }
        groups["observed_data"] = {IDENTIFIED: ([IDENTIFIED_MODE], terms.identified_hz), **labels}
        predicted = ([*draw, IDENTIFIED_MODE], terms.predicted_hz)
        groups["posterior_predictive"] = {IDENTIFIED: predicted, **labels}
    if posterior.sensor_shapes is not None:
        groups[SHAPES] = {
            SHAPES: ([WITH_SHAPES, SHAPES + "_component"], posterior.sensor_shapes),
            WITH_SHAPES: ([WITH_SHAPES], draws_with_shapes(len(posterior.values))),
        }
    return groups


def _varying_terms(terms: DatumTerms) -> FloatArray:
    """Log-likelihoods (n_chains, n_steps, n_data) of which none is constant.

    A spurious mode has the same density at every draw. Leave-one-out cross-validation fits the
    tail of each term's distribution, which a constant lacks: it is scattered by a millionth of a
    nat, which the first term that varies takes back, so that the sum stays the same.
    """
    # What differs by no more than this between draws, in nats, is constant but for rounding.
    constant = np.ptp(terms.log_likelihoods, axis=(0, 1)) <= 1e-9
    if constant.all():
        return terms.log_likelihoods
    scatter = 1e-6 * np.random.default_rng(0).standard_normal(terms.log_likelihoods.shape)
    scatter *= constant
    scatter[..., int(np.argmin(constant))] -= scatter.sum(axis=-1)
    return terms.log_likelihoods + scatter


def load_draws(path: Path, posterior: Posterior) -> Posterior:
    """The posterior with the draws that :func:`save_draws` wrote."""
    import h5py  # the files are plain netCDF

    names = variable_names(posterior.parameter_names)
    with h5py.File(path, "r") as file:

        def draws(group: str) -> FloatArray:
            return np.stack([file[group][name][...] for name in names], axis=-1)

        def labels(group: str, name: str) -> tuple[str, ...]:
            return tuple(file[group][name].asstr()[...])

        terms = None
        if "log_likelihood" in file:
            terms = DatumTerms(
                labels("log_likelihood", DATUM),
                file["log_likelihood"][LOG_LIKELIHOOD][...],
                labels("observed_data", IDENTIFIED_MODE),
                file["observed_data"][IDENTIFIED][...],
                file["posterior_predictive"][IDENTIFIED][...],
            )
        return replace(
            posterior,
            draws=draws("posterior"),
            log_likelihoods=file["sample_stats"][LOG_LIKELIHOODS][...],
            frequencies_hz=file[MODEL][FREQUENCY][...],
            sensor_shapes=file[SHAPES][SHAPES][...] if SHAPES in file else None,
            datum_terms=terms,
            prior_draws=draws("prior")[0] if "prior" in file else None,
        )


def variable_names(parameter_names: Sequence[str]) -> list[str]:
    """Names of the parameters' variables: their own, with underscores where netCDF needs them.

    An underscore replaces a slash, and is appended to a name that is reserved or taken.
    """
    names: list[str] = []
    for parameter_name in parameter_names:
        name = parameter_name.replace("/", "_")
        while name in (*RESERVED, *names):
            name += "_"
        names.append(name)
    return names
