"""Nothing of a person's is lost, and no input reads, waits or eats more than it may."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest
from conftest import small_flight

from trexton.base.errors import ImageError, TrextonError
from trexton.base.files import (
    atomic_file,
    atomic_folder,
    check_replaceable,
    clean_leftovers,
    read_text,
)
from trexton.base.pictures import declared_size, decode
from trexton.cli.main import main, sentence
from trexton.flights.flight import Flight
from trexton.flights.folder import load_folder
from trexton.flights.frames import ImageFiles
from trexton.flights.tables import read_table
from trexton.flights.writing import write_flight
from trexton.simulator.floor import Floor
from trexton.vision.images import read_image


def flight_with_images(folder):
    files = []
    for i in range(4):
        files.append(folder / f"{i}.png")
        cv2.imwrite(str(files[-1]), np.full((48, 64, 3), 40 * i, np.uint8))
    return write_flight(
        Flight(
            "f",
            np.arange(4),
            np.arange(4) * 0.1,
            np.eye(4)[:, :2],
            (0, 1, 0, 1),
            frames=ImageFiles(tuple(files)),
        ),
        folder / "flight",
    )


def test_a_file_a_foreign_folder_a_link_and_where_one_stands_are_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "thesis.txt").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    monkeypatch.chdir(tmp_path)
    for name in ("file", "folder", "link", ".", ".."):
        with pytest.raises(TrextonError), atomic_folder(tmp_path / name):
            pytest.fail("the block must not begin")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder", "link"]
    check_replaceable(tmp_path / "new", False)


def test_a_flight_that_is_there_is_replaced_only_when_asked(tmp_path):
    folder = write_flight(small_flight(), tmp_path / "f")
    (folder / "thesis.txt").write_text("mine")
    with pytest.raises(TrextonError, match="is there already: .*--replace"):
        write_flight(small_flight(50), folder)
    assert (folder / "thesis.txt").exists()
    assert write_flight(small_flight(50), folder, replace=True) == folder
    assert not (folder / "thesis.txt").exists()


@pytest.mark.parametrize("words", [["simulate", "--frames", "2"], ["data", "fetch", "cyberzoo"]])
def test_commands_replace_a_persons_folder_only_when_told_to(words, tmp_path, capsys, shared_data):
    out = tmp_path / "mine"
    out.mkdir()
    (out / "thesis.txt").write_text("all of it")
    assert main([*words, "--out", str(out)]) == 1
    assert "--replace" in capsys.readouterr().err and (out / "thesis.txt").exists()
    assert main([*words, "--out", str(out), "--replace"]) == 0
    assert (out / "flight.toml").exists() and not (out / "thesis.txt").exists()


WRITING = (
    "simulate --frames 4 --floor FLIGHT/0.bmp --out",
    "data fetch cyberzoo --out",
    "train FLIGHT --set measurement.neighbors=2 -o",
    "export FLIGHT tum --out",
    "import csv FLIGHT/t.csv --out",
)


def test_a_full_disk_is_one_sentence_and_the_old_stays(tmp_path, shared_data):
    """One command after the other in one process, on which no file may grow beyond 4 kB."""
    flight = write_flight(small_flight(200), tmp_path / "flight")
    rows = "".join(f"{i},{i},0,{i}.bmp\n" for i in range(3))
    (flight / "t.csv").write_text("t,x,y,image\n" + rows)
    for i in range(3):
        noise = np.random.default_rng(i).integers(0, 256, (90, 90, 3), np.uint8)
        (flight / f"{i}.bmp").write_bytes(cv2.imencode(".bmp", noise)[1].tobytes())
    before = sorted(path.name for path in tmp_path.iterdir())
    code = (
        "import os, resource, sys\nsys.dont_write_bytecode = True\n"  # cut, it would stay
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))\n"
        "from trexton.cli.main import main\n"
        "for words in sys.argv[2:]:\n"
        "    print(main(words.split()), *sorted(os.listdir(sys.argv[1])))\n"
        "    print('END', file=sys.stderr)"
    )
    commands = [f"{words} {tmp_path}/out".replace("FLIGHT", str(flight)) for words in WRITING]
    command = [sys.executable, "-c", code, str(tmp_path), *commands]
    # Not measured: what coverage writes at the end would be too large as well.
    unmeasured = {name: text for name, text in os.environ.items() if "COVERAGE" not in name}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=unmeasured)
    assert done.returncode == 0, done.stderr
    *said, end = done.stderr.split("END\n")
    assert not end
    for words, text, after in zip(WRITING, said, done.stdout.splitlines(), strict=True):
        status, *left = after.split()
        assert status == "1" and [name for name in left if name != ".out.importing"] == before
        last = text.splitlines()[-1]
        assert last.startswith(f"trexton {words.split()[0]}: {tmp_path / 'out'}: "), done.stderr
    assert "Traceback" not in done.stderr and "please report" not in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        "export room tum --out room/frames.csv",
        "train room -o room/flight.toml",
    ],
)
def test_no_command_writes_over_what_it_reads(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_flight(small_flight(), tmp_path / "room")
    assert main("train room -o map.npz -q".split()) == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert main([*words.split(), "-q"]) == 1
    assert "is read here" in capsys.readouterr().err
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("train room -o taken", "taken: is a folder"),
        ("suitability floor.png --width 1 --out file/maps", "file is no folder"),
        ("train room -o round", "round: its links lead round in a circle: give another name"),
        ("train room -o round/map.npz", "map.npz: its links lead round"),
        ("suitability floor.png --width 1 --out round", "round/floor.json: its links lead round"),
        (
            "suitability floor.png --width 1 --out round/maps",
            "maps/floor.json: its links lead round",
        ),
    ],
)
def test_what_cannot_be_written_is_said_before_the_work(words, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "round").symlink_to("again")
    (tmp_path / "again").symlink_to("round")
    cv2.imwrite("floor.png", np.eye(60, dtype=np.uint8) * 255)
    assert main([*words.split(), "-q"]) == 1
    said = capsys.readouterr()
    assert told in said.err and not said.out
    left = ["again", "file", "floor.png", "round", "taken"]
    assert sorted(path.name for path in tmp_path.rglob("*")) == left


def test_what_a_killed_run_left_goes_with_the_next(tmp_path):
    code = (
        "import os, sys; from pathlib import Path\n"
        "from trexton.base.files import atomic_file, atomic_folder\n"
        "with atomic_folder(Path(sys.argv[1]) / 'flight') as f, atomic_file(Path(sys.argv[1]) / "
        "'r') as s:\n"
        "    (f / 'm').write_text('half'); s.write('half'); s.flush(); os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert len(list(tmp_path.iterdir())) == 2
    with atomic_folder(tmp_path / "flight") as folder, atomic_file(tmp_path / "r") as stream:
        (folder / "m").write_text("whole")
        stream.write("whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight", "r"]


def test_a_folder_moved_aside_by_a_killed_run_comes_back(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    aside = tmp_path / f".flight.old-{dead.pid}.abc"
    (aside / "was").mkdir(parents=True)
    (aside / "was" / "m").write_text("good")
    mine = tmp_path / f".flight.new-{os.getpid()}.abc"
    mine.mkdir()
    clean_leftovers(tmp_path / "flight")
    assert (tmp_path / "flight" / "m").read_text() == "good" and mine.exists()


def test_so_does_one_that_an_import_had_moved_aside(tmp_path, capsys):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    aside = tmp_path / f".flight.old-{dead.pid}.abc"
    (aside / "was").mkdir(parents=True)
    (aside / "was" / "m").write_text("good")
    words = ["import", "csv", str(tmp_path / "t.csv"), "--out", str(tmp_path / "flight")]
    assert main(words) == 1 and "--replace" in capsys.readouterr().err
    assert (tmp_path / "flight" / "m").read_text() == "good" and not aside.exists()


@pytest.mark.parametrize("name", ["/etc/hostname", "../../outside.png", "link.png"])
def test_images_cannot_leave_the_flights_folder(tmp_path, name):
    flight = flight_with_images(tmp_path)
    (tmp_path / "outside.png").write_bytes((tmp_path / "0.png").read_bytes())
    (flight / "images" / "link.png").symlink_to(tmp_path / "outside.png")
    table = flight / "frames.csv"
    table.write_text(table.read_text().replace("1.png", name))
    assert any("leads out of" in fault for fault in load_folder(flight).faults)


def test_the_floor_picture_cannot_leave_it_either(tmp_path):
    flight = flight_with_images(tmp_path)
    with open(flight / "flight.toml", "a") as stream:
        stream.write(
            '\n[floor]\nimage = "../0.png"\nworld_from_pixel = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n'
        )
    assert any("leads out of" in fault for fault in load_folder(flight).faults)


def test_pipes_and_devices_are_refused_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(TrextonError, match="not a regular file"):
            read_text(path)
        with pytest.raises(ImageError, match="not a regular file"):
            read_image(path)


def png_of(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
        )

    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    rows = zlib.compress(bytes(1000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_declared_sizes_are_checked_before_decoding(tmp_path):
    (tmp_path / "bomb.png").write_bytes(png_of(30_000, 30_000))
    with pytest.raises(ImageError, match="declares 30000x30000"):
        read_image(tmp_path / "bomb.png")
    with pytest.raises(ImageError, match="declares 30000x30000"):
        Floor.from_file(tmp_path / "bomb.png", 5.0)
    assert decode((tmp_path / "bomb.png").read_bytes()) is None


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp"])
def test_sizes_are_read_from_the_head(tmp_path, suffix):
    data = cv2.imencode(suffix, np.zeros((40, 70, 3), np.uint8))[1].tobytes()
    assert declared_size(data) == (70, 40)
    (tmp_path / f"i{suffix}").write_bytes(data)
    assert read_image(tmp_path / f"i{suffix}").shape == (40, 70, 3)


@pytest.mark.parametrize(
    "data", [b"", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"text", b"\xff\xd8" + b"\xff" * 50]
)
def test_heads_that_end_too_soon_declare_nothing_large(data):
    assert (declared_size(data) or (0, 0)) < (1, 1)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(28, "No space left on device", "/out/file"), "/out/file: No space left on device"),
        (MemoryError(), "use fewer frames"),
        (ImportError("cv2.abi3.so: failed to map segment from shared object"), "use fewer frames"),
        (RecursionError(), "nested too deeply"),
        (TrextonError("as it is"), "as it is"),
    ],
)
def test_every_error_is_one_sentence(error, words):
    text = sentence(error)
    assert words in text and "\n" not in text


def test_a_bug_keeps_its_traceback(flight_folder, monkeypatch, capsys):
    monkeypatch.setattr("trexton.cli.check.check_flight", lambda folder: {}["odd"])
    assert main(["check", str(flight_folder)]) == 1
    said = capsys.readouterr().err
    assert (
        "Traceback" in said and "KeyError: 'odd'" in said and "trexton check: this is a bug" in said
    )


def test_errors_of_opencv_are_sentences():
    with pytest.raises(cv2.error) as caught:
        cv2.resize(np.zeros((0, 0), np.uint8), (3, 3))
    assert "OpenCV refused" in sentence(caught.value)


def test_a_read_only_folder_is_one_sentence(tmp_path, capsys, monkeypatch):
    def full(*_, **__):
        raise OSError(30, "Read-only file system", str(tmp_path / "x"))

    monkeypatch.setattr("trexton.base.files.tempfile.mkdtemp", full)
    assert main(["simulate", "--out", str(tmp_path / "x"), "--frames", "3", "--quiet"]) == 1
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    "text",
    [
        "a,b\n1,2\n",
        "# a, b\n1, 2\n",
        "a;b\r\n1,0;2,0\r\n\r\n",
        "a\tb\n1\t2\n",
        "a b\n1 2\n",
        "\ufeffa,b\n1,2\n",
    ],
)
def test_tables_are_read_as_people_write_them(tmp_path, text):
    (tmp_path / "t.csv").write_bytes(text.encode())
    table = read_table(tmp_path / "t.csv")
    assert table.header == ["a", "b"]
    assert [table.numbers(name).tolist() for name in "ab"] == [[1], [2]]


def test_a_device_or_a_pipe_is_never_replaced_by_a_file(tmp_path, capsys):
    flight = write_flight(small_flight(), tmp_path / "room")
    os.mkfifo(tmp_path / "pipe")
    for words in (["train", flight, "-o"], ["export", flight, "tum", "--out"]):
        assert main([*map(str, words), str(tmp_path / "pipe"), "-q"]) == 1
        assert "pipe: is a folder, a device or a pipe" in capsys.readouterr().err
    with pytest.raises(TrextonError, match="a device"), atomic_file("/dev/null") as stream:
        stream.write("lost")
    assert stat.S_ISFIFO(os.stat(tmp_path / "pipe").st_mode)
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_nothing_is_sent_anywhere(tmp_path):
    """Neither a look for a newer version nor a count of uses."""
    write_flight(small_flight(), tmp_path / "room")
    code = (
        "import sys\n"
        "def hook(event, arguments):\n"
        "    if event.startswith('socket.') and event != 'socket.__new__':\n"
        "        raise SystemExit(f'{event} {arguments}')\n"
        "sys.addaudithook(hook)\n"
        "from trexton.cli.main import main\n"
        "for words in ('check room', 'train room -o map.npz', 'export room tum --out t.tum',\n"
        "              'onboard map.npz --camera room --output csv:fixes.csv'):\n"
        "    assert main(words.split()) == 0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
