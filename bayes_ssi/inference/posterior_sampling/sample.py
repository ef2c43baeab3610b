"""Sample a model class, with exact, approximate or emulated structures.

Structures that take long are solved at some hundred points, and emulators take their place; all
else is sampled as any class with approximate structures is. The engine's coordinates become
parameter values, modes and checks.
"""

import hashlib
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray, evenly_spaced_indices, systematic_indices
from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.criticism.adequacy import adequacy
from bayes_ssi.inference.criticism.misfit import N_DRAWS, edges
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.model_at_draws import (
    AtDraws,
    at_draws,
    configuration_modes,
    datum_terms,
    remarks_on_close_modes,
)
from bayes_ssi.inference.posterior.posterior import Evidence, Posterior, Region, draws_with_shapes
from bayes_ssi.inference.posterior_sampling.refinement import (
    RefinementSettings,
    is_approximate,
    refined,
)
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.result import SamplingResult
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.sampling.target import (
    NUDGE,
    POINTS_TO_CHECK,
    ROUNDING,
    Target,
    log_standard_normal,
)
from bayes_ssi.inference.workers.cache import Cache
from bayes_ssi.inference.workers.recorded_structure import RecordedStructure
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.structures.emulation.emulated_structure import EmulatedStructure
from bayes_ssi.structures.structure import Structure

# More noise of a model than this, in nats, is not small beside the errors: of standard
# deviation s, it raises an evidence by s²/2, half of the wanted error.
MOST_NOISE = 0.1


@checked
def sample(
    model_class: ModelClass,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
    *,
    refinement: RefinementSettings | None = None,
    known_starts: FloatArray | None = None,
) -> Posterior:
    """Sample the posterior of a model class and estimate its evidence.

    Approximate structures are refined where the posterior lies, and the evidence is corrected by
    exact solutions; ``remarks`` of the result state how accurate both are.

    Args:
        model_class: what is sampled.
        seed: determines the result, together with the class's name.
        settings: how precisely to sample.
        run: workers that share the evaluations, a checkpoint to resume from, and progress; the
            result does not depend on them.
        refinement: how accurate approximate structures are made.
        known_starts: (m, d), near maxima that an earlier search found, in standard-normal
            coordinates; it counts as one of the independent searches.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior, the model cannot be
            evaluated by the workers, or the checkpoint is in use or damaged.
    """
    settings, run = settings or SamplingSettings(), run or Run()
    checkpoint, options = run.checkpoint, (seed, settings, refinement)
    cache = checkpoint.cache(model_class, *options) if checkpoint else nullcontext()
    # As in a worker: how many threads add up a sum must not change its last digit.
    one_thread = threadpool_limits(limits=1, user_api="blas")
    with run.working(), cache as kept, one_thread:
        emulated = model_class
        if settings.economical:
            emulated = with_emulated_structures(model_class, seed, run.workers, kept)
        is_emulated = emulated is not model_class
        # Emulators are faster than sending them, and their solutions are in the cache.
        own_run = Run(progress=run.progress) if is_emulated else run
        sample_class = partial(
            sample_as_it_is,
            seed=seed,
            settings=settings,
            run=own_run,
            cache=None if is_emulated else kept,
            known_starts=known_starts,
        )
        if not is_approximate(emulated):
            return sample_class(emulated)
        refine = partial(refined, emulated, sample_class, settings.log_evidence_error, refinement)
        if not is_emulated:
            return refine(report=partial(run.report, model_class.name))
        posterior = refine()
        # Solutions of the emulated structures count, not evaluations of emulators.
        exact = [test.structure.exact for test in emulated.configurations]
        solved = {id(e): e.n_solved for e in exact if isinstance(e, RecordedStructure)}
        return replace(posterior, n_evaluations=sum(solved.values()))


def with_emulated_structures(
    model_class: ModelClass, seed: int, workers: Workers | None, cache: Cache | None
) -> ModelClass:
    """The class with an emulator in place of every structure that takes long.

    Those with small matrices, and those that are approximate already, stay.
    """
    emulators: dict[int, EmulatedStructure] = {}

    def emulated(structure: Structure, _: int) -> Structure:
        if structure.is_cheap or not structure.parameters:
            return structure
        if id(structure) not in emulators:
            recorded = RecordedStructure(structure, workers, cache)
            emulators[id(structure)] = EmulatedStructure(recorded, seed=seed)
        return emulators[id(structure)]

    return model_class.with_structures(emulated)


def emulated_again(model_class: ModelClass, posterior: Posterior) -> ModelClass:
    """The class with the emulators with which it was sampled; unchanged if there were none."""
    fits = posterior.emulators

    def emulated(structure: Structure, i: int) -> Structure:
        fit = fits[i] if fits else None
        return structure if fit is None else EmulatedStructure(structure, fit=fit)

    return model_class.with_structures(emulated)


def sample_as_it_is(
    model_class: ModelClass,
    seed: int,
    settings: SamplingSettings,
    run: Run,
    cache: Cache | None = None,
    known_starts: FloatArray | None = None,
) -> Posterior:
    """Sample a model class with its structures as they are.

    Arguments and errors are as in :func:`bayes_ssi.inference.posterior_sampling.sample.sample`;
    ``cache`` recalls the evaluations of an earlier run and keeps the others.
    """
    started = perf_counter()
    model_class.check_structure()
    n = len(model_class.parameters)
    target = class_target(model_class, run.workers, cache, known_starts)
    sampled = _sampled(model_class, target, seed, settings, run)
    rng = np.random.default_rng(seed)
    z, log_likelihoods, no_chains = _quoted_draws(sampled, rng)
    z_rows = z.reshape(-1, n)
    values = model_class.values(z_rows)
    at_values = _at_draws(model_class, values, run.workers)
    remarks, noise = _noise(model_class, values, log_likelihoods, at_values, run.workers)
    configurations = configuration_modes(model_class, values)
    few = evenly_spaced_indices(len(values), N_DRAWS)
    of_few = values[few], at_values.rows(few).modes, np.random.default_rng([seed, 2])
    return Posterior(
        name=model_class.name,
        parameter_names=model_class.parameter_names,
        draws=values.reshape(z.shape),
        log_likelihoods=log_likelihoods,
        frequencies_hz=at_values.frequencies_hz.reshape(*z.shape[:2], -1),
        effective_sample_sizes=sampled.chains.bulk_sizes,
        tail_effective_sample_sizes=sampled.chains.tail_sizes,
        evidence=Evidence(
            log_evidence=sampled.evidence.log_evidence,
            error=sampled.evidence.error,
            effective_sample_size=sampled.importance.effective_sample_size,
            pareto_k=sampled.importance.pareto_k,
            n_draws=len(sampled.importance.z),
            mean_log_likelihood=sampled.importance.log_likelihood_mean,
            checks=sampled.evidence_checks,
        ),
        regions=_regions(sampled, z_rows, values),
        maxima=model_class.values(sampled.search.maxima.z),
        r_hat=sampled.chains.r_hat,
        burn_in=sampled.quoted[0].burn_in,
        thinned_by=sampled.quoted[0].thinned_by,
        autocorrelation_time=max(each.autocorrelation_time for each in sampled.ensembles),
        acceptance_fraction=float(np.mean([e.acceptance_fraction for e in sampled.ensembles])),
        n_evaluations=sampled.n_evaluations,
        n_searches=sampled.search.n_searches,
        largest_unseen_mass=sampled.search.largest_unseen_mass,
        seconds=perf_counter() - started,
        failed_checks=(*sampled.failed_checks, *_failures(model_class, target), *noise),
        remarks=(*no_chains, *remarks, *remarks_on_close_modes(model_class, values, at_values)),
        edges=tuple(edges(model_class, z_rows, at_values.frequencies_hz)),
        data_digest=model_class.data_digest,
        configurations=configurations,
        relative_spreads=z_rows.std(axis=0),
        prior_quantiles=np.array(
            [[p.prior.quantile(q) for q in (0.05, 0.5, 0.95)] for p in model_class.parameters]
        ),
        prior_draws=model_class.values(np.random.default_rng(0).standard_normal((1000, n))),
        sensor_shapes=at_values.sensor_shapes[draws_with_shapes(len(at_values.sensor_shapes))],
        datum_terms=datum_terms(
            model_class,
            values,
            at_values,
            [each.pairing for each in configurations],
            z.shape[:2],
            rng,
        ),
        adequacy=adequacy(model_class, *of_few),
        importance_draws=sampled.importance.arrays,
    )


def _sampled(
    model_class: ModelClass, target: Target, seed: int, settings: SamplingSettings, run: Run
) -> SamplingResult:
    """The target of a class, sampled; errors begin with the class's name."""
    own_seed, progress = seed_of(model_class.name, seed), partial(run.report, model_class.name)
    try:
        return sample_target(target, own_seed, settings, progress)
    except np.linalg.LinAlgError:  # a ValueError, but no fault of the input's
        raise
    except ValueError as error:
        failures = "".join(f"; {sentence}" for sentence in _failures(model_class, target))
        raise ValueError(f"model class {model_class.name!r}: {error}{failures}") from error


def _at_draws(model_class: ModelClass, values: FloatArray, pool: Workers | None) -> AtDraws:
    """The model at ``values`` (n, n_parameters)."""
    # A rejected proposal repeats the last draw.
    different, which = np.unique(values, axis=0, return_inverse=True)
    if pool is None:
        model = at_draws(model_class, different)
    else:
        parts = np.array_split(different, min(pool.n_parts, len(different)))
        model = AtDraws.joined(pool.call_each(partial(at_draws, model_class), parts))
    return model.rows(which.ravel())


def _noise(
    model_class: ModelClass,
    values: FloatArray,
    log_likelihoods: FloatArray,
    model: AtDraws,
    pool: Workers | None,
) -> tuple[list[str], list[str]]:
    """A remark, or a failed check, where the model answers differently when it is asked again."""
    chosen = evenly_spaced_indices(len(values), POINTS_TO_CHECK)
    nudged = values[chosen] * (1.0 + NUDGE)
    ask = model_class.modes_or_nan
    modes = ask(nudged) if pool is None else pool.call_each(ask, [nudged])[0]
    again = model_class.log_density_of_modes(nudged, modes)
    nats = float(np.abs(again - log_likelihoods.ravel()[chosen]).max())
    frequencies = np.concatenate([each.frequencies_hz for each in modes], axis=1)
    share = float(np.abs(frequencies / model.frequencies_hz[chosen] - 1.0).max())
    text = (
        f"asked twice at {len(chosen)} draws, the model answers differently: frequencies differ by "
        f"{share:.1g} at most (as a fraction) and log-likelihoods by {nats:.1g} nats"
    )
    if nats <= MOST_NOISE:
        return [f"{text}, little beside the errors"] * (nats > ROUNDING), []
    return [], [text]


def _failures(model_class: ModelClass, target: Target) -> list[str]:
    """One sentence on where and why the model has no answer, unless it hardly ever happens."""
    first = target.first_failure
    # A smaller share of failures lies in the far tails of a prior.
    if first is None or target.n_failed <= 1e-3 * target.n_evaluations:
        return []
    z, reason = first
    named = zip(model_class.parameter_names, model_class.values(z[None])[0], strict=True)
    where = ", ".join(f"{name} = {value:.6g}" for name, value in named)
    return [
        f"the model failed at {target.n_failed} of {target.n_evaluations} evaluations, which count "
        f"as likelihood zero; the first time at {where}: {reason}"
    ]


def seed_of(name: str, seed: int) -> np.random.SeedSequence:
    """The seed of one model class, which does not depend on the others."""
    digest = hashlib.sha256(name.encode()).digest()
    if seed < 0:
        raise ValueError(f"seed must be zero or positive, got {seed!r}")
    return np.random.SeedSequence([seed, int.from_bytes(digest[:8], "little")])


def _quoted_draws(
    sampled: SamplingResult, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Draws (n_chains, n_steps, d), their log-likelihoods, and a remark where they are no chains.

    Chains that do not mix visit separate regions in shares that are left to chance: there, a check
    fails, and their draws are resampled to the shares that the importance draws give.
    """
    z = np.concatenate([ensemble.chains for ensemble in sampled.quoted])
    densities = np.concatenate([each.log_posteriors.T for each in sampled.quoted])
    remarks: tuple[str, ...] = ()
    if sampled.regions.n_regions > 1 and not sampled.chains_mix:
        flat = z.reshape(-1, z.shape[-1])
        label = sampled.regions.assign(flat)
        counts = np.bincount(label, minlength=sampled.regions.n_regions)
        weights = (sampled.region_shares / np.maximum(counts, 1))[label]
        by_region = np.argsort(label, kind="stable")
        chosen = by_region[systematic_indices(weights[by_region], len(flat), rng)]
        chosen = rng.permutation(chosen)
        z, densities = flat[chosen][None], densities.reshape(-1)[chosen][None]
        remarks = (
            f"the draws are no chains: those of {len(label)} steps, which hardly change between "
            f"{sampled.regions.n_regions} separate regions of the posterior, were resampled to the "
            "regions' shares by importance sampling",
        )
    prior = log_standard_normal(z.reshape(-1, z.shape[-1])).reshape(densities.shape)
    return z, densities - prior, remarks


def _regions(sampled: SamplingResult, z: FloatArray, values: FloatArray) -> tuple[Region, ...]:
    """Those in which a draw lies, of ``z`` and ``values`` (n, n_parameters)."""
    labels, numbers = sampled.regions.assign(z), sampled.searches_of_regions
    of_regions = [each.tolist() for each in (sampled.region_shares, sampled.region_errors, numbers)]
    records = [
        Region(share, error, n_searches, tuple(values[labels == k].mean(0).tolist()))
        for k, (share, error, n_searches) in enumerate(zip(*of_regions, strict=True))
        if np.any(labels == k)
    ]
    return tuple(sorted(records, key=lambda region: -region.share))
