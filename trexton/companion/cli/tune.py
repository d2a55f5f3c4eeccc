"""``trexton tune FLIGHT --rate HZ``: settings that suit a flight and keep a rate here."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from trexton.base.arguments import add_options, chosen_options
from trexton.base.options import Options, option

__all__ = ["Search", "add_arguments", "run"]


@dataclass(frozen=True)
class Search(Options):
    """What a frame may take, and how long is searched."""

    rate: float | None = option(None, "frames a second to keep up", above=0)
    headroom: float = option(0.5, "share of the time that stays free", low=0, below=1)
    trials: int = option(40, "settings to try", low=1)
    seconds: float = option(300.0, "begin none later", above=0)
    seed: int = option(1, "of the search", low=0)

    @property
    def budget_s(self) -> float:
        """Seconds that a frame may take."""
        return float("inf") if self.rate is None else (1 - self.headroom) / self.rate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", help="flight folder; its train split is used where it has one")
    add_options(parser, Search)
    parser.add_argument(
        "--methods", nargs="+", default=["paper", "field"], metavar="NAME",
        help="methods to choose from (default: paper field)",
    )  # fmt: skip
    parser.add_argument(
        "--study", metavar="FILE", help="keep all trials there; a search that was stopped goes on"
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.files import check_not_read
    from trexton.companion.checks.tuning import choose, frontier, search
    from trexton.flights import read_flight

    if arguments.study is not None:
        check_not_read(arguments.study, arguments.flight)
    asked = chosen_options(arguments, Search)
    flight = read_flight(arguments.flight).part_or_all("train")
    tried = search(
        flight, methods=arguments.methods, trials=asked.trials, seconds=asked.seconds,
        seed=asked.seed, study=arguments.study,
    )  # fmt: skip
    print(f"{len(tried)} settings tried; none errs less in less time than these:")
    for one in frontier(tried):
        print(f"{_metres(one.error_m)}  {1000 * one.frame_s:7.3f} ms a frame  {one.setting}")
    best = choose(tried, asked.budget_s)
    within = "" if asked.rate is None else f", within {1000 * asked.budget_s:.3g} ms a frame"
    print(f"\nFly {best.setting}{within}:")
    print("\n".join(best.setting.commands(arguments.flight, "tuned.npz")))
    return 0


def _metres(error: float) -> str:
    return f"{100 * error:6.1f} cm" if error < 10 else f"{error:6.1f} m "
