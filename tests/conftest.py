"""The numerical study: a uniform three-storey shear building with a resonant infill.

First frequency 1 Hz; the infill stands between floors 1 and 2, has 5 % of the building's mass and
is tuned to the second frequency of the bare building. The identified modes are typed in, not
computed, so that tests compare the package with figures that it did not produce.
"""

import fcntl
import importlib.util
import math
import os
import pickle
import signal
import sys
from collections import defaultdict
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
import searches
from click.testing import CliRunner
from threadpoolctl import threadpool_limits

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.inference.posterior import model_at_draws
from bayes_ssi.inference.posterior.posterior import Evidence, Posterior, Region
from bayes_ssi.inference.sampling.diagnostics import EvidenceEstimate
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.studies.appendages.unmodelled import appendage_checks
from bayes_ssi.studies.search.family_search import screened_hypotheses

ROOT = Path(__file__).parents[1]
MODEL_CLASSES = ROOT / "model_classes"
STOREY_STIFFNESS = (2.0 * math.pi) ** 2 / (2.0 * math.sin(math.pi / 14.0)) ** 2
SECOND_FREQUENCY = math.sin(3.0 * math.pi / 14.0) / math.sin(math.pi / 14.0)

FLOORS = ("floor 1", "floor 2", "floor 3")
IDENTIFIED = {
    "1": (0.98275928, [0.3314169, 0.59327725, 0.7336109]),
    "2a": (2.6042925, [0.67446666, 0.239743, -0.69829652]),
    "2b": (3.00473295, [-0.79377247, -0.37649877, 0.47767556]),
    "3": (3.98405175, [-0.5785374, 0.73919027, -0.34480751]),
}


def script_of(name):
    """A script of ``runs`` as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "runs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def kept_study(name):
    """A study of ``model_classes``, loaded once."""
    return bs.load_study(MODEL_CLASSES / f"{name}.py")


def multiplier(name, median=1.0, cov=0.3):
    return bs.Parameter(name, bs.LogNormal(median, cov))


@pytest.fixture(scope="session")
def frame():
    """The main structure, with one stiffness multiplier per storey."""
    stiffnesses = [STOREY_STIFFNESS * multiplier(f"k{i}") for i in (1, 2, 3)]
    return bs.ShearBuilding(masses=(1.0, 1.0, 1.0), stiffnesses=stiffnesses)


@pytest.fixture(scope="session")
def infill():
    return bs.OutOfPlaneInfill(
        between=(1, 2), mass=0.15, frequency=SECOND_FREQUENCY, stiffness_factor=multiplier("ks")
    )


@pytest.fixture(scope="session")
def rigid(frame, infill):
    """The incorrect model structure: the infill is mass only."""
    return frame.with_element(infill.as_mass())


@pytest.fixture(scope="session")
def augmented(frame, infill):
    """The correct model structure: the infill has a degree of freedom."""
    return frame.with_element(infill)


@pytest.fixture(scope="session")
def case_c():
    """The four identified modes, with shapes at the floors."""
    modes = [bs.IdentifiedMode(label, f, np.array(s)) for label, (f, s) in IDENTIFIED.items()]
    return bs.ModalData(tuple(modes), band_hz=(0.0, 6.0), sensors=FLOORS)


@pytest.fixture(scope="session")
def fixed_error():
    return bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)


@pytest.fixture(scope="session")
def model_classes(rigid, augmented, case_c, fixed_error):
    """The study's four model classes by name."""
    choices = {
        "1-a": (rigid, {"1": 1, "2a": 2, "3": 3}),
        "1-b": (rigid, {"1": 1, "2b": 2, "3": 3}),
        "2": (rigid, {"1": 1, "3": 3}),
        "3": (augmented, {"1": 1, "2a": 2, "2b": 3, "3": 4}),
    }
    return {
        name: bs.ModelClass(name, structure, case_c, fixed_error, pairing=pairing)
        for name, (structure, pairing) in choices.items()
    }


@pytest.fixture
def updated(model_classes):
    """Modes of class 3 at draws near its medians."""
    values = np.exp(0.05 * np.random.default_rng(5).standard_normal((50, 4)))
    (modes,) = model_at_draws.configuration_modes(model_classes["3"], values)
    return modes.updated


# A study that is sampled in half a second: a uniform two-storey shear building of unit masses
# whose frequencies are 1/φ and φ Hz (φ the golden ratio), with one or two unknown stiffnesses.
TINY_STUDY = """\
import math

import bayes_ssi as bs

PHI = (1.0 + math.sqrt(5.0)) / 2.0
K = (2.0 * math.pi) ** 2
k, k1, k2 = (bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in ("k", "k1", "k2"))
modes = bs.ModalData(
    (
        bs.IdentifiedMode("1", 1.0 / PHI, [1.0, PHI], frequency_cov=0.002),
        bs.IdentifiedMode("2", PHI, [PHI, -1.0], frequency_cov=0.002),
    ),
    band_hz=(0.0, 3.0),
    sensors=("floor 1", "floor 2"),
    source="two-storey building",
)
error = bs.ErrorModel(frequency_cov=0.02, shape_sd=0.05)
pairing = {"1": 1, "2": 2}
study = bs.Study(
    "Two storeys",
    [
        bs.ModelClass("one k", bs.ShearBuilding((1.0, 1.0), (K * k, K * k)), modes, error,
                      pairing=pairing),
        bs.ModelClass("each k", bs.ShearBuilding((1.0, 1.0), (K * k1, K * k2)), modes, error,
                      pairing=pairing),
    ],
    description="One stiffness or two?",
)
"""


@pytest.fixture
def tiny_study_file(tmp_path):
    path = tmp_path / "tiny.py"
    path.write_text(TINY_STUDY, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def tiny_study(tmp_path_factory):
    path = tmp_path_factory.mktemp("tiny") / "tiny.py"
    path.write_text(TINY_STUDY, encoding="utf-8")
    return bs.load_study(path)


@pytest.fixture(scope="session")
def tiny_ranking(tiny_study):
    """The tiny study, sampled with seed 7; nothing may change it."""
    return bs.rank(tiny_study, seed=7)


@pytest.fixture(scope="session")
def tiny_result(tiny_ranking, tmp_path_factory):
    """The tiny ranking as it was saved, beside its study file; nothing may change either."""
    directory = tmp_path_factory.mktemp("tiny_result")
    study = directory / "tiny.py"
    study.write_text(TINY_STUDY, encoding="utf-8")
    command = "bayes-ssi rank tiny.py --seed 7"
    return bs.save_result(
        tiny_ranking, directory / "result", study_file=str(study), command=command
    )


@pytest.fixture
def make_posterior():
    """Builds a posterior of given evidence from draws of a standard normal, without sampling."""

    def make(
        name, log_evidence=0.0, error=0.01, names=("k1", "k2"), pairing=None, inferred=None,
        **changes,
    ):  # fmt: skip
        draws = np.random.default_rng(3).standard_normal((4, 250, len(names)))
        check = EvidenceEstimate("bridge sampling", log_evidence, error)
        no_modes = model_at_draws.UpdatedModes((), (), ())
        pairs = pairing or {"1": 1, "2": 2}
        own = model_at_draws.ConfigurationModes("", 2, pairs, inferred, no_modes)
        fields = {
            "name": name,
            "parameter_names": tuple(names),
            "draws": draws,
            "log_likelihoods": -0.5 * (draws**2).sum(-1),
            "frequencies_hz": np.array([1.0, 2.5]) * (1.0 + 0.01 * draws[..., :1]),
            "relative_spreads": (0.25,) * len(names),
            "prior_quantiles": np.array([[-2.0, 0.0, 4.0]] * len(names)),
            "effective_sample_sizes": np.full(len(names), 400.0),
            "tail_effective_sample_sizes": np.full(len(names), 350.0),
            "evidence": Evidence(
                log_evidence, error, 1500.0, 0.2, 2000, log_evidence + 3.0, (check,)
            ),
            "regions": (Region(1.0, 0.0, 4, (0.0,) * len(names)),),
            "maxima": np.zeros((1, len(names))),
            "r_hat": 1.001,
            "burn_in": 25,
            "thinned_by": 1,
            "autocorrelation_time": 2.0,
            "acceptance_fraction": 0.5,
            "n_evaluations": 20000,
            "n_searches": 4,
            "largest_unseen_mass": 7.5e-4,
            "seconds": 0.4,
            "failed_checks": (),
            "edges": (),
            "data_digest": "0123456789abcdef",
            "configurations": (own,),
        }  # fmt: skip
        return Posterior(**{**fields, **changes})

    return make


@pytest.fixture(scope="session")
def bare(frame, case_c, fixed_error):
    """The numerical study's frame without the infill that produced the data."""
    return bs.ModelClass("bare", frame, case_c, fixed_error, pairing={"1": 1})


@pytest.fixture
def fake_sampling(monkeypatch, make_posterior, no_motions):  # noqa: ARG001
    """Replaces screening and sampling by given log evidences; returns the names screened, by level.

    Every hypothesis has draws of its own. ``install.sampled`` are the names sampled, round by
    round; screening gives ``approximately``, by default the same. Posteriors may have other fields.
    """

    # Posteriors that were not sampled have no modes to move in.
    monkeypatch.setattr("bayes_ssi.plots.moving_shapes.save_scenes", lambda *_: None)

    def install(log_evidence, approximately=None, **changes):
        levels, install.sampled = [], []

        def screen_all(hypotheses, seed, run, effort=None):
            del seed, run, effort
            classes = [made for made, _ in hypotheses]
            # Of those with several appendages, the best are screened once more.
            known = {name for level in levels for name in level}
            if new := [each.name for each in classes if each.name not in known]:
                levels.append(new)
            evidence = approximately or log_evidence
            return [searches.screened(each, evidence(each)) for each in classes]

        def sample_all(candidates, seed, settings, run, refinement, known_starts):
            del seed, settings, refinement, known_starts
            if run.checkpoint is not None:  # as its caches do
                run.checkpoint.directory.mkdir(exist_ok=True)
            install.sampled.append([candidate.name for candidate in candidates])
            return [drawn(candidate) for candidate in candidates]

        def drawn(candidate):
            n = len(candidate.parameters)
            rng = np.random.default_rng(list(candidate.name.encode()))
            return make_posterior(
                candidate.name, log_evidence(candidate), names=candidate.parameter_names,
                draws=rng.normal(1.0, 0.3, n) * np.exp(0.5 * rng.standard_normal((4, 250, n))),
                log_likelihoods=rng.standard_normal((4, 250)), data_digest=candidate.data_digest,
                **changes,
            )  # fmt: skip

        for module in ("appendages.appendage_search", "search.ladder"):
            monkeypatch.setattr(f"bayes_ssi.studies.{module}.screen_all", screen_all)
        monkeypatch.setattr("bayes_ssi.studies.search.family_search.sample_all", sample_all)
        return levels

    return install


@pytest.fixture(scope="session")
def found_in_case_c(bare, tmp_path_factory):
    """The search on the numerical study's data, sampled once, also if several processes test."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return _search_of_case_c(bare)
    shared = tmp_path_factory.getbasetemp().parent / "found_in_case_c"
    with shared.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not shared.exists():
            shared.write_bytes(pickle.dumps(_search_of_case_c(bare)))
    return pickle.loads(shared.read_bytes())


def _search_of_case_c(baseline):
    settings = bs.SearchSettings(number_weights=(1.0, 1.0))
    with pytest.MonkeyPatch.context() as patched:
        screen_quickly(patched)
        return bs.search(baseline, settings, settings=searches.COARSE)


def screen_quickly(patched):
    """Searches screen all hypotheses with the quick effort at first."""
    quick = partial(screened_hypotheses, most_full=0)
    patched.setattr("bayes_ssi.studies.search.family_search.screened_hypotheses", quick)


@pytest.fixture
def no_motions(monkeypatch):
    """Searches are for appendages alone, not for motions that the model lacks."""
    monkeypatch.setattr("bayes_ssi.studies.appendages.baselines._motions_of", lambda _: ())


@pytest.fixture
def quick_screening(monkeypatch):
    screen_quickly(monkeypatch)


@pytest.fixture(scope="session", autouse=True)
def _interrupts():
    """A shell lets what it starts in the background ignore interrupts; some tests send them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _one_blas_thread():
    """Matrices here are small: threads inside BLAS would only wait for one another."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield


@pytest.fixture(scope="session", autouse=True)
def _compiled_once(tmp_path_factory):
    """Processes that tests start share compiled code, also where Python is to keep none."""
    if not sys.dont_write_bytecode:
        yield
        return
    kept = str(tmp_path_factory.getbasetemp().parent / "compiled")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "dont_write_bytecode", False)
        patched.setattr(sys, "pycache_prefix", kept)
        patched.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
        patched.setenv("PYTHONPYCACHEPREFIX", kept)
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_screening_for_appendages():
    """Rankings do not look for appendages that no class has, which takes half their time."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("bayes_ssi.studies.questions.appendage_checks", lambda *_: ())
        yield


@pytest.fixture
def screening_for_appendages(monkeypatch):
    """Rankings look for appendages that no class has, as those of users do."""
    monkeypatch.setattr("bayes_ssi.studies.questions.appendage_checks", appendage_checks)


# As coarse as checks of that ask, for those that fail take longer; as good as any to be compared.
COARSE = bs.SamplingSettings(
    log_evidence_error=0.2, particles=64, searches=1, r_hat=2.0, effective_sample_size=400
)


@pytest.fixture
def nothing_hangs():
    """Fails a test that waits for workers too long."""

    def give_up(*_):
        raise AssertionError("no end in sight")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(600)  # a machine may be busy with other things
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def copied_workers():
    """Two copies of this process, which start at once."""
    with Workers(n_workers=2, copies=True) as pool:
        yield pool


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs the command in an empty working directory."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture
def coarse_command(monkeypatch):
    """Commands sample coarsely."""
    coarse = {"particles": 60, "searches": 1, "max_steps": 400, "effective_sample_size": 400}

    def made(log_evidence_error=0.01, **given):
        error = max(log_evidence_error, 0.05) if log_evidence_error > 0.0 else log_evidence_error
        return bs.SamplingSettings(error, **(coarse | given))

    monkeypatch.setattr("bayes_ssi.inference.sampling.settings.SamplingSettings", made)


@pytest.fixture(autouse=True)
def no_automatic_workers(monkeypatch):
    """Commands stay in this process, where tests replace parts of them, unless told otherwise."""
    monkeypatch.setattr(
        "bayes_ssi.studies.ranking.class_sampling.automatic_workers", lambda *_: None
    )


@pytest.fixture
def no_drawings(monkeypatch):
    """Reports and predictions without their figures, which take longest."""
    none = defaultdict(list)
    monkeypatch.setattr("bayes_ssi.report.report_figures.draw_figures", lambda *_: none)
    monkeypatch.setattr("bayes_ssi.plots.prediction_plots.save_prediction_figures", lambda *_: [])


@pytest.fixture
def close_figures():
    """Draws without a display; neither finds nor leaves a figure open."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    mpl.use("agg")
    plt.close("all")
    yield
    plt.close("all")


def succeeded(result):
    """A command's result, which is no failure."""
    assert result.exit_code == 0, result.output
    return result


def assert_one_line_error(result, *words):
    """A command's result is one line on standard error, exit code 2, and no traceback."""
    assert result.exit_code == 2
    assert isinstance(result.exception, SystemExit), result.exception
    (line,) = result.stderr.splitlines()
    assert line.startswith("Error: ")
    for word in words:
        assert word in line


def assert_refused(message, call, /, *arguments, **options):
    """A call raises a ValueError of one line in which this pattern is found."""
    with pytest.raises(ValueError, match=message) as caught:
        call(*arguments, **options)
    assert "\n" not in str(caught.value)
