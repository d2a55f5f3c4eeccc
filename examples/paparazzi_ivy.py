"""Positions of ``trexton onboard`` on Paparazzi's Ivy bus, as REMOTE_GPS_LOCAL.

    trexton onboard hall.npz | python3 paparazzi_ivy.py 42 --heading 84 --height 1.0

Needs ``pip install ivy-python``. `message` needs nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import sys

WEEK_MS = 7 * 24 * 3600 * 1000


def message(row: dict, aircraft: int, heading: float, height: float) -> str | None:
    """What the bus carries for one JSON line; None for what no vehicle may steer by.

    `heading` is that of the map's +y axis in radians from north, clockwise. Fields: aircraft,
    padding, east, north, up in metres, their speeds, time of week in milliseconds, course. Speeds
    and course are zero, for nothing measures them and the message knows no "unknown".
    """
    if not row["observed"] or row["lost"] or row["stale"] or None in (row["x_m"], row["y_m"]):
        return None
    c, s = math.cos(heading), math.sin(heading)
    east, north = c * row["x_m"] + s * row["y_m"], c * row["y_m"] - s * row["x_m"]
    tow = round(1000 * row["time_s"]) % WEEK_MS
    place = f"{east:.4f} {north:.4f} {height:.4f}"
    return f"datalink REMOTE_GPS_LOCAL {aircraft} 0 {place} 0.0 0.0 0.0 {tow} 0.0"


def main() -> None:
    from ivy.ivy import IvyServer

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("aircraft", type=int, help="its number")
    parser.add_argument("--heading", type=float, default=0.0, help="of the map's +y axis, degrees")
    parser.add_argument("--height", type=float, default=1.0, help="metres that are flown")
    parser.add_argument("--bus", default="127.255.255.255:2010", help="broadcast address and port")
    given = parser.parse_args()
    server = IvyServer("trexton", "trexton ready", usesDaemons=True)
    server.start(given.bus)
    try:
        for line in sys.stdin:
            said = message(
                json.loads(line), given.aircraft, math.radians(given.heading), given.height
            )
            if said is not None:
                server.send_msg(said)
    finally:
        server.stop()


if __name__ == "__main__":
    main()
