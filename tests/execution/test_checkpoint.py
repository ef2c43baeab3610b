"""The checkpoint of a run: resuming from it gives the result of an uninterrupted run."""

import math
import re
import shutil
import sqlite3
from contextlib import closing
from dataclasses import fields, replace

import numpy as np
import pytest
from delegating import DelegatingStructure

import bayes_ssi as bs
from bayes_ssi.foundations.packages import versions
from bayes_ssi.inference.posterior.model_at_draws import DatumTerms
from bayes_ssi.inference.workers.run import Checkpoint
from bayes_ssi.inference.workers.workers import Evaluated
from bayes_ssi.structures.modal import Modes

SETTINGS = bs.SamplingSettings()


class Hidden(DelegatingStructure):
    """A building whose description is empty and does not even state how much softer it is."""

    def __init__(self, building, softer=1.0, limit=np.inf):
        super().__init__(building)
        self.softer = softer
        self.limit = limit

    def modes(self, values):
        if (values > self.limit).any():
            raise ArithmeticError(f"stiffer than {self.limit:g}")
        frequencies_hz, shapes = super().modes(values)
        return Modes(self.softer * frequencies_hz, shapes)


@pytest.fixture
def directory(tmp_path):
    return tmp_path / "checkpoint"


@pytest.fixture
def said():
    return []


@pytest.fixture
def checkpoint(directory, said):
    return Checkpoint(directory, say=said.append)


@pytest.fixture(scope="module")
def whole_journals(tiny_study, tiny_ranking, tmp_path_factory):
    """Name of a file → batches, of the journals of ``tiny_ranking`` in the order of the study."""
    directory = tmp_path_factory.mktemp("whole") / "checkpoint"
    assert_equal(bs.rank(tiny_study, seed=7, run=bs.Run(checkpoint=directory)), tiny_ranking)
    names = [next(directory.glob(f"{name}_k-*.journal")).name for name in ("one", "each")]
    return {name: (directory / name, batches_of(directory / name)) for name in names}


def batches_of(journal):
    """Digest, log-likelihoods and failures of every batch."""
    with closing(sqlite3.connect(journal)) as database:
        return database.execute("SELECT * FROM batches ORDER BY number").fetchall()


def keep_only(journal, n):
    """Leave only the first ``n`` batches of a journal."""
    with closing(sqlite3.connect(journal, isolation_level=None)) as database:
        database.execute("DELETE FROM batches WHERE number > ?", [n])


def assert_holds(directory, journals):
    there = {path.name: batches_of(path) for path in directory.iterdir()}
    assert there == {name: batches for name, (_, batches) in journals.items()}


@pytest.fixture(scope="module")
def one_class(tiny_study):
    return tiny_study.only(["one k"])


@pytest.fixture
def one_k(tiny_study):
    return tiny_study.model_classes[0]


def stop(directory, journals, share):
    """Checkpoint of a run that is killed when ``share`` of its batches are written."""
    directory.mkdir()
    left = int(share * sum(len(batches) for _, batches in journals.values()))
    for name, (path, batches) in journals.items():
        if left > 0:
            shutil.copyfile(path, directory / name)
            keep_only(directory / name, left)
        left -= len(batches)


def assert_equal(a, b):
    assert a.comparison == b.comparison
    for left, right in zip(a.posteriors, b.posteriors, strict=True):
        assert_same_fields(left, right)


def assert_same_fields(left, right):
    for item in fields(left):
        x, y = getattr(left, item.name), getattr(right, item.name)
        if isinstance(x, np.ndarray):
            assert (x.shape, x.tobytes()) == (y.shape, y.tobytes()), item.name
        elif isinstance(x, DatumTerms):
            assert_same_fields(x, y)
        elif item.name == "importance_draws":
            assert x.keys() == y.keys()
            for name in x:
                np.testing.assert_array_equal(x[name], y[name], err_msg=name)
        elif item.name != "seconds":
            assert x == y, item.name


@pytest.mark.parametrize("share", np.random.default_rng(11).random(4).round(6))
def test_a_run_stopped_anywhere_is_resumed_to_the_same_result(
    tiny_study, tiny_ranking, whole_journals, checkpoint, directory, share
):
    stop(directory, whole_journals, share)
    assert_equal(bs.rank(tiny_study, seed=7, run=bs.Run(checkpoint=checkpoint)), tiny_ranking)
    assert_holds(directory, whole_journals)


def rounded(monkeypatch, size):
    """Let factors and inverses of matrices differ by errors of a relative size."""

    def errors(shape):  # the same in every call, whatever was computed before
        return size * np.cos(1.0 + np.arange(math.prod(shape))).reshape(shape)

    def other(solve):
        def solved(matrices):
            answer = solve(matrices)
            arrays = answer if isinstance(answer, tuple) else (answer,)
            arrays = tuple(a * (1.0 + errors(a.shape)) for a in arrays)
            return arrays if isinstance(answer, tuple) else arrays[0]

        return solved

    for name in ("cholesky", "eigh", "inv"):
        monkeypatch.setattr(np.linalg, name, other(getattr(np.linalg, name)))


@pytest.mark.parametrize(("size", "share"), [(1e-15, 0.6), (1e-15, 1.0), (2e-8, 1.0)])
def test_a_run_is_resumed_on_a_processor_that_rounds_in_another_way(
    tiny_study, tiny_ranking, whole_journals, checkpoint, directory, said, monkeypatch, size, share
):
    stop(directory, whole_journals, share)
    rounded(monkeypatch, size)
    resumed = bs.rank(tiny_study, seed=7, run=bs.Run(checkpoint=checkpoint))
    for here, there in zip(resumed.posteriors, tiny_ranking.posteriors, strict=True):
        joint = np.hypot(here.evidence.error, there.evidence.error)
        assert abs(here.evidence.log_evidence - there.evidence.log_evidence) < 4.0 * joint
        assert here.failed_checks == there.failed_checks
    again = [message for message in said if "another kind of processor" in message]
    assert bool(again) == (size > 1e-10)


def test_a_path_will_do_and_then_one_is_warned(one_class, tiny_ranking, whole_journals, directory):
    stop(directory, whole_journals, 0.2)
    with pytest.warns(RuntimeWarning, match="model class 'one k': resumes after") as caught:
        posterior = bs.rank(one_class, seed=7, run=bs.Run(checkpoint=str(directory))).posteriors[0]
    assert len(caught) == 1
    assert posterior.evidence == tiny_ranking.posteriors[0].evidence


def test_damage_is_said_and_harms_nothing(
    tiny_study, tiny_ranking, whole_journals, checkpoint, directory, said
):
    stop(directory, whole_journals, 1.0)
    path = directory / next(iter(whole_journals))
    path.write_bytes(path.read_bytes()[:10000])
    assert_equal(bs.rank(tiny_study, seed=7, run=bs.Run(checkpoint=checkpoint)), tiny_ranking)
    assert_holds(directory, whole_journals)
    assert said[0] == f"{path}: damaged, or not a checkpoint; everything is computed again"
    assert len(said) == 2, "the other class's journal is whole"


def other_class(one_k, **changes):
    return replace(one_k, **{"pairing": one_k.pairing, **changes})


def test_another_run_is_refused_in_a_line_that_names_the_difference(checkpoint, one_k, monkeypatch):
    checkpoint.journal(one_k, 7, SETTINGS).close()
    coarse = replace(SETTINGS, log_evidence_error=0.1)
    other_classes = (
        other_class(one_k, data=one_k.data.without_shapes()),
        other_class(one_k, error=bs.ErrorModel(0.03, 0.05)),
        other_class(one_k, pairing={"1": 1}),
        other_class(one_k, structure=bs.ShearBuilding((1.0, 1.1), one_k.structure.stiffnesses)),
    )
    definition = r'definition "\w{16}" there and "\w{16}" here'
    for other, difference in (
        ((one_k, 8, SETTINGS), "seed 7 there and 8 here"),
        ((one_k, 7, coarse), r"log_evidence_error 0\.01 there and 0\.1 here"),
        *(((each, 7, SETTINGS), definition) for each in other_classes),
    ):
        message = rf"one_k-\w{{8}}\.journal: the checkpoint of another run, with {difference}; fin"
        with pytest.raises(ValueError, match=message) as caught:
            checkpoint.journal(*other)
        assert "\n" not in str(caught.value)
    here = {**versions(), "numpy": "3.0"}
    monkeypatch.setattr("bayes_ssi.inference.workers.run.versions", lambda: here)
    with pytest.raises(ValueError, match=rf'numpy "{np.__version__}" there and "3\.0" here; fin'):
        checkpoint.journal(one_k, 7, SETTINGS)


@pytest.mark.parametrize(("change", "is_same"), [(1e-15, True), (1e-3, False)])
@pytest.mark.parametrize("what", ["matrix", "covariance"])
def test_computed_numbers_define_a_class_but_for_their_rounding(
    checkpoint, one_k, what, change, is_same
):
    noise = 1.0 + change * np.random.default_rng(0).uniform(-1.0, 1.0, 2)

    def made(factors):
        data, structure = one_k.data, one_k.structure
        if what == "covariance":
            root = 1e-3 * np.random.default_rng(1).standard_normal((3 * len(data.modes),) * 2)
            factors = np.resize(factors, len(root))
            modes = tuple(replace(m, frequency_cov=None, shape_sd=None) for m in data.modes)
            covariance = factors[:, None] * (root @ root.T) * factors
            data = replace(data, modes=modes, covariance=covariance)
        else:
            stiffness = factors[:, None] * np.array([[2.0, -1.0], [-1.0, 1.0]]) * factors
            parameter = one_k.structural_parameters[0]
            structure = bs.MatrixStructure(
                [(parameter, stiffness)], np.eye(2), labels=data.sensors[:2], n_modes=2
            )
            modes = tuple(replace(mode, shape=mode.shape[:2]) for mode in data.modes[:2])
            data = bs.ModalData(modes, data.band_hz, data.sensors[:2])
        return other_class(one_k, data=data, structure=structure, pairing="any")

    checkpoint.journal(made(np.ones(2)), 7, SETTINGS).close()
    if is_same:
        checkpoint.journal(made(noise), 7, SETTINGS).close()
    else:
        with pytest.raises(ValueError, match="definition"):
            checkpoint.journal(made(noise), 7, SETTINGS)


def test_the_checkpoint_of_another_run_is_discarded_on_request(directory, one_k, said):
    with Checkpoint(directory).journal(one_k, 7, SETTINGS) as journal:
        journal.add(np.zeros((1, 1)), Evaluated(np.zeros(1), {}))
    discarding = Checkpoint(directory, discard_others=True, say=said.append)
    with discarding.journal(one_k, 8, SETTINGS) as journal:
        assert (journal.n_kept, said) == (0, [])
        journal.add(np.zeros((2, 1)), Evaluated(np.zeros(2), {}))
    with Checkpoint(directory, say=said.append).journal(one_k, 8, SETTINGS) as journal:
        assert journal.n_kept == 2


@pytest.mark.parametrize("seed", [7, 8])
def test_a_journal_in_use_is_never_discarded(directory, one_k, seed):
    with Checkpoint(directory).journal(one_k, 7, SETTINGS) as journal:
        with pytest.raises(ValueError, match="another run is using this checkpoint"):
            Checkpoint(directory, discard_others=True).journal(one_k, seed, SETTINGS)
        assert journal.path.exists()


def hidden_study(one_k, **hidden):
    return bs.Study("s", [other_class(one_k, structure=Hidden(one_k.structure, **hidden))])


def test_a_structure_without_a_description_can_be_continued(one_k, checkpoint, said):
    """The default description of an object holds its address."""
    first, second = (hidden_study(one_k) for _ in range(2))
    descriptions = {repr(study.model_classes[0].structure) for study in (first, second)}
    assert len(descriptions) == 2
    expected = bs.rank(first, run=bs.Run(checkpoint=checkpoint))
    assert_equal(bs.rank(second, run=bs.Run(checkpoint=checkpoint)), expected)
    assert len(said) == 1


def test_a_model_that_changed_is_refused_though_its_description_did_not(one_k, directory):
    bs.rank(hidden_study(one_k), run=bs.Run(checkpoint=directory))
    before = {p: p.read_bytes() for p in directory.iterdir()}
    message = (
        r"model class 'one k': .*one_k-\w{8}\.journal: the model gives other values than when this "
        "checkpoint was made; remove it to begin again$"
    )
    checkpoint = Checkpoint(directory, say=lambda _: None)
    with pytest.raises(ValueError, match=message):
        bs.rank(hidden_study(one_k, softer=0.999), run=bs.Run(checkpoint=checkpoint))
    assert {p: p.read_bytes() for p in directory.iterdir()} == before


def test_failures_of_the_model_are_continued(one_k, checkpoint):
    study = hidden_study(one_k, limit=2.0)
    expected = bs.rank(study)
    (failed,) = expected.posteriors[0].failed_checks
    assert "the model failed at" in failed
    assert re.search(r": ArithmeticError: stiffer than 2 \(test_checkpoint\.py, line .*\)$", failed)
    bs.rank(study, run=bs.Run(checkpoint=checkpoint))
    (path,) = checkpoint.directory.iterdir()
    batches = batches_of(path)
    keep_only(path, len(batches) // 2)
    assert_equal(bs.rank(study, run=bs.Run(checkpoint=checkpoint)), expected)
    assert batches_of(path) == batches


def test_names_need_not_be_file_names(one_k, checkpoint):
    names = ["a/b", "a:b", "a_b", "..", "θ", "x" * 300]
    paths = set()
    for name in names:
        with checkpoint.journal(other_class(one_k, name=name), 7, SETTINGS) as journal:
            assert journal.path.parent == checkpoint.directory
            paths.add(journal.path.name.lower())
    assert len(paths) == len(names)


def test_removing_leaves_the_journals_of_others(directory, checkpoint, tiny_study):
    for model_class in tiny_study.model_classes:
        checkpoint.journal(model_class, 7, SETTINGS).close()
    checkpoint.begin_saving()
    checkpoint.remove(("one k",))
    (left,) = directory.iterdir()
    assert left.name.startswith("each_k-")
    checkpoint.remove(("each k",))
    assert not directory.exists()


def test_a_run_that_was_refused_leaves_nothing_in_the_way(one_class, directory):
    """Its input is corrected, which makes the next run a different one."""
    (candidate,) = one_class.model_classes

    class Refused(bs.ShearBuilding):
        def modes(self, values):  # noqa: ARG002
            raise ValueError("the stiffness matrix is not positive definite")

    building = candidate.structure
    refused = Refused(building.masses, building.stiffnesses)
    study = bs.Study("s", [replace(candidate, structure=refused)])
    with pytest.raises(ValueError, match="not positive definite"):
        bs.rank(study, run=bs.Run(checkpoint=directory))
    assert not directory.exists()
    bs.rank(one_class, run=bs.Run(checkpoint=directory))


def test_a_run_that_was_killed_before_it_kept_anything_is_said_to_begin_again(
    directory, checkpoint, one_k, said
):
    with checkpoint.locked():
        left = (directory / "lock").read_bytes()
    assert said == []
    directory.mkdir()  # as the earliest kill left it
    with checkpoint.locked():
        assert said == ["an earlier run was interrupted before it kept an evaluation; begins again"]
    directory.mkdir()
    (directory / "lock").write_bytes(left)  # a later one
    with checkpoint.locked():
        assert said[1:] == said[:1]
        checkpoint.journal(one_k, 7, SETTINGS).close()
    (directory / "lock").write_bytes(left)
    with checkpoint.locked():
        assert len(said) == 2, "a journal speaks for itself"
        checkpoint.journal(one_k, 7, SETTINGS).close()
    assert said[2:] == [f"model class {one_k.name!r}: begins again, as no evaluation was kept"]
