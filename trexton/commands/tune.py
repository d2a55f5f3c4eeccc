"""``trexton tune MAP --rate HZ``: samples and particles that keep a rate on this machine."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from trexton.errors import ParameterError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("map", metavar="MAP", help="texton map made by trexton train")
    parser.add_argument(
        "--rate", type=float, required=True, metavar="HZ", help="frames a second to keep up"
    )
    share = "share of the time that stays free (default %(default)s)"
    parser.add_argument("--headroom", type=float, default=0.5, metavar="SHARE", help=share)
    record = "trade_off.json of the experiment (default: in results/FLIGHT/ of the map's flight)"
    parser.add_argument("--record", metavar="FILE", help=record)
    parser.add_argument(
        "--seed", type=int, default=1, help="of the frames timed (default %(default)s)"
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.localizer import TextonMap
    from trexton.records import Record
    from trexton.streams import stream
    from trexton.tuning import tune

    texton_map = TextonMap.load(arguments.map)
    record = Record.load(_record_file(arguments.record, texton_map))
    rng = stream(arguments.seed, "tuning")
    best = tune(texton_map, record, arguments.rate, headroom=arguments.headroom, rng=rng)
    period_ms = 1000 / arguments.rate
    patches = "every patch" if best.samples is None else f"{best.samples} samples"
    drawn = patches + ", " if texton_map.dictionary is not None else ""
    cost = (
        f"{1000 * best.frame_s:.3g} ms a frame here, of {period_ms:.3g} ms at {arguments.rate:g} Hz"
    )
    print(f"{drawn}{best.particles} particles: {cost}")
    print(
        f"predicted error: {best.error_cm:.0f} cm on each axis (mean absolute, flight "
        f"{record.flight})"
    )
    options = f"--samples {best.samples or 0} " if texton_map.dictionary is not None else ""
    print(f"trexton onboard {arguments.map} {options}--particles {best.particles}")
    return 0


def _record_file(given: str | None, texton_map: Any) -> Path:
    """The file asked for, or the one that the book's run leaves for the map's flight."""
    if given is not None:
        path = Path(given)
    else:
        path = Path("results") / str(texton_map.provenance.get("flight", "")) / "trade_off.json"
    if not path.is_file():
        raise ParameterError(
            f"{path}: no trade-off record, which knows what fewer samples cost: make it with "
            "trexton run FLIGHT --only trade_off --out results, or name one with --record"
        )
    return path
