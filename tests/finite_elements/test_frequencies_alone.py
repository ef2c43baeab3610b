"""Frequencies without shapes, of structures of every kind: every command answers, or says why."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from chains import spring_chain
from click.testing import CliRunner

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.inference.posterior.model_at_draws import configuration_modes
from bayes_ssi.results.predictions.posterior_draws import PosteriorDraws
from bayes_ssi.results.predictions.predictions import Predictions
from bayes_ssi.results.predictions.requested_predictions import structures_of_unknown_ground

STUDY = """
import numpy as np
import bayes_ssi as bs

K = (2.0 * np.pi) ** 2
a, b = (bs.Parameter(name, bs.LogNormal(1.0, 0.2)) for name in ("a", "b"))
E = [np.array(rows) for rows in ([[1.0, 0.0], [0.0, 0.0]], [[1.0, -1.0], [-1.0, 1.0]])]

def matrices(a, b):
    return K * (a * E[0] + b * E[1]), np.eye(2)

def frequencies(a, b):
    return np.sqrt(np.linalg.eigvalsh(matrices(a, b)[0])) / (2.0 * np.pi), None

def matrix_structure(**given):
    return bs.MatrixStructure([(K * a, E[0]), (K * b, E[1])], np.eye(2), n_modes=2, **given)

arguments = {"a": 1.0 * a, "b": 1.0 * b}
kinds = {
    "building": bs.ShearBuilding((1.0, 1.0), (K * a, K * b)),
    "function": bs.FunctionStructure(frequencies, arguments, n_modes=2),
    "matrices of a function": bs.FunctionStructure(matrices, arguments, n_modes=2),
    "matrices": matrix_structure(sensors={}),
    "reduced": matrix_structure(sensors={}).reduced(),
    "reduced with places": matrix_structure().reduced(),
}
modes = tuple(
    bs.IdentifiedMode(str(i), hz, frequency_cov=0.02) for i, hz in enumerate((0.61, 1.68), 1)
)
data = bs.ModalData(modes, (0.0, 3.0))

def study_of(*names, pairing={"1": 1, "2": 2}):
    error = bs.ErrorModel(0.01, 0.05)
    return bs.Study("Frequencies alone", [
        bs.ModelClass("class", kinds[name], data, error, pairing=pairing) for name in names
    ])
"""
SPACE = {}
exec(STUDY, SPACE)
KINDS, STUDY_OF = SPACE["kinds"], SPACE["study_of"]
# What is said of shapes; "no shapes" is.
OF_SHAPES = re.compile(r"(?<!no )\b(shapes?|MACs?|channels?|σ_φ|shape_sd)\b", re.IGNORECASE)


def exact_log_evidence():
    """By quadrature over both standard-normal coordinates, the two modes paired."""
    z = np.linspace(-6.0, 6.0, 1201)
    a, b = np.exp(math.sqrt(math.log(1.04)) * np.array(np.meshgrid(z, z)))
    # Of λ² - (a + 2b) λ + ab.
    root = np.sqrt((a + 2.0 * b) ** 2 - 4.0 * a * b)
    hz = np.sqrt(0.5 * (a + 2.0 * b + np.array([-root, root])))
    total = -0.5 * np.add.outer(z**2, z**2) - math.log(2.0 * math.pi)
    for identified, model in zip((0.61, 1.68), hz, strict=True):
        sd = math.hypot(0.02, 0.01)
        total += -0.5 * ((model / identified - 1.0) / sd) ** 2
        # Identified with probability 0.95, and never spurious.
        total += math.log(0.95 / (sd * identified * math.sqrt(2.0 * math.pi)))
    return np.log(np.exp(total).sum() * (z[1] - z[0]) ** 2) - 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_all_kinds_are_one_model(kind):
    (building,), (other,) = (STUDY_OF(each).model_classes for each in ("building", kind))
    values = other.values(np.random.default_rng(0).standard_normal((20, 2)))
    np.testing.assert_allclose(other.log_likelihood(values), building.log_likelihood(values), 1e-9)
    (there,), (here,) = (configuration_modes(each, values) for each in (other, building))
    for mode, same in zip(there.updated.modes, here.updated.modes, strict=True):
        np.testing.assert_allclose(mode.after_hz, same.after_hz, 1e-9)
        assert mode.mac_after is None


@pytest.mark.parametrize(
    ("kind", "economical"), [("function", True), ("reduced", False), ("reduced with places", False)]
)
def test_the_evidence_is_that_of_quadrature(kind, economical):
    (model_class,) = STUDY_OF(kind).model_classes
    settings = bs.SamplingSettings(
        log_evidence_error=0.05, searches=1, effective_sample_size=400, economical=economical
    )
    posterior = bs.sample(model_class, settings=settings)
    evidence = posterior.evidence
    assert posterior.failed_checks == ()
    assert abs(evidence.log_evidence - exact_log_evidence()) < 4.0 * evidence.error
    assert not OF_SHAPES.search(" ".join(posterior.remarks))


def test_a_reduced_basis_without_sensors_bounds_frequencies_alone():
    n = 60
    below, above = spring_chain(n, 2)
    a, b = STUDY_OF("building").model_classes[0].parameters
    full = bs.MatrixStructure([(a, below), (b, above)], np.eye(n), sensors={}, n_modes=2)
    reduced = full.reduced()
    values = np.array([[1.0, 1.0], [0.7, 1.4], [1.3, 0.8]])
    off = reduced.modes(values).frequencies_hz / full.modes(values).frequencies_hz - 1.0
    bounds = reduced.bounds(values)
    assert (np.abs(off) <= bounds.frequency + 1e-12).all()
    assert reduced.basis.size < n
    np.testing.assert_array_equal(bounds.shape, 0.0)


def run(*arguments, code=0):
    done = CliRunner().invoke(main, list(map(str, arguments)))
    assert done.exit_code == code, done.output
    return done.output


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("alone") / "alone.py"
    path.write_text(STUDY + 'study = study_of("function")\n', encoding="utf-8")
    run("rank", path, "--error", "0.1", "--out", path.parent / "result")
    return path


@pytest.mark.parametrize("command", ["calibrate", "sensitivities"])
def test_commands_on_a_study_say_nothing_of_shapes(study, command):
    assert not OF_SHAPES.search(run(command, study))


def test_commands_on_a_result_say_nothing_of_shapes(study):
    result = study.parent / "result"
    settings = run("what-if", result, "--frequency-cov", 0.02)
    assert "Before and after" in settings
    assert not OF_SHAPES.search(settings)
    assert "shape_sd: no shape was identified" in run("what-if", result, "--shape-sd", 0.1, code=2)
    predicted = run("predict", result)
    assert "Natural frequencies (Hz)" in predicted
    assert not OF_SHAPES.search(predicted)
    files = {path.name for path in (result / "predictions").rglob("*.*")}
    assert files == {"predictions.json", "frequencies.csv"}
    assert "its frequencies alone are known" in run("predict", result, "--at", "roof", code=2)
    run("report", result)
    page = (result / "report" / "report.html").read_text(encoding="utf-8")
    page = re.sub(r"(?s)<(style|script).*?</\1>|<[^>]*>", " ", page)
    assert "no shapes" in page
    assert not OF_SHAPES.search(page)


def test_the_ground_moves_no_place_where_there_is_none():
    """Though how it moves the masses is given."""
    structure = SPACE["matrix_structure"](sensors={}, influence=(1.0, 1.0))
    (likelihood,) = bs.ModelClass("x", structure, SPACE["data"], pairing={"1": 1}).likelihoods
    draws = PosteriorDraws("x", likelihood, np.ones((1, 2)))
    assert structures_of_unknown_ground(Predictions("x", (draws,))) == [structure]


def test_what_needs_places_is_refused_in_one_line(study):
    for arguments, reason in (
        (["search", study], "a search needs a structure that carries elements"),
        (["plan", study, "--sensors", 1, "--class", "class"], "no place in common that a sensor"),
    ):
        (line,) = run(*arguments, code=2).splitlines()
        assert reason in line


def test_masses_without_a_scale_are_refused_before_sampling():
    whole = STUDY_OF("reduced with places", pairing="any")
    with pytest.raises(ValueError, match="no mode of the structure moves a sensor, so masses"):
        bs.search(whole, run=bs.Run(progress=lambda *_: pytest.fail("it samples")))


def test_a_mode_with_a_shape_beside_one_without():
    (alone,) = STUDY_OF("building").model_classes
    modes = (replace(alone.data.modes[0], shape=np.array([0.53, 0.85])), alone.data.modes[1])
    part = replace(alone.data, modes=modes, sensors=("floor 1", "floor 2"))
    posterior = bs.sample(bs.ModelClass("x", alone.structure, part, alone.error,
                                        pairing=alone.pairing))  # fmt: skip
    first, second = posterior.configurations[0].updated.modes
    assert first.mac_after[1] > 0.99
    assert second.mac_after is None
