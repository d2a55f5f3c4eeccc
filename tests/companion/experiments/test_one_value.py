"""One quantity, one value: what several experiments quote of the same flights is the same."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT
from small_room import histogram_flight

from trexton.base.records import Record
from trexton.companion.experiments import (
    baselines,
    beyond,
    choices,
    mocap_training,
    trade_off,
    uncertainty,
)
from trexton.companion.experiments.printed import look_up

# Of one method with its default settings over the test flight: a measure, and where it stands.
SAME = {
    "paper, mean error": (
        "mocap_training:filter.mean_cm", "beyond:paper.mean_cm",
        "choices:variants.paper.mean_cm", "trade_off:default.mean_cm", "baselines:paper.mean_cm",
    ),
    "paper, error an axis": (
        "mocap_training:filter.axis_mean_cm", "trade_off:default.axis_mean_cm"
    ),
    "paper, lag": ("mocap_training:lag", "beyond:lag"),
    "paper, coverage": (
        "beyond:paper.held", "uncertainty:paper.within_90", "baselines:paper.held"
    ),
    "paper, mean error, training and test exchanged": (
        "mocap_training:exchanged.filter.mean_cm", "baselines:exchanged.paper.mean_cm"
    ),
    "paper with motion noise of 25 cm, mean error": (
        "beyond:agile.mean_cm", "choices:variants.motion_25.mean_cm"
    ),
    "field, mean error": ("beyond:field.mean_cm", "baselines:field.mean_cm"),
    "field, coverage": (
        "beyond:field.held", "uncertainty:field.within_90", "baselines:field.held"
    ),
}  # fmt: skip
BUILT = [
    path for flight in ("sim-survey", "cyberzoo") if (path := ROOT / "results" / flight).is_dir()
]


def agree(values: dict[str, dict]) -> dict[str, list[object]]:
    """Every quantity as it is quoted; None where a record lacks it."""
    quoted = {
        quantity: [look_up(values.get(name), path) for name, path in places]
        for quantity, places in SAME.items()
        for places in [[place.split(":") for place in places]]
    }
    for quantity, entries in quoted.items():
        said = {str(each) for each in entries if each is not None}
        assert len(said) <= 1, f"{quantity}: {said}"
    return quoted


def test_experiments_quote_one_value():
    train, test = histogram_flight("hall", frames=60), histogram_flight("hall", 30, noise=2)
    quoted = agree(
        {
            name: module.run(train, test, module.Parameters(particles=20, **more)).values
            for name, module, more in (
                ("mocap_training", mocap_training, {}),
                ("beyond", beyond, {"repeats": 1}),
                ("choices", choices, {"repeats": 1}),
                ("trade_off", trade_off, {"repeats": 1, "stored": 300}),
                ("uncertainty", uncertainty, {"repeats": 1, "vehicles": 2}),
                ("baselines", baselines, {"repeats": 1, "trees": 5}),
            )
        }
    )
    assert not [quantity for quantity, entries in quoted.items() if None in entries]


@pytest.mark.parametrize("folder", BUILT, ids=lambda path: path.name)
def test_the_book_quotes_one_value(folder: Path):
    agree({path.stem: Record.load(path).values for path in folder.glob("*.json")})
