"""``trexton tune FLIGHT --rate HZ``: settings that suit a flight and keep a rate on this
machine.
"""

from __future__ import annotations

import argparse

from trexton.base.errors import ParameterError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", help="flight folder; its train split is used where it has one")
    parser.add_argument("--rate", type=float, metavar="HZ", help="frames a second to keep up")
    share = "share of the time that stays free (default %(default)s)"
    parser.add_argument("--headroom", type=float, default=0.5, metavar="SHARE", help=share)
    parser.add_argument(
        "--methods", nargs="+", default=["paper", "field"], metavar="NAME",
        help="methods to choose from (default: paper field)",
    )  # fmt: skip
    parser.add_argument(
        "--trials", type=int, default=40, help="settings to try (default %(default)s)"
    )
    parser.add_argument(
        "--seconds", type=float, default=300, help="begin none later (default %(default)s)"
    )
    parser.add_argument(
        "--study", metavar="FILE", help="keep all trials there; a search that was stopped goes on"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the search (default %(default)s)")


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.files import check_not_read
    from trexton.companion.checks.tuning import choose, frontier, search
    from trexton.flights import read_flight

    if arguments.study is not None:
        check_not_read(arguments.study, arguments.flight)
    budget_s = _budget(arguments.rate, arguments.headroom)
    flight = read_flight(arguments.flight).part_or_all("train")
    tried = search(
        flight, methods=arguments.methods, trials=arguments.trials, seconds=arguments.seconds,
        seed=arguments.seed, study=arguments.study,
    )  # fmt: skip
    print(f"{len(tried)} settings tried; none errs less in less time than these:")
    for one in frontier(tried):
        print(f"{_metres(one.error_m)}  {1000 * one.frame_s:7.3f} ms a frame  {one.setting}")
    best = choose(tried, budget_s)
    within = "" if arguments.rate is None else f", within {1000 * budget_s:.3g} ms a frame"
    print(f"\nFly {best.setting}{within}:")
    print("\n".join(best.setting.commands(arguments.flight, "tuned.npz")))
    return 0


def _budget(rate: float | None, headroom: float) -> float:
    """Seconds that a frame may take."""
    if rate is not None and not 0 < rate < float("inf"):
        raise ParameterError(f"the rate is {rate} Hz: expected a positive number")
    if not 0 <= headroom < 1:
        raise ParameterError(
            f"the headroom is {headroom}: expected a share from 0 up to 1, 0.5 to keep half of the "
            "time free"
        )
    return float("inf") if rate is None else (1 - headroom) / rate


def _metres(error: float) -> str:
    return f"{100 * error:6.1f} cm" if error < 10 else f"{error:6.1f} m "
