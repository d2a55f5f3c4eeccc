"""Options declared once: defaults, types, ranges and text as typed."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from trexton.base.errors import ParameterError
from trexton.base.options import Options, option


@dataclass(frozen=True)
class Choices(Options):
    count: int = option(7, "how many", low=1, high=90)
    width: float = option(0.5, "in metres", low=0)
    rate: float | None = option(None, "in Hz; None: as they come")
    quick: bool = option(False, "fewer of everything")
    kind: str = option("map", "of estimate", choices=("map", "mean"))


def test_defaults_and_values_of_the_declared_types():
    assert Choices().as_dict() == {
        "count": 7, "width": 0.5, "rate": None, "quick": False, "kind": "map",
    }  # fmt: skip
    chosen = Choices(count=8, width=2, rate=3)
    assert (chosen.width, chosen.rate) == (2.0, 3.0) and isinstance(chosen.width, float)


def test_text_takes_the_declared_type():
    typed = {"count": "90", "width": "1", "rate": "None", "quick": "TRUE", "kind": "mean"}
    assert Choices.parse(typed) == Choices(90, 1.0, None, True, "mean")
    assert Choices.parse({"quick": "yes"}).quick and not Choices.parse({"quick": "No"}).quick
    assert Choices.parse({"rate": "25", "count": 3}) == Choices(count=3, rate=25.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"count": "0"}, "parameter count is 0: expected 1 or more"),
        ({"count": "91"}, "parameter count is 91: expected 90 or less"),
        ({"count": "2.5"}, "parameter count is 2.5: expected int, as in count=7"),
        ({"count": "true"}, "parameter count is True: expected int"),
        ({"count": "many"}, "parameter count is 'many': expected int"),
        ({"width": "-0.1"}, "parameter width is -0.1: expected 0 or more"),
        ({"width": float("nan")}, "parameter width is nan: expected a finite number"),
        ({"width": "1e999"}, "parameter width is inf: expected a finite number"),
        ({"rate": "fast"}, "parameter rate is 'fast': expected float or None"),
        ({"quick": "1"}, "parameter quick is 1: expected bool"),
        ({"kind": "best"}, "parameter kind is 'best': expected one of map, mean"),
        ({"colour": "red"}, "tiny has no parameter 'colour': it has count, width, rate"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_sentence(settings, message):
    with pytest.raises(ParameterError) as caught:
        Choices.parse(settings, "tiny")
    assert message in str(caught.value)


def test_every_option_says_what_it_means():
    from trexton.companion.experiments.registry import EXPERIMENTS

    for name, experiment in EXPERIMENTS.items():
        for each in experiment.parameters.declared():
            assert each.meaning and not each.meaning.endswith("."), f"{name}.{each.name}"
