"""One quantity, one value: what several experiments quote of the same flights is the same."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT
from small_room import histogram_flight

from trexton.base.records import Record
from trexton.companion.experiments import beyond, choices, mocap_training, trade_off, uncertainty
from trexton.companion.experiments.printed import look_up

# Of one method with its default settings over the test flight: a measure, and where it stands.
SAME = {
    "paper, mean error": (
        "mocap_training:filter.mean_cm", "beyond:paper.mean_cm",
        "choices:variants.paper.mean_cm", "trade_off:default.mean_cm",
    ),
    "paper, error an axis": (
        "mocap_training:filter.axis_mean_cm", "trade_off:default.axis_mean_cm"
    ),
    "paper, lag": ("mocap_training:lag", "beyond:lag"),
    "paper, coverage": ("beyond:paper.held", "uncertainty:paper.within_90"),
    "paper with motion noise of 25 cm, mean error": (
        "beyond:agile.mean_cm", "choices:variants.motion_25.mean_cm"
    ),
    "field, coverage": ("beyond:field.held", "uncertainty:field.within_90"),
}  # fmt: skip
BUILT = [
    path for flight in ("sim-survey", "cyberzoo") if (path := ROOT / "results" / flight).is_dir()
]


def agree(values: dict[str, dict]) -> None:
    for quantity, places in SAME.items():
        quoted = {
            place: look_up(values[name], path)
            for place in places
            for name, _, path in [place.partition(":")]
            if name in values
        }
        assert None not in quoted.values(), f"{quantity}: {quoted}"
        assert len({str(each) for each in quoted.values()}) <= 1, f"{quantity}: {quoted}"


def test_experiments_quote_one_value():
    train, test = histogram_flight("hall", frames=60), histogram_flight("later", 30, noise=2)
    agree(
        {
            name: module.run(train, test, module.Parameters(particles=20, **more)).values
            for name, module, more in (
                ("mocap_training", mocap_training, {}),
                ("beyond", beyond, {"repeats": 1}),
                ("choices", choices, {"repeats": 1}),
                ("trade_off", trade_off, {"repeats": 1, "stored": 300}),
                ("uncertainty", uncertainty, {"repeats": 1, "vehicles": 2}),
            )
        }
    )


@pytest.mark.parametrize("folder", BUILT, ids=lambda path: path.name)
def test_the_book_quotes_one_value(folder: Path):
    agree({path.stem: Record.load(path).values for path in folder.glob("*.json")})
