"""Workers of a Dask cluster: the same values, and the loss of workers."""

import contextlib
import functools
import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import COARSE, assert_one_line_error
from pools import points, sums

import bayes_ssi as bs
from bayes_ssi.inference.workers import dask_workers, workers
from bayes_ssi.inference.workers.batch import evaluate
from bayes_ssi.inference.workers.dask_workers import DaskWorkers

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

pytestmark = pytest.mark.usefixtures("nothing_hangs")


def make_cluster(n_workers):
    return distributed.LocalCluster(
        n_workers=n_workers,
        threads_per_worker=1,
        processes=True,
        dashboard_address=":0",
        silence_logs=logging.CRITICAL,
    )


@pytest.fixture(scope="module")
def cluster():
    """Two workers; a part is abandoned with the first worker that it kills."""
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}), make_cluster(2) as made:
        yield made


@pytest.fixture
def address(cluster):
    cluster.wait_for_workers(2)
    return cluster.scheduler_address


def test_values_do_not_depend_on_who_computes_them(address, model_classes):
    candidate = model_classes["3"]
    z = points(64, len(candidate.parameters))
    with DaskWorkers(address) as pool:
        for n in (1, 2, 7, 64):
            there = pool.evaluate(candidate.log_likelihood_at, z[:n])
            here = evaluate(candidate.log_likelihood_at, z[:n])
            assert there.values.tobytes() == here.values.tobytes()
            assert there.failures == {}


def test_both_workers_are_used_and_rows_that_raise_say_why(address):
    def slow_process_ids(z):
        time.sleep(0.02)
        if (z > 10.0).any():
            raise ArithmeticError("no modes")
        return np.full(len(z), float(os.getpid()))

    z = points(64)
    z[4] = 11.0
    with DaskWorkers(address) as pool:
        values, failures = pool.evaluate(slow_process_ids, z)
    assert set(failures) == {4}
    assert failures[4].startswith("ArithmeticError: no modes (")
    assert len(set(np.delete(values, 4)) - {os.getpid()}) == 2


def test_a_point_at_which_workers_always_die_is_nan_and_the_others_are_right(address):
    def function(z):
        if (z == 11.0).any():
            os._exit(1)
        return z.sum(axis=1)

    z = points(20)
    z[3] = 11.0
    expected = sums(z)
    expected[3] = np.nan
    with DaskWorkers(address) as pool:
        there = pool.evaluate(function, z)
    np.testing.assert_array_equal(there.values, expected)
    assert there.failures == {3: "the worker that evaluated it died"}


@pytest.fixture(scope="module")
def changing_cluster():
    with make_cluster(0) as made:
        yield made


@pytest.fixture
def empty_cluster(changing_cluster):
    """Without workers; a test may give it some."""
    yield changing_cluster
    changing_cluster.scale(0)
    while changing_cluster.scheduler.workers:
        time.sleep(0.02)


def test_a_cluster_without_workers_is_refused(empty_cluster, monkeypatch):
    monkeypatch.setattr(dask_workers, "CLUSTER_SECONDS", 1.0)
    message = r"^the Dask cluster at 'tcp://.*' has no workers, not even after 1 s$"
    with pytest.raises(ValueError, match=message), DaskWorkers(empty_cluster.scheduler_address):
        pass


def test_a_cluster_whose_workers_are_only_starting_is_waited_for(empty_cluster):
    threading.Timer(0.3, empty_cluster.scale, [1]).start()
    with DaskWorkers(empty_cluster.scheduler_address) as pool:
        np.testing.assert_array_equal(pool.evaluate(sums, points(9)).values, sums(points(9)))


def takes_long(z):
    time.sleep(2.0)
    return z.sum(axis=1)


def test_a_run_whose_workers_have_all_gone_ends(empty_cluster, monkeypatch):
    empty_cluster.scale(1)
    with DaskWorkers(empty_cluster.scheduler_address) as pool:
        monkeypatch.setattr(dask_workers, "CLUSTER_SECONDS", 1.0)
        threading.Timer(0.5, empty_cluster.scale, [0]).start()
        with pytest.raises(ValueError, match="workers: none is left"):
            pool.evaluate(takes_long, points(8))


CLUSTER = """
import logging
import time

from distributed import LocalCluster

if __name__ == "__main__":
    with LocalCluster(n_workers=1, dashboard_address=":0", silence_logs=logging.CRITICAL) as made:
        print(made.scheduler_address, flush=True)
        time.sleep(60.0)
"""


@pytest.fixture
def mortal_cluster(tmp_path):
    """A cluster in processes of its own: its address, and how to end it at once."""
    path = tmp_path / "cluster.py"
    path.write_text(CLUSTER)
    command = [sys.executable, str(path)]
    # Its workers import the functions of this module.
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, start_new_session=True, env=environment
    ) as process:
        kill = functools.partial(os.killpg, process.pid, signal.SIGKILL)
        yield process.stdout.readline().strip(), kill
        with contextlib.suppress(ProcessLookupError):
            kill()


def test_a_run_whose_scheduler_has_gone_ends(mortal_cluster):
    address, kill = mortal_cluster
    with DaskWorkers(address) as pool:
        threading.Timer(0.5, kill).start()
        with pytest.raises(ValueError, match=r"^workers: "):
            pool.evaluate(takes_long, points(8))


@pytest.mark.parametrize("address", ["x", "nowhere://127.0.0.1:8786"])
def test_a_malformed_address_is_refused(address):
    message = f"^no Dask scheduler answers at '{address}': "
    with pytest.raises(ValueError, match=message), DaskWorkers(address):
        pass


# ArviZ: there are more chains than steps.
@pytest.mark.filterwarnings("ignore:(More chains|Found chain):UserWarning")
@pytest.mark.usefixtures("no_figures")
def test_the_command_gives_the_same_with_dask(
    run, address, tmp_path, tiny_study_file, tiny_study, monkeypatch
):
    monkeypatch.setattr(
        "bayes_ssi.inference.sampling.settings.SamplingSettings", lambda **_: COARSE
    )
    # A batch in fewer parts is there sooner: these take Dask longer than the model.
    monkeypatch.setattr(workers, "PARTS_PER_WORKER", 1)
    result = run(
        "rank", tiny_study_file, "--only", "one k", "--dask", address, "--accept-failed-checks",
        "--out", tmp_path / "result",
    )  # fmt: skip
    assert (result.exit_code, result.stderr) == (0, "sampled one k\n")
    (row,) = json.loads((tmp_path / "result" / "comparison.json").read_text())["classes"]
    here = bs.rank(tiny_study.only(["one k"]), settings=COARSE).comparison.best
    assert row["log_evidence"] == here.log_evidence


def test_a_scheduler_that_does_not_answer_ends_the_command_in_one_line(
    run, tiny_study_file, monkeypatch
):
    monkeypatch.setattr(dask_workers, "CLUSTER_SECONDS", 1.0)
    begun = time.monotonic()
    result = run("rank", tiny_study_file, "--dask", "tcp://127.0.0.1:1")
    assert time.monotonic() - begun < 6.0
    assert_one_line_error(result)
    said = "Error: no Dask scheduler answers at 'tcp://127.0.0.1:1': "
    assert result.stderr.startswith(said)
