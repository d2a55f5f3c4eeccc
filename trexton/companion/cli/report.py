"""``trexton report FLIGHT --out DIR``: will it work here? A printable page and a small book."""

import argparse
from pathlib import Path

PAGES = ("assessment", "mocap_training", "map_loss", "texton_dictionary")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", metavar="FLIGHT", help="Flight folder to train on")
    parser.add_argument("--test-flight", metavar="FLIGHT", help="another Flight folder to test on")
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument(
        "--methods", default="paper field", metavar="NAMES", help="to compare (default %(default)s)"
    )
    parser.add_argument("--no-book", action="store_true", help="the printable page only")


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.records import Record
    from trexton.companion.build.flight_pairs import FlightPair, load_pair
    from trexton.companion.build.plan import run_experiments
    from trexton.companion.build.small_report import write_report
    from trexton.companion.cli.run import print_outcomes
    from trexton.flights.plausibility import warnings

    out = Path(arguments.out)
    pair = load_pair(arguments.flight, arguments.test_flight)  # what cannot be tested is said
    pairs = [FlightPair(arguments.flight, arguments.test_flight)]
    first, *others = PAGES
    # The verdict on every core and at once; the other pages take from it what was counted.
    settings = {f"{first}.methods": arguments.methods}
    outcomes = run_experiments(pairs, out, only=[first], settings=settings, jobs=1)
    if outcomes[0].status not in ("ran", "reused"):
        print_outcomes(outcomes, explain=False)
        return 1
    record = Record.load(out / pairs[0].name / f"{first}.json")
    from trexton.companion.experiments.assessment import finding

    print(finding(record), flush=True)
    doubts = [f"{flight.name}: {doubt}" for flight in pair for doubt in warnings(flight)]
    for doubt in doubts:
        print(f"warning  {doubt}")
    if not arguments.no_book:
        outcomes += run_experiments(pairs, out, only=others)
    print_outcomes(outcomes, explain=False)
    player = f"{pairs[0].name}/mocap_training-player.html"
    player = player if (out / player).is_file() else ""
    page = write_report(record, out / "report.html", player, arguments.flight, doubts)
    print(page)  # it is there, whatever becomes of the book
    if not arguments.no_book:
        from trexton.companion.build.make import build_small_book

        print(build_small_book(pairs, outcomes, out))
    return 0
