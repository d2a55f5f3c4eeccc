"""Files of arrays that lie: too many members, bytes used twice, names twice, damage."""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib

import numpy as np
import pytest

from trexton.base.arrays import read_arrays
from trexton.base.cache import cached
from trexton.base.errors import DataError


def header(size):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": "|u1", "fortran_order": False, "shape": (size,)}
    )
    return stream.getvalue()


def overlapping(path, count, size):
    """Each stored member holds all that follow."""
    current, records = bytes(size), []
    for number in reversed(range(count)):
        name, data = b"%06d.npy" % number, header(len(current)) + current
        fields = (0x21, zlib.crc32(data), len(data), len(data), len(name), 0)
        start = struct.pack("<4s5H3I2H", b"PK\3\4", 20, 0, 0, 0, *fields) + name
        records.append((name, fields, len(start) + len(data)))
        current = start + data
    directory = b"".join(
        struct.pack(
            "<4s6H3I5H2I", b"PK\1\2", 20, 20, 0, 0, 0, *fields, 0, 0, 0, 0, len(current) - back
        )
        + name
        for name, fields, back in reversed(records)
    )
    end = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, count, count, len(directory), len(current), 0)
    path.write_bytes(current + directory + end)


def test_members_that_share_bytes_are_refused(tmp_path):
    overlapping(tmp_path / "bomb.npz", 50, 10_000)
    with pytest.raises(DataError, match="would unpack to"):
        read_arrays(tmp_path / "bomb.npz")


def test_very_many_members_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "many.npz", "w") as archive:
        for number in range(1500):
            archive.writestr(f"{number}.npy", header(0))
    with pytest.raises(DataError, match="bytes that name arrays: expected at most"):
        read_arrays(tmp_path / "many.npz")


@pytest.mark.parametrize(("count", "comment"), [(70_000, b""), (1500, b"made by hand")])
def test_a_list_of_members_that_hides_its_length_is_never_read(tmp_path, count, comment):
    with zipfile.ZipFile(tmp_path / "many.npz", "w") as archive:
        archive.comment = comment
        for number in range(count):
            archive.writestr(f"{number}.npy", b"")
    with pytest.raises(zipfile.BadZipFile, match="does not end as"):
        read_arrays(tmp_path / "many.npz")


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_one_name_twice_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "twice.npz", "w") as archive:
        for _ in range(2):
            archive.writestr("a.npy", header(0))
    with pytest.raises(DataError, match="two arrays have one name"):
        read_arrays(tmp_path / "twice.npz")


def damaged(kind, path):
    whole = path.read_bytes()
    if kind == "emptied":
        path.write_bytes(b"")
    elif kind == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    elif kind == "changed":
        at = whole.index(np.arange(5.0).tobytes()) + 9
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    else:  # one of two arrays is missing
        stored = dict(np.load(path))
        np.savez(path, a=stored["a"], contents=stored["contents"])


@pytest.mark.parametrize("kind", ["emptied", "cut", "changed", "incomplete"])
def test_a_damaged_cache_is_made_again_and_said(kind, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    calls = []

    def compute():
        calls.append(1)
        return {"a": np.arange(5.0), "b": np.ones(2)}

    def again():
        return cached("thing", "trexton.base.errors", {"x": 1}, compute)

    again()
    assert list(again()) == ["a", "b"] and len(calls) == 1
    (path,) = tmp_path.glob("thing-*.npz")
    damaged(kind, path)
    result = again()
    assert (result["a"] == np.arange(5.0)).all() and (result["b"] == 1).all() and len(calls) == 2
    assert "made again" in capsys.readouterr().err
    assert len(list(again())) == 2 and len(calls) == 2


@pytest.mark.parametrize(
    "make", [os.mkdir, os.mkfifo, lambda place: os.symlink("/dev/zero", place)]
)
def test_what_is_no_file_of_the_cache_stays_and_costs_nothing(make, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))

    def ask():
        return cached("thing", "trexton.base.errors", {}, lambda: {"a": np.arange(3)})

    ask()
    (path,) = tmp_path.iterdir()
    path.unlink()
    make(path)
    before = path.lstat().st_mode
    assert ask()["a"].tolist() == [0, 1, 2] and path.lstat().st_mode == before
    assert "nothing is kept there" in capsys.readouterr().err
