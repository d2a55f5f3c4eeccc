"""Where results lie: never among a flight's files, and whole again whatever became of them."""

from __future__ import annotations

import pytest

from trexton.errors import ParameterError
from trexton.workflow import FlightPair, run_experiments
from trexton.workflow.sweep import Plan, sweep


@pytest.mark.parametrize("out", ["small", ".", "other/../small", "link"])
def test_results_do_not_go_among_the_files_of_a_flight(flight_folder, monkeypatch, out):
    """``--out FLIGHT``, and ``--out .`` beside it: results are put into a folder of its name."""
    monkeypatch.chdir(flight_folder.parent)
    (flight_folder.parent / "link").symlink_to(flight_folder)
    (flight_folder.parent / "other").mkdir()
    before = sorted(flight_folder.parent.rglob("*"))
    for pair in (FlightPair("small"), FlightPair(str(flight_folder))):
        with pytest.raises(ParameterError, match="among the files of the flight .*small: name an"):
            run_experiments([pair], out)
        with pytest.raises(ParameterError, match="among the files of the flight"):
            sweep(Plan("mocap_training", {}, [pair]), flight_folder.parent / out)
    assert sorted(flight_folder.parent.rglob("*")) == before
