"""``trexton verify [RECORD ...]``: run experiments again and say what changed."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

__all__ = ["add_arguments", "run"]

MOST_LINES = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "records", nargs="*", metavar="RECORD",
        help="records of experiments, such as results/NAME/mocap_training.json "
        "(default: the committed reference values)",
    )  # fmt: skip
    parser.add_argument("--flight", metavar="FLIGHT", help="Flight folder that they were made of")
    parser.add_argument("--test-flight", metavar="FLIGHT", help="and the one they were tested on")
    parser.add_argument(
        "--update", action="store_true", help="write what differs as the new reference values"
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.companion.checks.verify import references, update, verify

    status = 0
    with tempfile.TemporaryDirectory() as work:
        for path in [Path(record) for record in arguments.records] or references():
            verdict = verify(path, Path(work), arguments.flight, arguments.test_flight)
            if not verdict.changes:
                print(f"{path}: as it was")
                continue
            print(f"{path}: {len(verdict.changes)} entries changed since it was made")
            for line in verdict.changes[:MOST_LINES]:
                print(f"  {line}")
            if len(verdict.changes) > MOST_LINES:
                print(f"  and {len(verdict.changes) - MOST_LINES} more")
            versions = ", ".join(verdict.versions) or "no version: look at code and machine"
            print(f"  what moved: {versions}")
            if arguments.update:
                update(verdict)
                print(f"{path}: updated")
            else:
                status = 1
    return status
