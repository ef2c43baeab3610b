"""Draws to and from netCDF files that arviz opens, as an ``InferenceData`` or a ``DataTree``.

Writing netCDF files as arviz lays them out, without importing it, which takes seconds.

A file is made in memory and then written as one piece, because the HDF5 library may crash on a
disk that becomes full.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.model_at_draws import DatumTerms
from bayes_ssi.inference.posterior.posterior import Posterior, draws_with_shapes

# Name of a variable → its dimensions and its values; a coordinate is named as its dimension.
Group = Mapping[str, tuple[Sequence[str], ArrayLike]]


def write_netcdf(path: Path, groups: Mapping[str, Group]) -> None:
    import h5netcdf
    import h5py

    in_memory = BytesIO()
    with h5netcdf.File(in_memory, "w") as file:
        for group_name, variables in groups.items():
            group = file.create_group(group_name)
            for name, (dimensions, values) in variables.items():
                array = np.asarray(values)
                if array.dtype.kind == "U":
                    array = array.astype(h5py.string_dtype())
                for dimension, size in zip(dimensions, array.shape, strict=True):
                    if dimension not in group.dimensions:
                        group.dimensions[dimension] = size
                group.create_variable(name, tuple(dimensions), array.dtype, data=array)
    try:
        with path.open("xb") as on_disk:
            on_disk.write(in_memory.getbuffer())
    except OSError as error:
        error.filename = str(path)  # Python names it where opening fails, but not writing
        raise


MODEL, FREQUENCY, MODE = "model", "frequency_hz", "model_mode"
LOG_LIKELIHOOD, DATUM = "modes", "datum"
IDENTIFIED, IDENTIFIED_MODE = "identified_hz", "identified_mode"
SHAPES, WITH_SHAPES = "sensor_shapes", "draw_of_all_chains"
# Names of dimensions and coordinates; no parameter's variable can have one of them.
RESERVED = ("chain", "draw", FREQUENCY, MODE, DATUM, IDENTIFIED, IDENTIFIED_MODE)


def save_draws(path: Path, posterior: Posterior, model_class: ModelClass) -> None:
    """Write the draws of a posterior to a new netCDF file with arviz's standard groups.

    ``posterior`` and ``prior`` hold a variable for each parameter, ``sample_stats`` the
    log-likelihood (``log_likelihood_total``), ``log_likelihood`` the same datum by datum
    (``modes``), ``posterior_predictive`` the identified frequencies as the class predicts them
    (``identified_hz``), which ``observed_data`` holds as they were identified. Groups of this
    package's own hold the model's frequencies (``model``) and mode shapes at the sensors at some of
    the draws (``sensor_shapes``).
    """
    draw = ("chain", "draw")
    names = variable_names(posterior.parameter_names)
    z = np.random.default_rng(0).standard_normal((1000, len(model_class.parameters)))
    prior = model_class.values(z)
    modes = {MODE: ([MODE], _mode_labels(posterior))}
    frequencies: Group = {FREQUENCY: ([*draw, MODE], posterior.frequencies_hz), **modes}
    groups: dict[str, Group] = {
        "posterior": {name: (draw, posterior.draws[..., i]) for i, name in enumerate(names)},
        "prior": {name: (draw, prior[None, :, i]) for i, name in enumerate(names)},
        "sample_stats": {"log_likelihood_total": (draw, posterior.log_likelihoods)},
        MODEL: frequencies,
    }
    if posterior.datum_terms is not None:
        terms = posterior.datum_terms
        identified_hz = [c.data.frequencies_hz for c in model_class.configurations]
        labels: Group = {IDENTIFIED_MODE: ([IDENTIFIED_MODE], terms.identified)}
        groups["log_likelihood"] = {
            LOG_LIKELIHOOD: ([*draw, DATUM], _varying_terms(terms)),
            DATUM: ([DATUM], terms.data),
        }
        groups["observed_data"] = {
            IDENTIFIED: ([IDENTIFIED_MODE], np.concatenate(identified_hz)),
            **labels,
        }
        predicted = ([*draw, IDENTIFIED_MODE], terms.predicted_hz)
        groups["posterior_predictive"] = {IDENTIFIED: predicted, **labels}
    numbered = {name: _with_numbered_draws(group) for name, group in groups.items()}
    if posterior.sensor_shapes is not None:
        numbered[SHAPES] = {
            SHAPES: ([WITH_SHAPES, SHAPES + "_component"], posterior.sensor_shapes),
            WITH_SHAPES: ([WITH_SHAPES], draws_with_shapes(len(posterior.values))),
        }
    write_netcdf(path, numbered)


def _with_numbered_draws(group: Group) -> Group:
    """A group with coordinates that number its chains and draws from 0, where it has any."""
    dimensions, values = next(iter(group.values()))
    sizes = zip(dimensions, np.shape(values), strict=True)
    numbers = {n: ([n], np.arange(size)) for n, size in sizes if n in ("chain", "draw")}
    return {**group, **numbers}


def _mode_labels(posterior: Posterior) -> list[int] | list[str]:
    """Labels of the model modes: numbers from 1, after the configuration's name if several."""
    if posterior.configuration_names == ("",):
        return list(range(1, posterior.configurations[0].n_modes + 1))
    return [
        label_in(modes.name, str(number))
        for modes in posterior.configurations
        for number in range(1, modes.n_modes + 1)
    ]


def _varying_terms(terms: DatumTerms) -> FloatArray:
    """Log-likelihoods (n_chains, n_steps, n_data) of which none is constant.

    A spurious mode has the same density at every draw. Leave-one-out cross-validation fits the
    tail of each term's distribution, which a constant lacks: it is scattered by a millionth of a
    nat, which the first term that varies takes back, so that the sum stays the same.
    """
    # What differs by no more than this between draws, in nats, is constant but for rounding.
    constant = np.ptp(terms.log_likelihoods, axis=(0, 1)) <= 1e-9
    if constant.all() or not constant.any():
        return terms.log_likelihoods
    varying = terms.log_likelihoods.copy()
    shape = (*varying.shape[:2], int(constant.sum()))
    scatter = 1e-6 * np.random.default_rng(0).standard_normal(shape)
    varying[..., constant] += scatter
    varying[..., int(np.argmin(constant))] -= scatter.sum(axis=-1)
    return varying


def load_draws(path: Path, posterior: Posterior) -> Posterior:
    """The posterior with the draws that :func:`save_draws` wrote."""
    import h5py  # the files are plain netCDF

    with h5py.File(path, "r") as file:
        names = variable_names(posterior.parameter_names)
        return replace(
            posterior,
            draws=np.stack([file["posterior"][name][...] for name in names], axis=-1),
            log_likelihoods=file["sample_stats"]["log_likelihood_total"][...],
            frequencies_hz=file[MODEL][FREQUENCY][...],
            sensor_shapes=file[SHAPES][SHAPES][...] if SHAPES in file else None,
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
