"""``trexton export FLIGHT KIND --out FILE``: a track for other programs. TUM is built in."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.files import atomic_file, check_not_read, check_writable
from trexton.base.progress import say
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", metavar="FLIGHT", help="the folder that holds flight.toml")
    parser.add_argument("kind", choices=["tum"], help="the format")
    parser.add_argument("--out", required=True, metavar="FILE", help="file to write")
    parser.add_argument("--replace", action="store_true", help="replace the file that is there")


def run(arguments: argparse.Namespace) -> int:
    path = Path(arguments.out)
    check_not_read(path, arguments.flight)
    check_writable(path)
    if path.exists() and not arguments.replace:
        raise ParameterError(f"{path}: is there already: say --replace, or give another name")
    flight = read_flight(arguments.flight)
    if not flight.located.any():
        raise FlightError(f"{arguments.flight}: no frame has a position: there is no track")
    write_tum(flight, path)
    say(f"{path}: {flight.located.sum()} positions of {flight.name}")
    return 0


def write_tum(flight: Flight, path: Path) -> Path:
    """Write the located frames, whole or not at all: ``stamp x y z qx qy qz qw``, seconds and
    metres, as evo reads it; the quaternion turns a vehicle whose x points forward (REP 103). Of z
    and yaw gaps are interpolated; where nothing is known they are 0.
    """
    flight = flight.select(flight.located)
    zero = np.zeros(len(flight))
    yaw = None if flight.attitude is None else flight.attitude[:, 2]
    # A vehicle of yaw 0 flies along y (`trexton.vision.camera`).
    half = (_filled(flight.time, yaw, np.unwrap) + np.pi / 2) / 2
    turn = [zero, zero, np.sin(half), np.cos(half)]
    columns = [flight.time, flight.position, _filled(flight.time, flight.height), *turn]
    with atomic_file(path) as stream:
        np.savetxt(stream, np.column_stack(columns), fmt="%.9f")
    return path


def _filled(time: np.ndarray, values: np.ndarray | None, even: Any = np.asarray) -> np.ndarray:
    if values is None or not (known := np.isfinite(values)).any():
        return np.zeros(len(time))
    return np.interp(time, time[known], even(values[known]))
