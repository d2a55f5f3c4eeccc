"""``trexton export SOURCE KIND --out FILE``: write a track as TUM, CSV or GeoJSON."""

from __future__ import annotations

import argparse
from pathlib import Path

from trexton.base.files import check_not_read
from trexton.base.progress import say

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from trexton.flights.exporters import EXPORTERS

    parser.add_argument("source", help="Flight folder, or record of an experiment (.json)")
    parser.add_argument("kind", help=f"{', '.join(EXPORTERS)}, or module:function")
    parser.add_argument("--out", required=True, metavar="FILE", help="file to write")
    parser.add_argument(
        "--what", default="truth", metavar="TRACK",
        help="of a record: truth (default), estimate, knn, or a method that assessment.json "
        "compares",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    from trexton.flights.exporters import export, load_trajectory

    check_not_read(arguments.out, arguments.source)
    track = load_trajectory(Path(arguments.source), arguments.what)
    path = export(track, arguments.kind, Path(arguments.out))
    say(f"{path}: {len(track.time)} positions of {track.name}")
    return 0
