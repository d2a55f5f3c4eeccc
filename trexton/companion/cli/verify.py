"""``trexton verify [RECORD ...]``: run experiments again and say what changed."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from trexton.base.errors import ParameterError

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
    parser.add_argument("--quick", action="store_true", help="one process a record instead of six")
    parser.add_argument(
        "--update", action="store_true", help="write what differs as the new reference values"
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.companion.checks.verify import QUICK, VARIANTS, references, update, verify

    variants = QUICK if arguments.quick else VARIANTS
    if arguments.quick and arguments.update:
        raise ParameterError("--update needs all processes: leave --quick out")
    status = 0
    with tempfile.TemporaryDirectory() as work:
        for path in [Path(record) for record in arguments.records] or references():
            verdict = verify(
                path, Path(work), arguments.flight, arguments.test_flight, variants=variants
            )
            if not verdict.disagreements and not verdict.changes:
                print(f"{path}: as it was, in processes: {len(variants)}")
                continue
            if verdict.disagreements:
                print(f"{path}: processes disagree with the first")
                show(verdict.disagreements)
            if verdict.changes:
                print(f"{path}: {len(verdict.changes)} entries changed since it was made")
                show(verdict.changes)
                versions = ", ".join(verdict.versions) or "no version: look at code and machine"
                print(f"  what moved: {versions}")
            if arguments.update:
                update(verdict)
                print(f"{path}: updated")
            else:
                status = 1
    return status


def show(lines: list[str]) -> None:
    """The first of many lines, and how many more there are."""
    for line in lines[:MOST_LINES]:
        print(f"  {line}")
    if len(lines) > MOST_LINES:
        print(f"  and {len(lines) - MOST_LINES} more")
