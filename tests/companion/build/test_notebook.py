"""What every notebook does: read what it was given, write where it says, name its command."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, python_path, small_flight

from trexton.base.errors import ParameterError
from trexton.companion.build import notebook
from trexton.companion.build.flight_pairs import load_pair
from trexton.companion.experiments import mocap_training
from trexton.companion.experiments.declaration import SeedParameters, option
from trexton.companion.experiments.printed import published
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight
from trexton.vision.images import read_image


@dataclass(frozen=True)
class Parameters(SeedParameters):
    trials: int = option(3, "of nothing", low=1)


@pytest.fixture
def names(tmp_path, monkeypatch):
    """What a notebook in an empty working folder knows."""
    monkeypatch.chdir(tmp_path)
    write_flight(small_flight(), tmp_path / "room")
    return {"flight": "room", "test_flight": None, "out": "mine", "__name__": "__main__"}


def test_defaults_come_from_the_declaration_and_names_replace_them(names):
    assert notebook.given(Parameters, names).parameters == Parameters()
    assert notebook.given(Parameters, names | {"trials": 9}).parameters == Parameters(trials=9)
    with pytest.raises(ParameterError, match="trials is 0: expected 1 or more"):
        notebook.given(Parameters, names | {"trials": 0})


@pytest.mark.parametrize(("wrong", "right"), [("trails", "trials"), ("test_fligth", "test_flight")])
def test_a_misspelt_parameter_is_not_passed_over(names, wrong, right):
    del names["test_flight"]
    with pytest.raises(ParameterError, match=f"sets {wrong} = 9, .* write {right}, or"):
        notebook.given(Parameters, names | {wrong: 9})
    own = {"note": "mine", "pairs": 3, "trial": notebook}  # nothing that could be meant
    assert notebook.given(Parameters, names | own).parameters == Parameters()


def test_a_parameter_that_is_nearly_another_is_no_mistake(names):
    @dataclass(frozen=True)
    class Landing(SeedParameters):
        flights: int = option(2, "flights over each floor", low=1)

    assert notebook.given(Landing, names).parameters == Landing()  # `flight` is set, `flights` not


def test_the_pair_is_the_splits_of_one_flight_or_two_flights(names):
    one = notebook.given(Parameters, names)
    assert len(one.train) + len(one.test) == len(small_flight())
    two = notebook.given(Parameters, names | {"test_flight": "room"})
    assert (len(two.train), len(two.test)) == (len(one.train), len(one.test))


def test_results_stay_below_the_working_folder(names, tmp_path):
    given = notebook.given(Parameters, names)
    record = given.parameters.record(given.train, values={"answer": 42})
    page = notebook.Page(record, given)
    assert page.folder.resolve() == tmp_path / "mine" / "small"
    assert [path.name for path in page.folder.iterdir()] == ["test_notebook.json"]


def test_the_footer_says_the_command_that_makes_it_again(names):
    given = notebook.given(mocap_training.Parameters, names | {"test_flight": "a b", "samples": 9})
    record = given.parameters.record(small_flight(), values={})
    page = notebook.Page(record, given)
    command = page.command()
    assert command == (
        "trexton run room --test-flight &#x27;a b&#x27; --only mocap_training --set samples=9 "
        "--out my-results"
    )
    (page.folder / "mocap_training-floor.svg").write_text("")
    for file in ("mocap_training.json", "mocap_training.ipynb", "mocap_training-floor.svg"):
        assert f'href="{record.flight}/{file}"' in page.footer().data


@pytest.fixture
def page(names):
    """The page of a record with a bit of everything."""
    given = notebook.given(mocap_training.Parameters, names)
    error = {"value": 12.34, "low": 8.0, "high": 123.4}
    values = {"knn": {"error_cm_x": error, "median_cm": 5.06}, "frames": 12345, "share": 0.123456}
    return notebook.Page(given.parameters.record(given.train, values=values), given)


def test_quantities_are_rounded_and_the_absent_left_out(page):
    html = page.quantities({"Frames": "frames", "Share": "share", "None": "no.such"}, "c & d").data
    assert re.findall("<td>(.*?)</td>", html) == ["Frames", "12,345", "Share", "0.123"]
    assert "<caption>c &amp; d</caption>" in html


def test_lengths_of_a_large_flight_are_in_metres(page):
    values = page.record.values
    far = {"value": 5619.0, "low": 5000.0, "high": 6200.0}
    values |= {"far": far, "farther": 7000.0}
    rows = {"Filter (cm)": "far", "Neighbours (cm)": "farther", "Frames": "frames"}
    cells = re.findall("<td>(.*?)</td>", page.quantities(rows, "").data)
    assert cells == ["Filter", "56.2 [50, 62] m", "Neighbours", "70 m", "Frames", "12,345"]
    near = re.findall(
        "<td>(.*?)</td>", page.quantities({**rows, "k (cm)": "knn.median_cm"}, "").data
    )
    assert near[0] == "Filter (cm)" and near[1].startswith("5,620")


def test_errors_stand_beside_the_papers_with_their_intervals(page):
    html = page.table({"Neighbours": "knn", "Absent": "no.such"}, "Errors").data
    rows = [re.findall("<td>(.*?)</td>", row) for row in html.split("<tr>")[1:]]
    assert rows[0][0] == "Paper" and rows[0][1] == str(
        published()["mocap_training"]["error_cm"]["x"]
    )
    assert rows[1][:2] == ["Neighbours", "12 <small>[8, 123]</small>"]
    assert rows[1][-1] == "5.1" and set(rows[2][1:]) == {""}


def test_what_is_kept_with_the_code_is_found_and_what_is_not_is_none():
    assert notebook.reference("fine").experiment == "fine" and notebook.swept("suitability")
    assert notebook.reference("nothing") is None and notebook.swept("nothing") is None


def test_a_notebook_opened_by_hand_writes_nothing_into_the_clone(tmp_path):
    """Papermill, as a person runs it in a folder of their own; parameters as papermill has them."""
    import jupytext

    write_flight(small_flight(), tmp_path / "room")
    jupytext.write(jupytext.read(ROOT / "notebooks" / "mocap_training.md"), tmp_path / "mine.ipynb")
    given = ["-p", "flight", "room", "-r", "test_flight", "None", "-p", "out", "results"]
    given[3:6] = ["-y", "test_flight: null"]
    command = [sys.executable, "-m", "papermill", "mine.ipynb", "done.ipynb", "-k", "python3"]
    settings = ["-p", "repeats", "1", "-p", "particles", "5", "-p", "neighbors", "2"]
    own = {"PYTHONPATH": python_path(ROOT), "TREXTON_CACHE": str(tmp_path / "cache")}
    before = {path: path.stat().st_mtime_ns for path in (ROOT / "results").rglob("*")}
    done = subprocess.run(
        [*command, *given, *settings],
        cwd=tmp_path,
        env=os.environ | own,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "results" / "small" / "mocap_training.json").is_file()
    assert before == {path: path.stat().st_mtime_ns for path in (ROOT / "results").rglob("*")}
    assert not Path(ROOT / "results" / "small").exists()


def test_images_of_a_test_flight_are_decoded_once_where_they_have_room(
    image_folder, tmp_path, monkeypatch
):
    trained = write_flight(small_flight(), tmp_path / "trained")
    read = []

    def counted(file):
        read.append(file)
        return read_image(file)

    monkeypatch.setattr("trexton.flights.frames.read_image", counted)
    whole = read_flight(image_folder)
    test = load_pair(trained, image_folder)[1]
    assert test.data_hash == whole.data_hash
    first, again = list(test.images()), list(test.images())
    again[0][:] = 0  # as a method may do with its own
    again = list(test.images())
    assert len(read) == len(test) and np.array_equal(first, again)
    assert np.array_equal(first, list(whole.images()))
    assert len(pickle.dumps(test)) < first[0].nbytes  # other processes decode their own
    assert np.array_equal(test.select(slice(2, None)).image(0), first[2])
    read.clear()
    monkeypatch.setattr("trexton.companion.build.flight_pairs._HELD_BYTES", 10)
    large = load_pair(trained, image_folder)[1]
    assert np.array_equal([*large.images(), *large.images()], first + first)
    assert len(read) == 2 * len(test)


def test_a_kernel_ends_without_freeing_all_that_was_imported():
    script = (
        "import atexit, gc\n"
        "atexit.register(lambda: print(gc.get_freeze_count() > 1000))\n"  # the first is the last
        "import trexton.companion.build.notebook"
    )
    command = [sys.executable, "-c", script]
    environment = os.environ | {"PYTHONPATH": python_path(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    assert done.stdout == "True\n"
