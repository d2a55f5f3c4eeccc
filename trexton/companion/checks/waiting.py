"""What a person waits for at a command line, and what learning takes where the frames are counted.

Offers `answers` and `learning`, stages of `trexton.companion.checks.bench`, against decoding the
images of the flight once.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from trexton.base.streams import stream
from trexton.companion.checks.timing import Contest, Scene
from trexton.companion.executor import environment
from trexton.flights.check import check_flight
from trexton.localization.localizer import TextonMap
from trexton.localization.training import with_parts
from trexton.simulator.recording import record_flight

# Limits in seconds were asked where decoding took 2.2 s.
_MANY = 100_000  # frames
_PATCHES = 20_000  # that are drawn for the histogram of a frame that is made up


def learning(scene: Scene) -> Iterator[Contest]:
    """Method field, of histograms of the flight and of many times as many."""
    own = scene.map("field")
    for texton_map, limit in ((own, 0.45), (_repeated(own, _MANY, scene.seed), 4.5)):
        learn = partial(
            with_parts, texton_map, {role: part.untrained() for role, part in own.parts.items()}
        )
        yield scene.contest("learn field", learn, limit, len(texton_map.time), rounds=1)


def _repeated(texton_map: TextonMap, count: int, seed: int) -> TextonMap:
    """A map of so many frames: those of this one again and again, near by and counted anew."""
    rng, known = stream(seed, "repeated frames"), len(texton_map.time)
    turns, rows = np.divmod(np.arange(count), known)
    last_s = texton_map.time[-1] - texton_map.time[0] + texton_map.period_s
    return replace(
        texton_map,
        histograms=rng.multinomial(_PATCHES, texton_map.histograms[rows]) / _PATCHES,
        positions=texton_map.positions[rows] + 0.05 * rng.standard_normal((count, 2)),
        time=texton_map.time[rows] + turns * last_s,
    )


def answers(scene: Scene) -> Iterator[Contest]:
    """What a report and a floor's suitability say first, and all; and the check of a flight."""
    floor, test = scene.flight.floor, scene.folder / "test"
    assert floor is not None  # the simulator knows it
    record_flight(test, pattern="waypoints", frames=scene.frames // 2, seed=scene.seed)
    picture = scene.folder / "floor.png"
    cv2.imwrite(str(picture), floor.image)
    x_min, x_max, _, _ = scene.flight.area
    report = ["report", str(scene.folder / "flight"), "--test-flight", str(test)]
    suitability = ["suitability", str(picture), "--width", str(x_max - x_min)]
    for words, first, whole in ((report, 7.0, 15.0), (suitability, 1.4, 4.5)):
        for what, limit in (("first number", first), ("whole", whole)):
            ask = partial(_ask, words, alone=what != "whole")
            yield scene.contest(f"{words[0]}, {what}", ask, limit, threads=2, rounds=1)
    again = partial(_ask, report, alone=False, folder=str(scene.folder / "made"))
    again()
    yield scene.contest("report, nothing changed", again, 1.8, threads=2, rounds=1)
    check = partial(check_flight, scene.folder / "flight")
    yield scene.contest("check", check, 1.4, threads=2, rounds=3)


def _ask(words: list[str], alone: bool, folder: str = "") -> None:
    """Run the command to its end or first number; of runs before, a `folder` may keep something."""
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as fresh,
        environment({"TREXTON_CACHE": folder or fresh}),
    ):
        command = [sys.executable, "-m", "trexton", *words, "--out", f"{folder or fresh}/out"]
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        with subprocess.Popen(command, text=True, **streams) as run:  # type: ignore[call-overload]
            said = []
            for line in run.stdout:
                said.append(line)
                if alone and " cm" in line:
                    run.kill()
                    return
    if run.returncode or alone:
        raise subprocess.CalledProcessError(run.returncode, command, stderr="".join(said))
