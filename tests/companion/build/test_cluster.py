"""The same tasks on a Dask cluster: equal records; a worker that dies costs only what it did."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import dask
import distributed  # noqa: F401  its defaults come first: a block of settings would drop them
import numpy as np
import pytest
from conftest import small_flight
from dask_tools import Cluster
from patience import eventually

from trexton.base.errors import ParameterError, TrextonError
from trexton.cli.main import main
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.sweep import SweepPlan, sweep
from trexton.companion.build.workers import callers, connect
from trexton.flights.writing import write_flight

RECORDED = ("parameters", "values", "provenance")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """One for all tests: one of them kills a worker, whatever the order."""
    with Cluster(tmp_path_factory.mktemp("cluster"), workers=2) as running:
        yield running


@pytest.fixture
def flight(tmp_path):
    write_flight(small_flight(), tmp_path / "room")
    return tmp_path / "room"


def scaled(factor: float, item: int) -> np.ndarray:
    return np.random.default_rng(item).normal(size=3) * factor


def killer(folder: str, item: int) -> int:
    """The first process that is given item 1 dies of it."""
    mark = Path(folder) / "died"
    if item == 1 and not mark.exists():
        mark.write_text("once")
        os.kill(os.getpid(), signal.SIGKILL)
    return item * item


def test_calls_give_the_same_everywhere(cluster):
    here, beside, there = [scaled(2.0, item) for item in range(7)], [], []
    for address, left in ((None, beside), (cluster.address, there)):
        with callers(address, 2) as (_, call, _):
            left += [call(scaled, 2.0, item) for item in range(7)]
    assert np.array_equal(here, beside) and np.array_equal(here, there)


def plan(flight, **settings):
    chosen = {"repeats": [1], "particles": [9], "neighbors": [2], "seed": [5]} | settings
    return SweepPlan("mocap_training", chosen, [FlightPair(str(flight))])


def test_records_are_equal_to_the_bit(cluster, flight, tmp_path):
    for out, address in (("here", None), ("there", cluster.address)):
        swept = sweep(plan(flight), tmp_path / out, jobs=1, cluster=address)
        assert swept.counts["ran"] == 1, swept.failed
    here, there = (
        json.loads(next((tmp_path / out / "cells").glob("*/*.json")).read_text())
        for out in ("here", "there")
    )
    assert [here[key] for key in RECORDED] == [there[key] for key in RECORDED]


def test_nothing_answers(flight, tmp_path):
    with pytest.raises(ParameterError, match="no Dask scheduler answers at tcp://127.0.0.1:9"):
        sweep(plan(flight), tmp_path / "out", cluster="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()


def test_what_is_no_scheduler_is_told_at_once(monkeypatch):
    """The address of the dashboard, or of another server, was waited for without end."""
    monkeypatch.setattr("trexton.companion.build.workers._GREETING_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        for address in (f"tcp://127.0.0.1:{port}", f"http://127.0.0.1:{port}"):
            with pytest.raises(ParameterError, match=f"no Dask scheduler answers at {address}"):
                connect(address)


def test_a_killed_worker_costs_only_its_task(cluster, tmp_path):
    """One of the workers is killed by a task; it alone is done again, by another."""
    before = cluster.alive
    with callers(cluster.address, None) as (_, call, _):
        with ThreadPoolExecutor() as pool:
            done = pool.map(partial(call, killer, str(tmp_path)), range(6))
            assert list(done) == [0, 1, 4, 9, 16, 25]
    assert (tmp_path / "died").exists()
    assert cluster.alive == before - 1


def begun(mark: str, wait_s: float) -> str:
    """A task that leaves a mark when it begins."""
    with open(mark, "a") as marks:
        marks.write("x")
    time.sleep(wait_s)
    return "done"


def lacking() -> str:
    """What a worker answers who does not have the package."""
    raise ImportError("none here")


def test_a_worker_that_lacks_the_package_is_named(cluster, monkeypatch):
    monkeypatch.setattr("trexton.companion.build.workers._fingerprint", lacking)
    with pytest.raises(ParameterError, match="worker of .* does not run this trexton .none here"):
        with callers(cluster.address, None):
            pass


def test_a_scheduler_without_workers_and_one_that_is_lost_are_named(flight, tmp_path):
    with Cluster(tmp_path, workers=0) as own:
        with pytest.raises(ParameterError, match="no workers"):
            sweep(plan(flight), tmp_path / "out", cluster=own.address)
        assert not (tmp_path / "out").exists()
        own.add_worker()
        with callers(own.address, None) as (_, call, _), ThreadPoolExecutor() as pool:
            task = pool.submit(call, begun, str(tmp_path / "begun"), 30.0)
            assert eventually((tmp_path / "begun").exists)
            own.processes[0].kill()
            with pytest.raises(TrextonError, match="was lost: start it and its workers, and repea"):
                task.result()


@pytest.fixture
def pem(tmp_path):
    """A key and a certificate that vouches for itself."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificate")
    files = [str(tmp_path / name) for name in ("cert.pem", "cert.pem", "key.pem")]
    words = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=me"
    made = [*words.split(), "-out", files[0], "-keyout", files[2]]
    subprocess.run(["openssl", *made], check=True, capture_output=True)
    return files


def test_a_cluster_is_reached_with_tls(tmp_path, pem, flight):
    """The verb names the files."""
    kinds = ("--tls-ca", "--tls-cert", "--tls-key")
    options = [
        word for kind, file in zip(kinds, pem, strict=True) for word in (f"{kind}-file", file)
    ]
    options = [word.replace("-cert-file", "-cert").replace("-key-file", "-key") for word in options]
    named = [word for kind, file in zip(kinds, pem, strict=True) for word in (kind, file)]
    read = [f"distributed.comm.tls.{key}" for key in ("ca-file", "client.cert", "client.key")]
    with dask.config.set(dict(zip(read, pem, strict=True))):
        cluster = Cluster(tmp_path, workers=1, options=options).__enter__()
    try:
        address = cluster.address
        (tmp_path / "plan.toml").write_text(
            f'experiment = "mocap_training"\nflights = ["{flight}"]\n'
            "[set]\nparticles = 5\nrepeats = 1\nneighbors = 2\n"
        )
        words = ["sweep", str(tmp_path / "plan.toml"), "--quiet", "--cluster", address]
        with pytest.raises(ParameterError, match="name --tls-ca, --tls-cert and --tls-key"):
            connect(address)
        assert main([*words, "--out", str(tmp_path / "out"), *named]) == 0
    finally:
        cluster.__exit__()
    assert address.startswith("tls://")
    assert len(list((tmp_path / "out" / "cells" / "small").iterdir())) == 1


def test_files_of_tls_are_for_an_address_of_tls_and_there(tmp_path, flight, capsys):
    (tmp_path / "plan.toml").write_text("")
    words = ["sweep", str(tmp_path / "plan.toml"), "--out", str(tmp_path / "out")]
    words += ["--cluster", "tcp://127.0.0.1:1"]
    assert main([*words, "--tls-ca", __file__]) == 1
    assert "expected an address tls://HOST:PORT" in capsys.readouterr().err
    assert main([*words, "--tls-ca", str(tmp_path / "none")]) == 1
    assert "none: no such file" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
