"""Other light: one path under every light, values and figure agree."""

from copy import deepcopy

import cv2
import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.companion.experiments import light
from trexton.companion.wording import distance
from trexton.simulator import Floor, record_flight
from trexton.vision.camera import Camera, MapImage

SMALL = Camera(160, 120, 130.0)


@pytest.fixture(scope="module")
def train(tmp_path_factory):
    coarse = np.random.default_rng(1).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    picture = cv2.resize(coarse, (768, 768), interpolation=cv2.INTER_CUBIC)
    floor = Floor(MapImage.from_extent(picture, 0.0, 3.0, 256))
    return record_flight(
        tmp_path_factory.mktemp("light") / "room", frames=110, every=6, floor=floor, camera=SMALL
    )


@pytest.fixture(scope="module")
def record(train):
    parameters = light.Parameters(frames=8, samples=100, textons=8, particles=30, neighbors=3)
    return light.run(train, train, parameters)


def test_every_light_is_flown_by_every_method(record):
    errors = record.values["error_cm"]
    assert len(errors) == sum(len(shares) for shares in light.LIGHTS.values())
    for found in errors.values():
        assert set(found) == set(light.METHODS)
        assert all(0 < error["low"] <= error["value"] <= error["high"] for error in found.values())


def test_the_ratio_is_that_of_its_two_lights(record):
    errors = record.values["error_cm"]
    ratio = errors[light.JUDGED]["field"]["value"] / errors["drift 0"]["field"]["value"]
    assert record.values["ratio"]["field"] == ratio
    said = light.finding(record)
    assert said.count(" instead of ") == 2
    assert said.count("the same but for chance") == 2  # so few frames tell nothing apart
    apart = deepcopy(record)
    field = apart.values["error_cm"][light.JUDGED]["field"]
    field |= {key: 9 * errors["drift 0"]["field"]["high"] for key in ("low", "value", "high")}
    assert light.finding(apart).count("the same but for chance") == 1


def test_the_figure_shows_the_record(record):
    line, _, (bars,) = light.sweeps(record).axes[0].containers[0]
    errors = record.series["by_drift_cm"]["paper"]
    np.testing.assert_allclose(line.get_ydata(), [error["value"] for error in errors])
    ends = [[error["low"], error["high"]] for error in errors]
    np.testing.assert_allclose([bar[:, 1] for bar in bars.get_segments()], ends)


def test_the_table_names_every_light_once_in_percent(record):
    table = light.table(record)
    assert len(table) == len(record.values["error_cm"]) - 2 and table["light"].is_unique
    row = table[table["light"] == "gain drifts by 5 %"].iloc[0]
    assert row["field"] == distance(record.values["error_cm"]["drift 0.05"]["field"])
    row = table[table["light"] == "red +3 %, blue the other way"].iloc[0]
    assert row["paper"] == distance(record.values["error_cm"]["warmth 0.03"]["paper"])


def test_a_flight_without_floor_is_refused(train):
    from dataclasses import replace

    with pytest.raises(ParameterError, match="no picture of its floor"):
        light.run(replace(train, floor_file=None), train, light.Parameters())
