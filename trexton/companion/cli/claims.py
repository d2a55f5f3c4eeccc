"""``trexton claims``: judge every claim of the paper by the results at hand."""

from __future__ import annotations

import argparse

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "results", nargs="?", default="results", help="folder of results (default %(default)s)"
    )


def run(arguments: argparse.Namespace) -> int:
    from pathlib import Path

    from trexton.companion.claims.ledger import count_verdicts, write_ledger

    rows = write_ledger(Path(arguments.results))
    for claim, findings in rows:
        print(f"{claim.text} ({claim.place})")
        if claim.printed_value is not None:
            print(f"    printed: {claim.printed_value:g} {claim.unit}".rstrip())
        if claim.measure:
            print(f"    tested: {claim.measure}" + (f": {claim.rule}" if claim.rule else ""))
        for finding in findings:
            ours = " against ".join(str(q) for q in (finding.ours, finding.other) if q) or "-"
            reason = f" ({finding.reason})" if finding.reason else ""
            print(f"    {finding.flight}: {ours}: {finding.verdict}{reason}")
    for flight, counts in count_verdicts(rows).items():
        print(f"{flight}: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    print(f"written to {Path(arguments.results) / 'claims.json'}")
    return 0
