"""Records: bytes, pictures, damage; and the cache that keys on everything that went in."""

import hashlib
import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

from trexton.base.cache import cached, code_hashes
from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file, atomic_folder, digest
from trexton.base.records import Record, plain


def make_record(**changes):
    values = {
        "a": np.float64(1.5),
        "b": np.array([1.0, np.nan]),
        "c": np.int64(3),
        "d": {"e": True, "f": None},
    }
    content = dict(
        experiment="e",
        flight="f",
        parameters={"seed": 1},
        values=values,
        images={"p": np.zeros((2, 3, 3), np.uint8)},
    )
    return Record(**content | changes)


def test_a_record_reads_back(tmp_path):
    record = make_record()
    loaded = Record.load(record.save(tmp_path))
    assert loaded.values == {"a": 1.5, "b": [1.0, None], "c": 3, "d": {"e": True, "f": None}}
    np.testing.assert_array_equal(loaded.images["p"], record.images["p"])
    assert loaded.parameters == {"seed": 1}


def test_equal_records_give_equal_bytes(tmp_path):
    paths = [
        make_record(values=values).save(tmp_path / name)
        for name, values in (("1", {"x": 1, "y": 2}), ("2", {"y": 2, "x": 1}))
    ]
    assert paths[0].read_bytes() == paths[1].read_bytes()


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema": 1}', '{"schema": 99, "images": {}}'])
def test_damaged_and_newer_records_are_one_clear_error(tmp_path, text):
    (tmp_path / "e.json").write_text(text)
    with pytest.raises(TrextonError, match="again|update"):
        Record.load(tmp_path / "e.json")


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"experiment": ["e"]}, "its experiment is a list"),
        ({"flight": None}, "its flight is a NoneType"),
        ({"values": [1]}, "its values is a list"),
    ],
)
def test_parts_of_a_record_of_another_kind_are_named(tmp_path, changes, found):
    path = make_record(images={}).save(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(TrextonError, match=f"not a readable record \\({found}"):
        Record.load(path)


@pytest.mark.parametrize("piece", ["[],", '{"a": 1},', '"ab",', "1.5,"])
def test_a_record_takes_little_more_memory_than_it_is_long(tmp_path, piece):
    text = '{"schema": 2, "values": {"a": [' + piece * (2**24 // len(piece) - 50) + "0]}}"
    (tmp_path / "e.json").write_text(text)
    code = (
        "import sys\nfrom trexton.base.records import Record\n"
        "try: Record.load(sys.argv[1])\nexcept Exception as error: print(error)\n"
        # Not ru_maxrss, which a child inherits from whoever started it.
        "peak = next(line for line in open('/proc/self/status') if line.startswith('VmHWM'))\n"
        "print(peak.split()[1])"
    )
    command = [sys.executable, "-c", code, tmp_path / "e.json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    *said, most_kilobytes = done.stdout.split("\n")[:-1]
    assert len(said) == 1 and "e.json: not a readable record (" in said[0]
    assert int(most_kilobytes) < 500_000


def with_picture(folder, data, times=1):
    """A record that names so many pictures, all of them one file."""
    path = make_record(images={}).save(folder)
    entry = {"file": "p.png", "sha256": hashlib.sha256(data).hexdigest()}
    pictures = {"images": {str(number): entry for number in range(times)}}
    path.write_text(json.dumps(json.loads(path.read_text()) | pictures))
    (folder / "p.png").write_bytes(data)
    return path


def test_a_piece_of_a_picture_that_is_not_there_gets_no_memory(tmp_path):
    size = (10).to_bytes(4, "big") * 2
    data = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + size + bytes([8, 0, 0, 0, 0]) + b"sums"
    path = with_picture(tmp_path, data + (2**31 - 1).to_bytes(4, "big") + b"IDATabc")
    code = (
        "import resource, sys\nresource.setrlimit(resource.RLIMIT_DATA, (2**29, 2**29))\n"
        "from trexton.base.records import Record\nRecord.load(sys.argv[1])"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True)
    assert done.stderr.rstrip().endswith(
        "not a readable record (its picture p.png is damaged): run its experiment again"
    )


def test_pictures_of_a_record_have_a_bound_together(tmp_path, monkeypatch):
    data = cv2.imencode(".png", np.zeros((50, 40), np.uint8))[1].tobytes()
    path = with_picture(tmp_path, data, times=5)
    assert len(Record.load(path).images) == 5
    monkeypatch.setattr("trexton.base.pictures.MOST_BYTES", 5 * 50 * 40 - 1)
    with pytest.raises(TrextonError, match="pictures unpack to more than 9,999 bytes"):
        Record.load(path)


@pytest.mark.parametrize("name", ["e.json", "p.png"])
def test_a_pipe_and_a_device_are_no_part_of_a_record(tmp_path, name):
    path = with_picture(tmp_path, b"")
    for make in (os.mkfifo, lambda place: os.symlink("/dev/zero", place)):
        (tmp_path / name).unlink()
        make(tmp_path / name)
        with pytest.raises(TrextonError, match=f"{name}: not a regular file"):
            Record.load(path)


def test_a_record_of_the_first_schema_says_how_to_get_one_of_today(tmp_path):
    path = make_record().save(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 1}))
    with pytest.raises(TrextonError, match="schema 1, expected 2: run it again"):
        Record.load(path)


def test_plain_keeps_only_what_json_can_say():
    assert plain((np.float32(0.5), np.inf, {1: np.bool_(True)})) == [0.5, None, {"1": True}]


def test_the_cache_computes_once_and_again_when_an_input_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    calls = []

    def compute():
        calls.append(1)
        return {"x": np.arange(3)}

    for inputs, expected in (({"n": 1}, 1), ({"n": 1}, 1), ({"n": 2}, 2)):
        np.testing.assert_array_equal(
            cached("kind", "trexton.base.files", inputs, compute)["x"], [0, 1, 2]
        )
        assert len(calls) == expected
    cached("kind", "trexton.evaluation.held_out", {"n": 1}, compute)  # other code
    assert len(calls) == 3
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:40])  # a damaged file is made again
    cached("kind", "trexton.base.files", {"n": 1}, compute)
    assert len(calls) == 4


def test_code_hashes_follow_imports():
    found = code_hashes("trexton.localization.localizer")
    assert {
        "trexton.localization.localizer",
        "trexton.localization.filters",
        "trexton.vision.histograms",
        "trexton.base.errors",
    } <= found.keys()
    assert "trexton.cli.main" not in found and all(len(value) == 64 for value in found.values())


def test_atomic_writes_leave_all_or_nothing(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")
    with pytest.raises(RuntimeError), atomic_file(target) as stream:
        stream.write("half")
        raise RuntimeError
    assert target.read_text() == "old" and list(tmp_path.iterdir()) == [target]
    folder = tmp_path / "folder"
    for content in ("one", "two"):
        with atomic_folder(folder, replace=True) as temporary:
            (temporary / "mark").write_text(content)
        assert (folder / "mark").read_text() == content
    with pytest.raises(RuntimeError), atomic_folder(folder, replace=True) as temporary:
        (temporary / "mark").write_text("three")
        raise RuntimeError
    assert (folder / "mark").read_text() == "two" and len(list(tmp_path.iterdir())) == 2


def test_digests_tell_type_and_shape_apart():
    values = [np.zeros(4), np.zeros((2, 2)), np.zeros(4, np.float32), b"\0" * 32, [0, 0, 0, 0]]
    assert len({digest(value) for value in values}) == len(values)
    assert digest([1], [2]) != digest([1, 2])
