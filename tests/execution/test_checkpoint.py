"""The checkpoint of a run: resuming from it gives the result of an uninterrupted run."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest
from delegating import DelegatingStructure

import bayes_ssi as bs
from bayes_ssi.inference.posterior.model_at_draws import DatumTerms
from bayes_ssi.inference.workers.cache import Cache
from bayes_ssi.inference.workers.run import Checkpoint
from bayes_ssi.inference.workers.workers import Evaluated


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
        return bs.Modes(self.softer * frequencies_hz, shapes)


@pytest.fixture
def directory(tmp_path):
    return tmp_path / "checkpoint"


@pytest.fixture
def checkpoint(directory):
    return Checkpoint(directory)


@pytest.fixture
def one_k(tiny_study):
    return tiny_study.model_classes[0]


@pytest.fixture
def kept(monkeypatch):
    """Numbers of the points of each batch that is kept; the batch ``kept.last`` is half written."""
    keep = Cache.keep

    class Kept(list):
        last = None

    def noted(cache, model, z, evaluated):
        if len(noted.kept) == noted.kept.last:
            cache._database.execute("BEGIN")
            keep(cache, model, z, evaluated)
            raise KeyboardInterrupt
        keep(cache, model, z, evaluated)
        noted.kept.append(len(z))

    noted.kept = Kept()
    monkeypatch.setattr(Cache, "keep", noted)
    return noted.kept


def plain(posterior):
    """What a posterior holds, but for the time that it took."""
    held = {each.name: getattr(posterior, each.name) for each in fields(posterior)}
    terms = {name: vars(x) for name, x in held.items() if isinstance(x, DatumTerms)}
    return held | terms | {"seconds": 0.0}


def assert_equal(a, b):
    assert a.comparison == b.comparison
    np.testing.assert_equal(list(map(plain, a.posteriors)), list(map(plain, b.posteriors)))


def test_a_run_interrupted_anywhere_is_resumed(tiny_study, tiny_ranking, directory, kept):
    """Nothing is evaluated twice; the directory may be given as such."""
    for kept.last in (0, 17, 90, None):
        run = bs.Run(checkpoint=str(directory))
        try:
            resumed = bs.rank(tiny_study, seed=7, run=run)
        except KeyboardInterrupt:
            assert len(kept) == kept.last
    assert_equal(resumed, tiny_ranking)
    assert len(kept) > 100
    n_kept, kept.last = len(kept), len(kept)
    assert_equal(bs.rank(tiny_study, seed=7, run=run), tiny_ranking)
    assert len(kept) == n_kept


def other_class(one_k, **changes):
    return replace(one_k, **{"pairing": one_k.pairing, **changes})


def test_other_runs_have_other_files(checkpoint, one_k, monkeypatch):
    def name_of(model_class, *options):
        with checkpoint.cache(model_class, *options) as cache:
            assert cache.path.parent == checkpoint.directory
            return cache.path.name.lower()

    others = [
        *(one_k, other_class(one_k, data=one_k.data.without_shapes())),
        other_class(one_k, error=bs.ErrorModel(0.03, 0.05)),
        other_class(one_k, pairing={"1": 1}),
        other_class(one_k, structure=bs.ShearBuilding((1.0, 1.1), one_k.structure.stiffnesses)),
        *(other_class(one_k, name=name) for name in ("a/b", "a:b", "a_b", "..", "θ", "x" * 300)),
    ]
    names = [*map(name_of, others), name_of(one_k, 8), name_of(one_k, bs.SamplingSettings())]
    assert name_of(one_k) == names[0]
    monkeypatch.setattr("bayes_ssi.inference.workers.run.versions", lambda: {"numpy": "3.0"})
    names.append(name_of(one_k))
    assert len(set(names)) == len(names)
    assert list(checkpoint.directory.iterdir()) == [], "and nothing is left where nothing is kept"


@pytest.mark.parametrize(("change", "is_same"), [(1e-15, True), (1e-3, False)])
def test_computed_numbers_define_a_class_but_for_their_rounding(checkpoint, one_k, change, is_same):
    def file_of(factor):
        parameter = one_k.structural_parameters[0]
        stiffness = factor * np.array([[2.0, -1.0], [-1.0, 1.0]])
        structure = bs.MatrixStructure(
            [(parameter, stiffness)], np.eye(2), labels=one_k.data.sensors, n_modes=2
        )
        with checkpoint.cache(other_class(one_k, structure=structure)) as cache:
            return cache.path

    assert (file_of(0.3) == file_of(0.3 * (1.0 + change))) == is_same


def hidden_study(one_k, **hidden):
    return bs.Study("s", [other_class(one_k, structure=Hidden(one_k.structure, **hidden))])


def test_a_structure_without_a_description_is_resumed_unless_changed(one_k, checkpoint, kept):
    """The default description of an object holds its address."""
    first, second = (hidden_study(one_k, limit=2.0) for _ in range(2))
    assert len({repr(study.model_classes[0].structure) for study in (first, second)}) == 2
    run = bs.Run(checkpoint=checkpoint)
    expected = bs.rank(first, run=run)
    (failed,) = expected.posteriors[0].failed_checks
    assert "the model failed at" in failed
    assert re.search(r": ArithmeticError: stiffer than 2 \(test_checkpoint\.py, line .*\)$", failed)
    kept.last = len(kept)
    assert_equal(bs.rank(second, run=run), expected)
    message = r"^model class 'one k': .*one_k-\w{16}: the model gives other values than when this "
    with pytest.raises(ValueError, match=message):
        bs.rank(hidden_study(one_k, limit=2.0, softer=0.999), run=run)
    assert_equal(bs.rank(second, run=run), expected)


def test_a_checkpoint_is_locked_and_removed_where_nothing_is_kept(directory, checkpoint, one_k):
    with checkpoint.locked() as is_resumed:
        assert not is_resumed
        with pytest.raises(ValueError, match="another run is using"), checkpoint.locked():
            pass
    assert not directory.exists()
    with checkpoint.locked(), checkpoint.cache(one_k) as cache:
        cache.keep(1, np.zeros((1, 1)), Evaluated(np.zeros(1), {}))
    with checkpoint.locked() as is_resumed:
        assert is_resumed
        checkpoint.remove()
    assert not directory.exists()
