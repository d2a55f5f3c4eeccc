"""Where results lie: never among a flight's files, and whole again whatever became of them."""

from __future__ import annotations

import pytest
from tiny_experiment import tiny
from tiny_notebooks import write_notebook

from trexton.base.errors import ParameterError
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.plan import run_experiments
from trexton.companion.build.sweep import SweepPlan, sweep

KEPT = "mend it, what was there before is kept"


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
            sweep(SweepPlan("mocap_training", {}, [pair]), flight_folder.parent / out)
    assert sorted(flight_folder.parent.rglob("*")) == before


def test_what_stands_in_the_place_of_results_is_named_and_stays(flight_folder, tmp_path):
    notebooks, taken = tmp_path / "notebooks", tmp_path / "out" / "small"
    write_notebook(notebooks, "first")
    taken.parent.mkdir()
    taken.write_text("a person's")
    experiments = {"first": tiny("First")}
    (outcome,) = run_experiments(
        [FlightPair(str(flight_folder))], taken.parent, notebooks=notebooks, experiments=experiments
    )
    assert outcome.reasons == (f"small/first: {taken}: File exists: {KEPT}",)
    assert taken.read_text() == "a person's"
