"""``trexton report FLIGHT --out DIR``: will it work here? A printable page and a small book."""

import argparse
from contextlib import suppress
from pathlib import Path

from trexton.base.errors import TrextonError
from trexton.companion.build.unchanged import Unchanged

VERDICT = "assessment"
PAGES = ("mocap_training", "map_loss", "texton_dictionary")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", metavar="FLIGHT", help="Flight folder to train on")
    parser.add_argument("--test-flight", metavar="FLIGHT", help="another Flight folder to test on")
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument(
        "--methods", default="paper field", metavar="NAMES", help="to compare (default %(default)s)"
    )
    parser.add_argument("--no-book", action="store_true", help="the printable page only")


def run(arguments: argparse.Namespace) -> int:
    out, flights = Path(arguments.out), [arguments.flight]
    flights += [arguments.test_flight] if arguments.test_flight else []
    asked = [arguments.methods, arguments.no_book, *flights]
    before = Unchanged(out / ".unchanged", asked, [Path(each) for each in flights], [out])
    if sentences := before.last():
        print("Nothing has changed since the report was made.", *sentences, sep="\n")
        return 0
    from trexton.companion.build.flight_pairs import FlightPair, check_out, load_pair
    from trexton.companion.experiments.assessment import Parameters, finding
    from trexton.companion.experiments.assessment import run as experiment
    from trexton.flights.plausibility import warnings

    chosen = Parameters(methods=arguments.methods)
    pair = load_pair(arguments.flight, arguments.test_flight)  # what cannot be tested is said
    pairs = [FlightPair(arguments.flight, arguments.test_flight)]
    check_out(out, pairs)
    said, doubts = list[str](), list[str]()
    with suppress(TrextonError):  # which its page names too
        said.append(finding(experiment(*pair, chosen)))
        print(said[-1], flush=True)
    for doubt in (f"{flight.name}: {doubt}" for flight in pair for doubt in warnings(flight)):
        print(f"warning  {doubt}", flush=True)
        doubts.append(doubt)
    # Loaded when the verdict is said: the engine of the pages, and what makes the book.
    from trexton.base.records import Record
    from trexton.companion.build.make import build_small_book
    from trexton.companion.build.plan import run_experiments
    from trexton.companion.build.small_report import write_report
    from trexton.companion.cli.run import print_outcomes

    pages = (VERDICT,) if arguments.no_book else (VERDICT, *PAGES)
    settings = {f"{VERDICT}.methods": arguments.methods}
    outcomes = run_experiments(pairs, out, only=pages, settings=settings)
    print_outcomes(outcomes, explain=False)
    if not any(outcome.good for outcome in outcomes if outcome.experiment == VERDICT):
        return 1
    record = Record.load(out / pairs[0].name / f"{VERDICT}.json")
    player = f"{pairs[0].name}/mocap_training-player.html"
    player = player if (out / player).is_file() else ""
    page = write_report(record, out / "report.html", player, arguments.flight, doubts)
    said += [*(f"warning  {doubt}" for doubt in doubts), str(page)]
    print(page)  # it is there, whatever becomes of the book
    if not arguments.no_book:
        said.append(str(build_small_book(pairs, outcomes, out)))
        print(said[-1])
    if all(outcome.status != "failed" for outcome in outcomes):
        before.remember(said)
    return 0
