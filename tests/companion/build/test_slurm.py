"""A real Slurm runs the same tasks through dask-jobqueue; opt-in: ``make test-slow``, as root."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from conftest import ROOT, small_flight
from slurm_tools import LocalSlurm, missing

from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.sweep import SweepPlan, sweep
from trexton.flights.writing import write_flight


@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_records_through_slurm_are_equal_to_the_bit(tmp_path):
    jobqueue = pytest.importorskip("dask_jobqueue")
    flight = FlightPair(str(write_flight(small_flight(), tmp_path / "room")))
    plan = SweepPlan(
        "mocap_training",
        {"repeats": [3], "particles": [9], "neighbors": [2], "seed": [1, 2]},
        [flight],
    )
    sweep(plan, tmp_path / "here")
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
        swept = sweep(plan, tmp_path / "there", cluster=cluster.scheduler_address)
    assert swept.counts["ran"] == 2, swept.failed
    here, there = ((tmp_path / out / "sweep.json").read_bytes() for out in ("here", "there"))
    assert here == there
