"""``trexton verify [RECORD ...]``: run experiments again and say what changed."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from trexton.base.errors import ParameterError

if TYPE_CHECKING:
    from trexton.companion.checks.verify import ProcessVariant, Verdict

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
    from trexton.companion.checks.verify import QUICK, VARIANTS, references, verify

    variants = QUICK if arguments.quick else VARIANTS
    if arguments.quick and arguments.update:
        raise ParameterError("--update needs all processes: leave --quick out")
    flights = arguments.flight, arguments.test_flight
    status = 0
    with tempfile.TemporaryDirectory() as work:
        for path in [Path(record) for record in arguments.records] or references():
            verdict = verify(path, Path(work), *flights, variants=variants)
            status |= _report(verdict, variants, arguments.update)
    return status


def _report(verdict: Verdict, variants: tuple[ProcessVariant, ...], updating: bool) -> int:
    """Say what came of one record; 1 if it is not as it was."""
    from trexton.companion.checks.verify import precision, update

    path = verdict.path
    exact = sum(variant.exact for variant in variants)
    if verdict.holds:
        print(
            f"{path}: as it was; {exact} processes agree to the byte, "
            f"{len(variants) - exact} with other BLAS kernels to {precision(verdict.rebuilt):g}"
            if len(variants) > 1
            else f"{path}: as it was, in one process ({variants[0].name})"
        )
        return 0
    if verdict.disagreements:
        print(f"{path}: processes disagree with the first ({variants[0].name})")
        show(verdict.disagreements)
    if verdict.changes:
        print(f"{path}: {len(verdict.changes)} entries changed since it was made")
        show(verdict.changes)
        versions = ", ".join(verdict.versions) or "no version: look at the code and the machine"
        print(f"  what moved: {versions}")
    if not updating:
        return 1
    update(verdict)
    print(f"{path}: updated")
    return 0


def show(lines: list[str]) -> None:
    """The first of many lines, and how many more there are."""
    for line in lines[:MOST_LINES]:
        print(f"  {line}")
    if len(lines) > MOST_LINES:
        print(f"  and {len(lines) - MOST_LINES} more")
