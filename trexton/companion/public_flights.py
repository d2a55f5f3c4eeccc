"""Public recordings become Flights without images: the authors' own (TU Delft CyberZoo, June 2016),
and walks with a Bluetooth beacon.
"""

import os
from pathlib import Path

import numpy as np

from trexton.flights.flight import Flight, area_around
from trexton.flights.importers.recording import NANO
from trexton.flights.importers.signals import Settings, read

PERIOD_S = 0.08  # Sec. Speed Versus Accuracy: the autopilot software received 12.5 images a second
# Frame 0 has no histogram, and the last row of the histogram table has no frame.
FIRST, LAST = 1, 624
PAUSE_S = 60.0  # between walks of the Bluetooth data, which were not recorded in this order

NOTES = (
    "The authors' program never cleared its histogram: each row carries a trace (1/n) of the row "
    "before, and rows sum to about 1.0002.",
    "Positions are taken as centimetres, as the authors did (6.1 m x 6.8 m were flown). Their "
    "logger wrote integers that the autopilot defines as 1/256 m, so 2.4 m x 2.7 m cannot be "
    "excluded: read errors relative to the area too.",
    "The source has no time stamps: 12.5 frames a second, as the paper states, are assumed.",
    "About 5000 random patches an image went into a histogram; the images and the texton "
    "dictionary were not published.",
)


def read_cyberzoo(
    histogram_file: str | os.PathLike[str], position_file: str | os.PathLike[str]
) -> Flight:
    """The real flight from its raw tables: ``(624, 20)`` histograms, positions in metres.

    Splits in time order: ``train`` 1-325 and ``test`` 326-624; mirrored, ``train_mirrored`` the
    last 325 and ``test_mirrored`` the rest.
    """
    histograms = np.loadtxt(histogram_file, delimiter=",")
    log = np.loadtxt(position_file, delimiter=",", skiprows=1)
    frame = np.arange(FIRST, LAST + 1)
    position = log[frame, 1:3] / 100
    mirrored = {"train_mirrored": (300, 624), "test_mirrored": (1, 299)}
    return Flight(
        name="cyberzoo",
        frame=frame,
        time=(frame - FIRST) * PERIOD_S,
        position=position,
        area=area_around(position),
        histograms=histograms[frame],
        split={"train": (1, 325), "test": (326, 624), **mirrored},
        source="https://github.com/Pold87/paparazzi_new (V. Strobel, R. Meertens, G.C.H.E. de "
        "Croon)",
        licence="GPL-2.0",
        notes=NOTES,
    )


def read_ble(*files: Path) -> Flight:
    """The public Bluetooth walks as one flight: those to train on, then the rectangular ones."""
    settings = Settings(columns="stamp,source,beacon,value,x,y,z,w0,w1,w2,w3,w4,w5,w6,w7,w8")
    clock, parts = 0.0, []
    for path in files:
        walk = read(path, settings)  # every one heard all receivers
        assert walk.track is not None and walk.histograms is not None  # as published
        time = (walk.time_ns - walk.time_ns[0]) / NANO + clock
        parts.append((time, walk.histograms, walk.track.position[:, :2]))
        clock = time[-1] + PAUSE_S
    time, values, places = (np.concatenate(column) for column in zip(*parts, strict=True))
    walks = zip(parts, files, strict=True)
    tested = sum(len(part[0]) for part, path in walks if "rect" in path.name)
    last = len(time) - 1
    return Flight(
        name="ble",
        frame=np.arange(len(time)),
        time=time,
        position=places,
        area=area_around(places),
        histograms=values,
        features="signals",
        split={"train": (0, last - tested), "test": (last - tested + 1, last)},
        source="https://github.com/philotuxo/Position-Annotated-BLE-RSSI-Dataset (F. S. Danis et "
        "al., Pervasive and Mobile Computing 81, 2022)",
        licence="CC0-1.0",
    )
