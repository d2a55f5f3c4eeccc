"""Logs of signals: bins of time, values that hold for a while, sources that are not heard."""

import numpy as np
import pytest

from trexton.base.errors import FlightError
from trexton.companion.public_flights import read_ble
from trexton.flights.importers.signals import Settings, read
from trexton.flights.importing import import_flight

LOG = """stamp,source,value,x,y
100.0,a,-60,1.0,2.0
100.2,a,-62,1.2,2.0
100.3,b,-80,1.1,2.0
100.6,a,-64,1.5,2.0
101.1,a,-66,2.0,2.0
102.1,a,-70,3.0,2.0
"""


def test_a_frame_is_a_bin_and_a_value_holds_for_a_while(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(LOG)
    recording = read(log, Settings(bin=0.5, keep=1.0, floor=-90.0))
    np.testing.assert_allclose(recording.time_ns / 1e9, [100.0, 100.5, 101.0, 102.0])
    expected = [[-61, -80], [-64, -80], [-66, -80], [-70, -90]]
    np.testing.assert_allclose(recording.histograms, expected)
    np.testing.assert_allclose(recording.track.position[:, 0], [1.1, 1.5, 2.0, 3.0])


def test_positions_of_some_rows_place_the_whole_bin(tmp_path):
    """Only bins without any had none; before, one row without took its bin's away."""
    log = tmp_path / "log.csv"
    text = LOG.replace("100.6,a,-64,1.5,2.0", "100.6,a,-64,1.5,2.0\n100.7,b,-71,,")
    log.write_text(text.replace("102.1,a,-70,3.0,2.0", "102.1,a,-70,,"))
    recording = read(log, Settings(bin=0.5, keep=1.0))
    np.testing.assert_allclose(recording.track.position[:, 0], [1.1, 1.5, 2.0, np.nan])


def test_an_import_is_recognised_and_becomes_a_flight(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(LOG)
    flight, _ = import_flight(log, tmp_path / "flight")
    assert flight.features == "signals" and flight.histograms.shape == (4, 2)


@pytest.mark.parametrize(
    "text, said",
    [
        ("time,source,value\n1,a,2\n", "no column 'stamp'"),
        ("stamp,source,value\n1,a,loud\n", "loud"),
        ("stamp,source,value\n1,a\n", "row 2: 2 fields where 3"),
        ("stamp,source,value\n", "no rows"),
        ("stamp,source,value\n1,a,nan\n", "no row has a value"),
        ("stamp,source,value\n1700000000000,a,2\n", "a stamp in s: give both, or another"),
    ],
)
def test_what_is_no_log_is_named(tmp_path, text, said):
    log = tmp_path / "log.csv"
    log.write_text(text)
    with pytest.raises(FlightError, match=said):
        read(log, Settings())


def test_the_public_walks_become_one_flight_with_splits(tmp_path):
    files = [tmp_path / f"{name}.mbd" for name in ("straight", "rectangular")]
    for number, file in enumerate(files):
        rows = [
            f"{9 - number}{row}.0,r{row % 2},beacon,-{60 + row},{row},1,2"
            + ",0" * 9  # sixteen fields, as published
            for row in range(4)
        ]
        file.write_text("\n".join(rows))
    flight = read_ble(*files)
    assert flight.split == {"train": (0, 3), "test": (4, 7)}
    assert flight.histograms.shape == (8, 2)
    assert np.diff(flight.time)[3] == 60


def test_a_stamp_of_another_year_takes_no_memory(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(LOG + "1.7e9,b,-50,3.0,2.0\n")
    recording = read(log, Settings())
    assert recording.histograms.shape == (5, 2)
    np.testing.assert_allclose(recording.histograms[-1], [-100, -50])


def test_stamps_in_milliseconds_are_no_seconds(tmp_path):
    """A reading would be a frame, of one source; scans that are far apart are none such."""
    log = tmp_path / "log.csv"
    rows = [f"{40 * n},{'abc'[n % 3]},{-60 - n % 7},{n / 9},1" for n in range(90)]
    log.write_text("\n".join(["stamp,source,value,x,y", *rows]))
    with pytest.raises(FlightError, match="readings come 40 s apart.*--time-unit"):
        read(log, Settings())
    recording = read(log, Settings(time_unit="ms"))
    assert len(recording.time_ns) == 8 and np.diff(recording.time_ns).max() == 5e8
    scans = [f"{10 * n},{source},-60,{n},1" for n in range(9) for source in "abc"]
    log.write_text("\n".join(["stamp,source,value,x,y", *scans]))
    assert len(read(log, Settings()).time_ns) == 9


def test_what_is_left_out_or_never_heard_is_said(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(LOG + "103,b,,1,2\n")
    recording = read(log, Settings(names=" b , c", bin=0.5))
    assert recording.names == ("b", "c") and (recording.histograms[0] == [-80, -100]).all()
    said = "; ".join(recording.said)
    for words in ("left out: 1", "--names leaves out: a", "never heard, always -100: c"):
        assert words in said
    assert "louder than -80: give a lower --floor" in "; ".join(read(log, Settings(floor=-70)).said)
    with pytest.raises(FlightError, match="6 readings in one frame: give --time-unit or --bin"):
        read(log, Settings(time_unit="ns"))
    with pytest.raises(FlightError, match="no row has a value of a source"):
        read(log, Settings(names="nobody"))


def test_a_clock_that_begins_again_is_no_one_recording(tmp_path):
    """Of two laps in one file each frame was the mean of two places, and check found no fault."""
    lap = [f"{time / 10},{source},{time % 7},{{x}},1" for time in range(100) for source in "ab"]
    laps = ["\n".join(lap).format(x=x) for x in (0, 30)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["stamp,source,value,x,y", *laps]))
    with pytest.raises(FlightError, match="the clock is set back by 9.9 s: import each"):
        read(log, Settings())
    by_source = sorted(lap, key=lambda row: row.split(",")[1])  # as some tools write them
    log.write_text("\n".join(["stamp,source,value,x,y", *by_source]).format(x=0))
    assert len(read(log, Settings()).time_ns) == 20
