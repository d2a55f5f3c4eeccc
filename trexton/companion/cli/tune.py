"""``trexton tune FLIGHT --rate HZ``: settings that suit a flight. They keep the rate here."""

import argparse
from dataclasses import dataclass

from trexton.base.arguments import add_options, chosen_options
from trexton.base.options import Options, option


@dataclass(frozen=True)
class Search(Options):
    """What a frame may take, and how long is searched."""

    rate: float | None = option(None, "frames a second to keep up", above=0)
    headroom: float = option(0.5, "share of the time that stays free", low=0, high=0.99)
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
    usual, words = ["paper", "field"], "methods to choose from (default: paper field)"
    parser.add_argument("--methods", nargs="+", default=usual, metavar="NAME", help=words)


def run(arguments: argparse.Namespace) -> int:
    from trexton.companion.checks.tuning import choose, commands, frontier, search
    from trexton.flights.folder import read_flight

    goal = chosen_options(arguments, Search)
    flight = read_flight(arguments.flight).part_or_all("train")
    tried = search(
        flight, methods=arguments.methods, trials=goal.trials, seconds=goal.seconds, seed=goal.seed
    )
    print(f"{len(tried)} settings tried; none has a smaller error in less time than these:")
    for one in frontier(tried):
        print(one)
    best = choose(tried, goal.budget_s)
    within = "" if goal.rate is None else f", within {1000 * goal.budget_s:.3g} ms a frame"
    print(f"\nThe cheapest of those with the smallest error{within}:")
    print("\n".join(commands(best.setting, arguments.flight, "tuned.npz")))
    return 0
