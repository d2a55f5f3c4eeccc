"""A real Slurm runs the same tasks through dask-jobqueue; opt-in: ``make test-slow``, as root."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest
from conftest import ROOT, small_flight
from slurm_tools import LocalSlurm, missing

from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.plan import run_experiments
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.flights import write_flight


@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_records_through_slurm_are_equal_to_the_bit(tmp_path):
    jobqueue = pytest.importorskip("dask_jobqueue")
    flight = FlightPair(str(write_flight(small_flight(), tmp_path / "room")))
    chosen = {"repeats": 3, "particles": 9, "neighbors": 2}
    experiments = {name: EXPERIMENTS[name] for name in ("mocap_training", "map_loss")}
    run_experiments([flight], tmp_path / "here", settings=chosen, experiments=experiments)
    (tmp_path / "slurm").mkdir()
    paths = os.pathsep.join([str(ROOT), str(Path(__file__).parent)])
    with (
        LocalSlurm(tmp_path / "slurm"),
        jobqueue.SLURMCluster(
            queue="all", cores=1, processes=1, memory="400MB", walltime="00:10:00", interface="lo",
            python=sys.executable, job_script_prologue=[f"export PYTHONPATH={paths}"],
            log_directory=str(tmp_path), local_directory=str(tmp_path), nanny=False,
            scheduler_options={"dashboard_address": ":0"},
        ) as cluster,
    ):  # fmt: skip
        cluster.scale(jobs=2)
        cluster.wait_for_workers(2, timeout=120)
        outcomes = run_experiments(
            [flight], tmp_path / "there", settings=chosen, experiments=experiments,
            cluster=cluster.scheduler_address,
        )  # fmt: skip
    assert [outcome.status for outcome in outcomes] == ["ran", "ran"], outcomes
    for name in experiments:
        here, there = (
            json.loads((tmp_path / out / "small" / f"{name}.json").read_text())
            for out in ("here", "there")
        )
        for key in ("parameters", "values", "series", "images", "provenance"):
            assert here[key] == there[key], f"{name}: {key}"
