"""``trexton run``: the experiment notebooks on a flight, with records, figures and a small book."""

from __future__ import annotations

import argparse
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from trexton.base.arguments import add_assignments, assignments
from trexton.base.errors import ParameterError
from trexton.companion.build.display import Outcome
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.plan import run_experiments

_TLS = ("ca-file", "client.cert", "client.key")  # as Dask calls them


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "flights", nargs="+", metavar="FLIGHT",
        help="Flight folders to train on (and to test on, by their splits)",
    )  # fmt: skip
    parser.add_argument("--test-flight", metavar="FLIGHT", help="another Flight folder to test on")
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these experiments only")
    add_run_arguments(parser)
    parser.add_argument("--notebooks", metavar="DIR", help="another folder of notebooks")
    add_cluster_arguments(parser)
    parser.add_argument("--no-book", action="store_true", help="leave out the small book")


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """What every verb that runs notebooks takes: ``--set``, ``--explain``, ``--jobs``."""
    words = "a parameter of the notebooks, or of one: mocap_training.samples=200"
    add_assignments(parser, "KEY=VALUE", words)
    parser.add_argument(
        "--explain", action="store_true", help="say why each experiment was reused or run"
    )
    help_jobs = "notebooks at once (default: as many as fit this machine)"
    parser.add_argument("--jobs", type=int, metavar="N", help=help_jobs)


def add_cluster_arguments(parser: argparse.ArgumentParser) -> None:
    """``--cluster`` and the files of TLS with which it is reached."""
    parser.add_argument(
        "--cluster", metavar="ADDRESS",
        help="run on a Dask cluster, such as tls://HOST:8786, whose workers see the same folders",
    )  # fmt: skip
    for name, held in (("ca", "authority"), ("cert", "certificate"), ("key", "private key")):
        parser.add_argument(f"--tls-{name}", metavar="PEM", help=f"{held}, for a tls:// address")


def reaching_cluster(arguments: argparse.Namespace) -> AbstractContextManager[object]:
    """Within the block a cluster is reached with the files of TLS that were named.

    Raises
    ------
    ParameterError
        One is missing, or the address is none of TLS: what is sent would not be protected.
    """
    typed = (arguments.tls_ca, arguments.tls_cert, arguments.tls_key)
    named = {f"distributed.comm.tls.{key}": file for key, file in zip(_TLS, typed, strict=True)}
    if not any(typed):
        return nullcontext()
    if missing := [file for file in typed if file and not Path(file).is_file()]:
        raise ParameterError(f"{missing[0]}: no such file: give one of TLS, as PEM")
    if not (arguments.cluster or "").startswith("tls://"):
        raise ParameterError(
            f"files of TLS, but --cluster {arguments.cluster}: expected an address tls://HOST:PORT"
        )
    import dask

    return dask.config.set(named)


def run(arguments: argparse.Namespace) -> int:
    if arguments.test_flight is not None and len(arguments.flights) > 1:
        raise ParameterError("--test-flight belongs to one flight: run the others by themselves")
    pairs = [FlightPair(flight, arguments.test_flight) for flight in arguments.flights]
    with reaching_cluster(arguments):
        outcomes = run_experiments(
            pairs,
            arguments.out,
            only=arguments.only,
            settings=assignments(arguments.settings, "key=value"),
            jobs=arguments.jobs,
            notebooks=arguments.notebooks,
            cluster=arguments.cluster,
        )
    print_outcomes(outcomes, arguments.explain)
    if not arguments.no_book and any(outcome.status in ("ran", "reused") for outcome in outcomes):
        from trexton.companion.build.make import build_small_book

        print(build_small_book(pairs, outcomes, Path(arguments.out), arguments.notebooks))
    return int(any(outcome.status == "failed" for outcome in outcomes))


def print_outcomes(outcomes: list[Outcome], explain: bool) -> None:
    """One line an experiment; reasons where it failed or was skipped, or everywhere (`explain`).
    What failed goes to stderr.
    """
    for outcome in outcomes:
        stream = sys.stderr if outcome.status == "failed" else sys.stdout
        print(outcome, file=stream)
        if explain or outcome.status in ("failed", "skipped"):
            for reason in outcome.reasons:
                print(f"        {reason}", file=stream)
    counts = {
        status: sum(outcome.status == status for outcome in outcomes)
        for status in ("ran", "reused", "skipped", "failed")
    }
    print(", ".join(f"{count} {status}" for status, count in counts.items() if count))
