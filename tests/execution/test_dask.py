"""Workers of a Dask cluster: the same values, and the loss of workers."""

import json
import logging
import os
import threading
import time

import numpy as np
import pytest
from conftest import COARSE, assert_one_line_error
from pools import points, sums

import bayes_ssi as bs
from bayes_ssi.inference.workers.executors import DaskWorkers

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


@pytest.fixture
def soon(monkeypatch):
    """A second for what may take a cluster ten."""
    monkeypatch.setattr(DaskWorkers, "cluster_seconds", 1.0)


def test_both_workers_are_used_and_rows_that_fail_or_kill_say_why(address):
    def slow_process_ids(z):
        time.sleep(0.02)
        if (z == 11.0).any():
            raise ArithmeticError("no modes")
        if (z == 12.0).any():
            os._exit(1)
        return np.full(len(z), float(os.getpid()))

    z = points(40)
    z[4], z[30] = 11.0, 12.0
    with DaskWorkers(address) as pool:
        values, failures = pool.evaluate(slow_process_ids, z)
    assert set(failures) == {4, 30}
    assert failures[4].startswith("ArithmeticError: no modes (")
    assert failures[30] == "the worker that evaluated it died"
    assert np.flatnonzero(np.isnan(values)).tolist() == [4, 30]
    processes = set(np.delete(values, [4, 30]))
    assert len(processes) >= 2
    assert os.getpid() not in processes


def takes_long(z):
    time.sleep(1.0)
    return z.sum(axis=1)


@pytest.mark.usefixtures("soon")
def test_clusters_without_workers(monkeypatch):
    """They are waited for at first and when the last one has gone; then the run ends."""
    with make_cluster(0) as made:
        message = r"^the Dask cluster at 'tcp://.*' has no workers, not even after 1 s$"
        with pytest.raises(ValueError, match=message), DaskWorkers(made.scheduler_address):
            pass
        monkeypatch.undo()
        threading.Timer(0.3, made.scale, [1]).start()
        with DaskWorkers(made.scheduler_address) as pool:
            np.testing.assert_array_equal(pool.evaluate(sums, points(9)).values, sums(points(9)))
            pool.cluster_seconds = 1.0
            threading.Timer(0.3, made.scale, [0]).start()
            with pytest.raises(ValueError, match="workers: none is left"):
                pool.evaluate(takes_long, points(8))


def test_a_run_whose_scheduler_has_gone_ends():
    with make_cluster(1) as made, DaskWorkers(made.scheduler_address) as pool:
        threading.Timer(0.3, made.close).start()
        with pytest.raises(ValueError, match=r"^workers: "):
            pool.evaluate(takes_long, points(8))


@pytest.mark.parametrize("address", ["x", "nowhere://127.0.0.1:8786"])
def test_a_malformed_address_is_refused(address):
    message = f"^no Dask scheduler answers at '{address}': "
    with pytest.raises(ValueError, match=message), DaskWorkers(address):
        pass


# ArviZ: there are more chains than steps.
@pytest.mark.filterwarnings("ignore:(More chains|Found chain):UserWarning")
def test_the_command_gives_the_same_with_dask(
    run, address, tmp_path, tiny_study_file, tiny_study, monkeypatch
):
    monkeypatch.setattr(
        "bayes_ssi.inference.sampling.settings.SamplingSettings", lambda **_: COARSE
    )
    # A batch in fewer parts is there sooner: these take Dask longer than the model.
    monkeypatch.setattr(DaskWorkers, "parts_per_worker", 1)
    result = run(
        "rank", tiny_study_file, "--class", "one k", "--dask", address, "--accept-failed-checks",
        "--out", tmp_path / "result",
    )  # fmt: skip
    assert (result.exit_code, result.stderr) == (0, "sampled one k\n")
    (row,) = json.loads((tmp_path / "result" / "comparison.json").read_text())["classes"]
    here = bs.rank(tiny_study.only(["one k"]), settings=COARSE).comparison.best
    assert row["log_evidence"] == here.log_evidence


@pytest.mark.usefixtures("soon")
def test_a_scheduler_that_does_not_answer_ends_the_command_in_one_line(run, tiny_study_file):
    begun = time.monotonic()
    result = run("rank", tiny_study_file, "--dask", "tcp://127.0.0.1:1")
    assert time.monotonic() - begun < 6.0
    assert_one_line_error(result)
    said = "Error: no Dask scheduler answers at 'tcp://127.0.0.1:1': "
    assert result.stderr.startswith(said)
