"""Positions as autopilots and cameras log them, written as their formats are documented."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np


def dataflash(*formats: tuple) -> bytes:
    """The head of a DataFlash log: formats that describe themselves."""
    return b"".join(
        b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name, types, columns)
        for number, name, types, columns, length in (
            (128, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns", 89), *formats
        )
    )  # fmt: skip


def ardupilot_log(rows: int = 20) -> bytes:
    """A DataFlash log of positions and attitudes."""
    text = dataflash(
        (1, b"POS", b"QLLff", b"TimeUS,Lat,Lng,Alt,RelHomeAlt", 3 + 24),
        (2, b"ATT", b"QccC", b"TimeUS,Roll,Pitch,Yaw", 3 + 14),
    )
    for i in range(rows):
        text += b"\xa3\x95\x01" + struct.pack(
            "<Qiiff", 10**6 + i * 10**5, 470000000 + 100 * i, 80000000, 400, 10
        )
        text += b"\xa3\x95\x02" + struct.pack("<QhhH", 10**6 + i * 10**5, 100, 0, 9000)
    return text


def px4_log(
    rows: int = 20,
    reference: Callable[[int], tuple[float, float]] | None = None,
    turn: tuple[float, ...] = (),
) -> bytes:
    """A ULog: head, format, subscription, rows, the first without a position. Of each row
    `reference` gives the latitude, and metres to the north by which it moves what is logged; `turn`
    is the attitude's w, x, y, z, if any is logged.
    """
    columns = "uint64_t timestamp;double ref_lat;double ref_lon;"
    columns += "float x;float y;float z;float heading;bool xy_valid;"

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    text = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    text += message("F", f"vehicle_local_position:{columns}".encode())
    text += message("F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    text += message("A", struct.pack("<BH", 0, 1) + b"vehicle_local_position")
    for i in range(rows):
        latitude, moved = reference(i) if reference else (47.0, 0.0)
        place = (i + moved, 2.0, -10.0)
        row = struct.pack("<QddffffB", 10**5 * i, latitude, 8.0, *place, np.pi / 2, i > 0)
        text += message("D", struct.pack("<H", 1) + row)
    if turn:
        text += message("A", struct.pack("<BH", 0, 2) + b"vehicle_attitude")
        for i in range(rows):
            text += message("D", struct.pack("<HQffff", 2, 10**5 * i + 10**4, *turn))
    return text


def subtitles(rows: int = 20) -> str:
    """DJI's, twenty a second."""
    return "\n".join(
        f"{i + 1}\n00:00:00,{i * 50:03d} --> 00:00:00,{i * 50 + 50:03d}\n"
        f"[latitude: {47 + i * 1e-5:.5f}] [longitude: 8.00000] [rel_alt: 10.{i} abs_alt: 400.0]\n"
        for i in range(rows)
    )
