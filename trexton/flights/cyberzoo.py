"""The authors' own flight (TU Delft CyberZoo, June 2016). Two tables become a Flight."""

from __future__ import annotations

import os

import numpy as np

from trexton.flights.flight import Flight, area_around

PERIOD_S = 0.08  # Sec. Speed Versus Accuracy: the autopilot software received 12.5 images a second
# Frame 0 has no histogram, and the last row of the histogram table has no frame.
FIRST, LAST = 1, 624

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
    return Flight(
        name="cyberzoo",
        frame=frame,
        time=(frame - FIRST) * PERIOD_S,
        position=position,
        area=area_around(position),
        histograms=histograms[frame],
        split={
            "train": (1, 325), "test": (326, 624),
            "train_mirrored": (300, 624), "test_mirrored": (1, 299),
        },
        source="https://github.com/Pold87/paparazzi_new (V. Strobel, R. Meertens, G.C.H.E. de "
        "Croon)",
        licence="GPL-2.0",
        notes=NOTES,
    )  # fmt: skip
