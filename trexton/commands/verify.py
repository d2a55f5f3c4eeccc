"""``trexton verify [RECORD ...]``"""

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
    from trexton.verify import RELATIVE, VARIANTS, references, update, verify

    status = 0
    for path in [Path(record) for record in arguments.records] or references():
        with tempfile.TemporaryDirectory() as work:
            verdict = verify(path, Path(work), arguments.flight, arguments.test_flight)
        if verdict.holds:
            exact = sum(variant.exact for variant in VARIANTS)
            print(
                f"{path}: as it was; {exact} processes agree to the byte, "
                f"{len(VARIANTS) - exact} with other BLAS kernels to {RELATIVE:g}"
            )
            continue
        if verdict.disagreements:
            print(f"{path}: processes disagree with the first ({VARIANTS[0].name})")
            show(verdict.disagreements)
        if verdict.changes:
            print(f"{path}: {len(verdict.changes)} entries changed since it was made")
            show(verdict.changes)
            known = ", ".join(verdict.versions) or "no version: look at the code and the machine"
            print(f"  what moved: {known}")
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
