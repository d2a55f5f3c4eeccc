"""Files of positions that people bring: motion capture, logs of autopilots, subtitles."""

from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import small_flight
from scipy.spatial.transform import Rotation
from small_logs import ardupilot_log, dataflash, px4_log, subtitles
from small_recording import film
from test_import import picture

from trexton.base.errors import FlightError
from trexton.flights.importers import autopilot
from trexton.flights.importers.tracks import TrackColumns, read_track
from trexton.flights.importing import import_flight
from trexton.flights.plausibility import warnings

N = 10**9


def place(i: float) -> tuple[float, float]:
    """In a room whose origin is a corner."""
    return float(5 + 2 * np.cos(i / 8)), float(4 + 2 * np.sin(i / 8))


def test_stamps_of_positions_that_repeat_or_go_back(tmp_path):
    rows = [f"{i * 0.1:.1f} {i * 0.1} 0 1 1 0 0 0" for i in range(20)]
    text = [*rows[:5], rows[4], *rows[5:9], rows[10], rows[9], *rows[11:], "1.5 9 9 1 1 0 0 0"]
    (tmp_path / "g.txt").write_text("\n".join(text))
    track, said = read_track(tmp_path / "g.txt", TrackColumns())
    assert (np.diff(track.time_ns) > 0).all() and 15 * N // 10 not in track.time_ns
    np.testing.assert_allclose(track.position[:, 0], track.time_ns / N)
    assert "2 rows of positions out of order" in said[0]
    assert "1 row of positions with a repeated stamp dropped (first: row 6)" in said[1]
    assert "rows 17 and 22: one stamp, but places" in said[2]


def test_stamps_that_are_rounded_contradict_nothing(tmp_path):
    rows = [f"{i // 10 / 10:.1f} {i * 0.1:.1f} 0 1 1 0 0 0" for i in range(200)]
    (tmp_path / "g.txt").write_text("\n".join(rows))
    track, said = read_track(tmp_path / "g.txt", TrackColumns())
    np.testing.assert_allclose(track.position[:, 0], np.arange(20))
    assert "180 rows of positions with a repeated stamp dropped" in said[0]
    assert not any("contradict" in line or "left out" in line for line in said)


@pytest.mark.parametrize(("turn", "said"), [(0, ""), (65, "65 degrees"), (180, "180 degrees")])
def test_a_camera_that_does_not_look_down_is_named(tmp_path, turn, said):
    half = np.radians(turn) / 2
    turned = f"{np.cos(half)} 0 0 {np.sin(half)}"  # about its right, from straight down
    rows = [f"{i / 10} {i} 0 1 {turned}" for i in range(9)]
    (tmp_path / "g.txt").write_text("\n".join(rows))
    track, lines = read_track(tmp_path / "g.txt", TrackColumns(axes="camera"))
    assert any(said in line for line in lines[1:]) == bool(said)
    flight = replace(
        small_flight(9), position=track.position[:, :2], attitude=track.attitude,
        area=(-1, 9, -1, 1),
    )  # fmt: skip
    assert any("from straight down" in line for line in warnings(flight)) == bool(said)


MOTIVE = """Format Version,1.23,Take Name,T,Rotation Type,Quaternion,Length Units,{}

,,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body
,,drone,drone,drone,drone,drone,drone,drone,other
,,1,1,1,1,1,1,1,2
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X
"""
VICON = """Objects
100
,,Global Angle drone:drone,,,,,,
Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ
,,,,,,mm,mm,mm
"""
QUALISYS = (
    """NO_OF_FRAMES\t60
FREQUENCY\t100
DATA_INCLUDED\t6D
BODY_NAMES\tdrone
Frame\tTime\tdrone X\tdrone Y\tdrone Z\t"""
    + "\t".join(f"Rot[{i}]" for i in range(9))
    + "\n"
)


@pytest.mark.parametrize(
    ("name", "head", "row"),
    [
        ("a.csv", MOTIVE.format("Meters"), "{i},{t},0,0,0,1,{x},1,{b},7"),
        ("f.csv", MOTIVE.format("Feet"), "{i},{t},0,0,0,1,{xft},3.280839895,{bft},7"),
        ("b.csv", MOTIVE.format("Millimeters"), "{i},{t},0,0,0,1,{xmm},1000,{bmm},7"),
        ("c.csv", VICON, "{i},0,0,0,0,1,{xmm},{ymm},1000"),
        ("d.tsv", QUALISYS, "{i}\t{t}\t{xmm}\t{ymm}\t1000\t1\t0\t0\t0\t1\t0\t0\t0\t1"),
    ],
)
def test_exports_of_motion_capture(tmp_path, name, head, row):
    rows = []
    for i in range(60):
        x, y = place(i)
        numbers = {"x": x, "b": -y, "xmm": 1000 * x, "ymm": 1000 * y, "bmm": -1000 * y}
        numbers |= {"xft": x / 0.3048, "bft": -y / 0.3048}
        rows.append(row.format(i=i, t=i / 100, **numbers))
    (tmp_path / name).write_text(head + "\n".join(rows) + "\n")
    track, said = read_track(tmp_path / name, TrackColumns(body="drone"))
    np.testing.assert_allclose(track.position[:, :2], [place(i) for i in range(60)])
    np.testing.assert_allclose(track.position[:, 2], 1)
    np.testing.assert_array_equal(track.time_ns, np.arange(60) * N // 100)
    assert "body drone" in said[0] and "axes flu" in said[1]
    np.testing.assert_allclose(np.degrees(track.attitude), [[0, 0, -90]] * 60)
    with pytest.raises(FlightError, match="name one with --body"):
        read_track(tmp_path / name, TrackColumns(body="nobody"))


def test_columns_of_motion_capture_may_be_named(tmp_path):
    rows = [f"{i},{i / 100},0,0,0,1,{i},1,5,7" for i in range(9)]
    (tmp_path / "a.csv").write_text(MOTIVE.format("Meters") + "\n".join(rows) + "\n")
    columns = TrackColumns(time="Time (Seconds)", x="X", y="Z", body="drone")
    assert read_track(tmp_path / "a.csv", columns)[0].position[3, :2].tolist() == [3, 5]


def test_subtitles_beside_a_video_and_an_end_that_is_missing(tmp_path):
    path = film(tmp_path / "v.avi", map(picture, range(40)))
    data = path.read_bytes()
    path.write_bytes(data[: int(0.6 * len(data))])
    (tmp_path / "v.SRT").write_text(subtitles())
    flight, said = import_flight(path, tmp_path / "out")
    assert any("of 40 frames could be decoded: the file is cut short" in line for line in said)
    np.testing.assert_allclose(np.diff(flight.position[:10, 1]), 1.112, atol=0.01)
    assert flight.height[0] == 10 and flight.origin is not None


def test_frames_of_a_video_that_are_damaged_are_left_out(tmp_path):
    path = film(tmp_path / "f.avi", [picture(i, (160, 120)) for i in range(12)])
    data = path.read_bytes()
    begins = [found.start() for found in re.finditer(rb"\xff\xd8\xff", data)]
    middle = (begins[5] + begins[6]) // 2
    path.write_bytes(data[:middle] + bytes(400) + data[middle + 400 :])
    rows = [f"{i / 20},{place(i)[0]},{place(i)[1]}" for i in range(12)]
    (tmp_path / "t.csv").write_text("\n".join(["t,x,y", *rows]))
    settings = {"positions": "t.csv", "offset": "0"}
    flight, said = import_flight(path, tmp_path / "out", settings=settings)
    assert any("damaged frames, left out: 1 (first: number 6, at 0.25 s)" in line for line in said)
    np.testing.assert_allclose(flight.time, np.delete(np.arange(12), 5) / 20)
    np.testing.assert_allclose(flight.position, [place(i) for i in range(12) if i != 5], atol=1e-6)


@pytest.mark.parametrize("wrong", [0, 10])
def test_what_a_decoder_fills_is_named(tmp_path, wrong):
    """Each frame is told by those before: what is damaged goes on, and decoders make it up."""
    rng = np.random.default_rng(0)
    floor = cv2.GaussianBlur(rng.integers(0, 255, (400, 500, 3), np.uint8), (0, 0), 3)
    frames = [np.ascontiguousarray(floor[i : 240 + i, 2 * i : 320 + 2 * i]) for i in range(60)]
    data = bytearray(film(path := tmp_path / "v.mp4", frames, codec="mp4v").read_bytes())
    for at in rng.integers(data.find(b"mdat") + 8, int(0.9 * len(data)), wrong):
        data[at] ^= 0xFF
    path.write_bytes(data)
    (tmp_path / "t.csv").write_text("\n".join(["t,x,y", *(f"{i / 20},{i},0" for i in range(60))]))
    settings = {"positions": "t.csv", "offset": "0"}
    flight, said = import_flight(path, tmp_path / "out", settings=settings)
    told = [line for line in said if re.search(r"its decoder tells of \d+ errors", line)]
    assert len(flight) == 60 and len(told) == bool(wrong)


def test_a_log_of_ardupilot(tmp_path):
    (tmp_path / "1.bin").write_bytes(ardupilot_log())
    track, _ = read_track(tmp_path / "1.bin", TrackColumns())
    np.testing.assert_allclose(np.diff(track.time_ns), N // 10, atol=1000)
    np.testing.assert_allclose(np.diff(track.position[:, 1]), 1.112, atol=0.01)
    np.testing.assert_allclose(np.degrees(track.attitude[5]), [1, 0, -90], atol=1e-4)
    np.testing.assert_allclose(track.position[:, 2], 10)
    endless = dataflash((1, b"POS", b"", b"", 0)) + b"\xa3\x95\x01" * 20
    for text in (b"no log", endless):
        (tmp_path / "2.bin").write_bytes(text)
        with pytest.raises(FlightError, match=r"2\.bin"):
            read_track(tmp_path / "2.bin", TrackColumns())


def test_a_bug_of_ours_is_no_damaged_log(tmp_path, monkeypatch):
    def odd(*_):
        raise ZeroDivisionError("a bug")

    (tmp_path / "1.bin").write_bytes(ardupilot_log())
    monkeypatch.setattr(autopilot, "_earthly", odd)
    with pytest.raises(ZeroDivisionError):
        read_track(tmp_path / "1.bin", TrackColumns())


def test_a_log_of_px4(tmp_path):
    pytest.importorskip("pyulog")
    (tmp_path / "a.ulg").write_bytes(px4_log())
    track, _ = read_track(tmp_path / "a.ulg", TrackColumns())
    np.testing.assert_allclose(track.position, [[2, i, 10] for i in range(1, 20)])
    np.testing.assert_allclose(track.attitude, [[np.nan, np.nan, -np.pi / 2]] * 19, atol=1e-6)
    assert track.origin == (47.0, 8.0) and track.time_ns[0] == N // 10
    x, y, z, w = Rotation.from_euler("ZYX", (90, 5, -3), degrees=True).as_quat()
    (tmp_path / "a.ulg").write_bytes(px4_log(turn=(w, x, y, z)))
    track, _ = read_track(tmp_path / "a.ulg", TrackColumns())
    np.testing.assert_allclose(np.degrees(track.attitude), [[-3, 5, -90]] * 19, atol=1e-4)


def test_quaternions_are_ordered_by_their_names(tmp_path):
    half = np.radians(30) / 2  # a camera that looks down, turned by 30 degrees
    x, y = np.cos(half), np.sin(half)
    rows = [f"{i / 10},{i},0,0,{x},{y},0" for i in range(9)]
    (tmp_path / "t.csv").write_text("t,x,y,qw,qx,qy,qz\n" + "\n".join(rows))
    for named in ("qw,qx,qy,qz", "qx,qy,qz,qw"):
        track, said = read_track(tmp_path / "t.csv", TrackColumns(quaternion=named))
        np.testing.assert_allclose(np.degrees(track.attitude), [[0, 0, 30]] * 9, atol=1e-9)
        assert len(said) == 1


def test_vicon_s_tables_behind_those_of_devices(tmp_path):
    devices = "Devices\n1000\n,,Plate - Force,,\nFrame,Sub Frame,Fx,Fy,Fz\n,,N,N,N\n1,0,0,0,0\n\n"
    outputs = "Model Outputs\n100\n,,drone:COM,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,9,9,9\n\n"
    head = "Segments\n100\n,,drone:drone,,\nFrame,Sub Frame,TX,TY,TZ\n,,mm,mm,mm\n"
    rows = [f"{i + 1},0,{10 * i},2000,1000" for i in range(30)]
    (tmp_path / "v.csv").write_text(devices + outputs + head + "\n".join(rows))
    track, said = read_track(tmp_path / "v.csv", TrackColumns())
    np.testing.assert_allclose(track.position, [[i / 100, 2, 1] for i in range(30)])
    np.testing.assert_array_equal(track.time_ns, np.arange(30) * N // 100)
    assert "body drone, 100 frames a second" in said[0]


def test_subtitles_by_the_second_and_misspelt(tmp_path):
    film(tmp_path / "v.avi", map(picture, range(80)))
    (tmp_path / "v.srt").write_text("\n".join(
        f"{i}\n00:00:0{i},000 --> 00:00:0{i + 1},000\n"
        f"[latitude : {47 + i * 1e-5:.6f}] [longtitude : 8.0] BAROMETER:12.5\n" for i in range(5)
    ))  # fmt: skip
    flight, said = import_flight(tmp_path / "v.avi", tmp_path / "out")
    assert flight.height[0] == 12.5 and flight.located.sum() < 10
    assert any("positions come 1 s apart: give --tolerance 0.5" in line for line in said)
    settings = {"tolerance": "0.5"}
    flight, said = import_flight(tmp_path / "v.avi", tmp_path / "all", settings=settings)
    assert flight.located.mean() > 0.9
    np.testing.assert_allclose(flight.position[:, 1], 1.112 * flight.time, atol=0.02)
    assert not any("give --tolerance" in line for line in said)


def test_a_trajectory_among_its_pictures_is_no_folder_of_photographs(tmp_path):
    half = np.radians(30) / 2  # a camera that looks down, turned by 30 degrees
    for i in range(9):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture(i))
    (tmp_path / "rgb.txt").write_text("".join(f"{i / 10} {i}.png\n" for i in range(9)))
    turned = f"0 {np.cos(half)} {np.sin(half)} 0"
    (tmp_path / "groundtruth.txt").write_text(
        "".join(f"{i / 50} {i} 0 1 {turned}\n" for i in range(50))
    )
    settings = {"quaternion": "qw,qx,qy,qz"}
    flight, _ = import_flight(tmp_path, tmp_path / "out", settings=settings)
    np.testing.assert_allclose(flight.position[:, 0], 5 * np.arange(9.0))
    np.testing.assert_allclose(np.degrees(flight.attitude), [[0, 0, 30]] * 9, atol=1e-9)


def test_padding_behind_a_log_is_passed_over_in_silence(tmp_path, capsys):
    (tmp_path / "1.bin").write_bytes(ardupilot_log() + bytes(3000))
    track, _ = read_track(tmp_path / "1.bin", TrackColumns())
    assert len(track.time_ns) == 20 and not capsys.readouterr().out


def test_subtitles_of_autel(tmp_path):
    (tmp_path / "v.srt").write_text("\n".join(
        f"{i}\n00:00:0{i},000 --> 00:00:0{i + 1},000\nHOME(W: 7.0, S: 40.0) 2021-01-01 10:00:00\n"
        f"GPS(W: 8.000000, S: {47 + i * 1e-5:.6f}, 46.00m)\n" for i in range(5)
    ))  # fmt: skip
    track, _ = read_track(tmp_path / "v.srt", TrackColumns())
    np.testing.assert_allclose(track.origin, (-47.00004, -8.0))
    np.testing.assert_allclose(np.diff(track.position[:, 1]), -1.112, atol=0.01)


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_stamps_of_two_units_are_refused_with_their_row(tmp_path, factor):
    for chosen in (range(20, 40), range(7, 40, 7), range(0, 40, 2)):
        stamps = [f"{i * 0.08 * (factor if i in chosen else 1):.3f}" for i in range(40)]
        rows = [f"{stamp},{place(i)[0]},{place(i)[1]}" for i, stamp in enumerate(stamps)]
        (tmp_path / "t.csv").write_text("t,x,y\n" + "\n".join(rows))
        with pytest.raises(FlightError, match=r"t\.csv, row \d+: .*all in one unit"):
            read_track(tmp_path / "t.csv", TrackColumns())
    seconds = [f"{1_700_000_000 * (1000 if i > 5 else 1) + i},{i},0" for i in range(9)]
    (tmp_path / "t.csv").write_text("t,x,y\n" + "\n".join(seconds))
    with pytest.raises(FlightError, match="row 8: .*all stamps in the unit of the first"):
        read_track(tmp_path / "t.csv", TrackColumns())


def test_segments_of_one_name_are_bodies_of_their_own(tmp_path):
    head = "Segments\n100\n,,drone:root,,,pad:root,,\nFrame,Sub Frame,TX,TY,TZ,TX,TY,TZ\n"
    rows = [f"{i + 1},0,{10 * i},2000,1000,9000,9000,0" for i in range(30)]
    text = head + ",,mm,mm,mm,mm,mm,mm\n" + "\n".join(rows)
    for separator in ",\t;":
        (tmp_path / "v.csv").write_text(text.replace(",", separator))
        track, _ = read_track(tmp_path / "v.csv", TrackColumns(body="root"))
        np.testing.assert_allclose(track.position, [[i / 100, 2, 1] for i in range(30)])
        track, _ = read_track(tmp_path / "v.csv", TrackColumns(body="pad:root"))
        np.testing.assert_allclose(track.position, [[9, 9, 0]] * 30)


def test_exports_with_decimal_commas(tmp_path):
    rows = [f"{i}\t{i / 100}\t{1.5 * i}\t2000.5\t1000" for i in range(30)]
    head = "NO_OF_FRAMES\t30\nMARKER_NAMES\tdrone\nFrame\tTime\tdrone X\tdrone Y\tdrone Z\n"
    (tmp_path / "q.tsv").write_text(head + "\n".join(rows).replace(".", ","))
    track, _ = read_track(tmp_path / "q.tsv", TrackColumns())
    np.testing.assert_allclose(track.position, [[0.0015 * i, 2.0005, 1] for i in range(30)])
    np.testing.assert_array_equal(track.time_ns, np.arange(30) * N // 100)


@pytest.mark.parametrize("gap", ["\n\n", "\n"])
@pytest.mark.parametrize(
    "words", ["[latitude: {a:.6f}] [longitude: -8.5] [rel_alt: 12.500 abs_alt: 200.300]",
              "F/2.8, SS 206.14, GPS (-8.5000, {a:.5f}, 15), D 22.03m, H 12.50m, H.S 1.00m/s"],
)  # fmt: skip
@pytest.mark.parametrize("comma", [False, True])
def test_subtitles_of_other_countries_and_without_blank_lines(tmp_path, words, comma, gap):
    texts = [words.format(a=47 + i * 1e-5) for i in range(9)]
    texts = [re.sub(r"(\d)\.(\d)", r"\1,\2", text) if comma else text for text in texts]
    (tmp_path / "v.srt").write_text(gap.join(
        f"{i + 1}\n00:00:0{i},500 --> 00:00:0{i + 1},000\n{text}" for i, text in enumerate(texts)
    ))  # fmt: skip
    track, _ = read_track(tmp_path / "v.srt", TrackColumns())
    np.testing.assert_allclose(track.origin, (47, -8.5))
    np.testing.assert_allclose(np.diff(track.position[:, 1]), [1.112] * 8, atol=0.01)
    np.testing.assert_allclose(track.position[:, 2], 12.5)
    np.testing.assert_array_equal(track.time_ns, [i * N + N // 2 for i in range(9)])


def test_a_trajectory_is_read_with_the_units_and_order_that_are_given(tmp_path):
    half = np.radians(30) / 2  # a camera that looks down, turned by 30 degrees
    turn = f"0 {np.cos(half)} {np.sin(half)} 0"  # w, x, y, z
    rows = [f"{(17 * 10**8 + i) * N} {1000 * i} 0 1500 {turn}" for i in range(9)]
    (tmp_path / "g.txt").write_text("\n".join(rows))
    columns = TrackColumns(time_unit="ns", unit="mm", quaternion="qw,qx,qy,qz")
    track, _ = read_track(tmp_path / "g.txt", columns)
    np.testing.assert_allclose(track.position, [[i, 0, 1.5] for i in range(9)])
    np.testing.assert_allclose(np.degrees(track.attitude), [[0, 0, 30]] * 9, atol=1e-9)
    assert np.diff(track.time_ns).tolist() == [N] * 8
    (tmp_path / "t.csv").write_text("t,x,y,qw,qz,qy,qx\n" + "\n".join(
        f"{i},{i},0,0,0,{np.sin(half)},{np.cos(half)}" for i in range(9)
    ))  # fmt: skip
    track, _ = read_track(tmp_path / "t.csv", TrackColumns(quaternion="qw,qz,qy,qx"))
    np.testing.assert_allclose(np.degrees(track.attitude), [[0, 0, 30]] * 9, atol=1e-9)
    with pytest.raises(FlightError, match="3 columns: expected four"):
        read_track(tmp_path / "t.csv", TrackColumns(quaternion="qx,qy,qz"))


@pytest.mark.parametrize(
    ("factor", "said"), [(1, "radians? leave --degrees out"), (180 / np.pi, "")]
)
def test_a_yaw_in_radians_is_none_in_degrees(tmp_path, factor, said):
    yaw = factor * np.angle(np.exp(0.2j * np.arange(60)))
    rows = [f"{i / 10},{i},0,{each}" for i, each in enumerate(yaw)]
    (tmp_path / "t.csv").write_text("t,x,y,yaw\n" + "\n".join(rows))
    _, lines = read_track(tmp_path / "t.csv", TrackColumns(yaw="yaw", degrees=True))
    assert [said in line for line in lines] == ([True] if said else [])


@pytest.mark.parametrize(
    ("ending", "factor"),
    [
        ("_ft", 1 / 0.3048), (" (feet)", 1 / 0.3048), (" [mm]", 1e3), ("_cm", 100), ("_m", 1),
        (" [in]", 1 / 0.0254), ("_in", 1),
    ],
)  # fmt: skip
def test_columns_whose_names_end_with_a_unit_are_taken_in_it(tmp_path, ending, factor):
    """Unless a unit is given; a yaw whose name says degrees is in degrees."""
    x, y, z = (name + ending for name in "xyz")
    rows = [f"{i / 10},{i * factor},{factor},{2 * factor},{i}" for i in range(9)]
    (tmp_path / "t.csv").write_text(f"t,{x},{y},{z},yaw_deg\n" + "\n".join(rows))
    columns = TrackColumns(x=x, y=y, z=z, yaw="yaw_deg")
    track, said = read_track(tmp_path / "t.csv", columns)
    np.testing.assert_allclose(track.position, [[i, 1, 2] for i in range(9)])
    np.testing.assert_allclose(np.degrees(track.attitude[:, 2]), np.arange(9))
    assert len(said) == 3 * (factor != 1) and all("as its name says" in line for line in said)
    track, said = read_track(tmp_path / "t.csv", replace(columns, unit="mm"))
    np.testing.assert_allclose(track.position[:, 1], factor / 1000)
    assert not said


@pytest.mark.parametrize(("ending", "factor"), [("_ms", 1e3), (" [us]", 1e6), ("_d", 1)])
def test_stamps_whose_column_names_a_unit_are_taken_in_it(tmp_path, ending, factor):
    rows = [f"{round(i * factor)},{i},0" for i in range(9)]
    (tmp_path / "t.csv").write_text(f"time{ending},x,y\n" + "\n".join(rows))
    track, said = read_track(tmp_path / "t.csv", TrackColumns(f"time{ending}"))
    np.testing.assert_array_equal(track.time_ns, np.arange(9) * 10**9)
    assert ["as its name says" in line for line in said] == [True] * (factor != 1)


@pytest.mark.parametrize(("height", "metres"), [("100.00ft", 30.48), ("30.50m", 30.5)])
def test_heights_of_subtitles_may_be_in_feet(tmp_path, height, metres):
    (tmp_path / "v.srt").write_text("\n\n".join(
        f"{i}\n00:00:0{i},000 --> 00:00:0{i + 1},000\n"
        f"F/2.8, GPS (8.0, {47 + i * 1e-5:.6f}, 15), D 20.1m, H {height}, H.S 2.00m/s"
        for i in range(5)
    ))  # fmt: skip
    track, _ = read_track(tmp_path / "v.srt", TrackColumns())
    np.testing.assert_allclose(track.position[:, 2], metres)
