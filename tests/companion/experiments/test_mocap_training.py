"""The main experiment: the real flight's known figures, the simulated line end to end, equal bytes
from equal seeds.
"""

import json
import os
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trexton.companion.experiments import mocap_training

SCRIPT = """
import sys
from trexton.companion.experiments import mocap_training
from trexton.vision.camera import Camera
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight

folder = sys.argv[1]
room = {"floor": Floor.from_file(sys.argv[2], 3.0), "camera": Camera(160, 120, 130.0)}
train = record_flight(folder + "/train", frames=24, every=8, seed=3, **room)
test = record_flight(folder + "/test", frames=6, every=4, pattern="waypoints", **room)
parameters = mocap_training.Parameters(
    samples=50, textons=6, particles=20, neighbors=2, repeats=2
)
mocap_training.run(train, test, parameters).save(folder + "/results")
"""


@pytest.fixture(scope="module")
def real(cyberzoo):
    return mocap_training.run(
        cyberzoo.part("train"), cyberzoo.part("test"), mocap_training.Parameters(repeats=1)
    )


def mean_cm(record, what, axis):
    return record.values[what][f"error_cm_{axis}"]["value"]


def test_the_real_flight_gives_the_known_knn_errors(real, cyberzoo):
    record = real
    assert mean_cm(record, "knn", "x") == pytest.approx(18, abs=2)
    assert mean_cm(record, "knn", "y") == pytest.approx(26, abs=2)
    assert record.values["counts"]["train"] == 325 and record.values["counts"]["test"] == 299
    # Both parts are of one flight, so they are exchanged too.
    exchanged = record.values["exchanged"]["knn"]["mean_cm"]["value"]
    back = mocap_training.run(
        cyberzoo.part("test"), cyberzoo.part("train"), mocap_training.Parameters(repeats=1)
    )
    assert back.values["knn"]["mean_cm"]["value"] == exchanged
    assert 0 < record.values["spread"]["within_one"] < 1 and record.values["lag"]["s"] > 0
    # Plain k-NN, written out, gives the same.
    train, test = cyberzoo.part("train"), cyberzoo.part("test")
    distance = np.linalg.norm(test.histograms[:, None] - train.histograms[None], axis=2)
    mean = train.position[np.argsort(distance, axis=1, kind="stable")[:, :5]].mean(axis=1)
    np.testing.assert_allclose(record.series["knn_m"], mean, atol=1e-9)


def test_the_mirrored_split_is_no_accident(cyberzoo):
    train, test = cyberzoo.part("train_mirrored"), cyberzoo.part("test_mirrored")
    record = mocap_training.run(train, test, mocap_training.Parameters(repeats=1))
    for axis in "xy":
        assert mean_cm(record, "knn", axis) < 0.5 * mean_cm(record, "shuffled_neighbors", axis)


def test_equal_seeds_give_equal_bytes_under_any_hash_seed_and_threads(tmp_path):
    contents, floor = [], tmp_path / "floor.png"
    coarse = np.random.default_rng(4).integers(0, 256, (12, 12, 3), dtype=np.uint8)
    cv2.imwrite(str(floor), cv2.resize(coarse, (480, 480), interpolation=cv2.INTER_CUBIC))
    for hash_seed, threads in (("1", "1"), ("2", "2")):
        folder = tmp_path / hash_seed
        settings = {
            "PYTHONHASHSEED": hash_seed,
            "OMP_NUM_THREADS": threads,
            "NUMBA_NUM_THREADS": threads,
        }
        environment = os.environ | settings | {"TREXTON_CACHE": str(folder / "cache")}
        subprocess.run([sys.executable, "-c", SCRIPT, folder, floor], env=environment, check=True)
        record = json.loads((folder / "results" / "mocap_training.json").read_text())
        record.pop("timings")
        contents.append(json.dumps(record))
    assert contents[0] == contents[1]


def test_figures_draw_the_records_numbers(real):
    record = real
    plan = mocap_training.floor_plan(record).axes[0]
    drawn = {line.get_label(): line.get_xydata() for line in plan.lines}
    np.testing.assert_array_equal(drawn["true track"], record.series["truth_m"])
    np.testing.assert_array_equal(
        drawn["estimate (every 5th frame)"], record.series["estimate_m"][::5]
    )


def test_a_large_error_reads_in_metres(real):
    large = {"value": 5619.0, "low": 5000.0, "high": 6000.0}
    values = real.values | {"filter": real.values["filter"] | {"mean_cm": large}}
    said = mocap_training.finding(replace(real, values=values))
    assert "an error of 56.2 [50, 60] m" in said and "cm" not in said
    assert " cm, " in mocap_training.finding(real)
