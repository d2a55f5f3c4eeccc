"""trexton: texton-based global localization for micro aerial vehicles.

A flight becomes a map, a map and a frame become a position.

Names are imported on first use, so that ``import trexton`` costs next to nothing.
"""

import os
from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# OpenCV reads these once, when it is loaded: no picture may declare more pixels than a camera has
# (every format), and what it would print about a damaged one is said by an error of ours.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "50000000")
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")

_EXPORTS = {
    "Flight": "trexton.flights",
    "read_flight": "trexton.flights",
    "write_flight": "trexton.flights",
    "TextonDictionary": "trexton.vision.textons",
    "texton_histogram": "trexton.vision.histograms",
    "sampled_histogram": "trexton.vision.histograms",
    "NearestHistograms": "trexton.localization.neighbors",
    "ParticleFilter": "trexton.localization.filters",
    "TextonMap": "trexton.localization.texton_map",
    "train_map": "trexton.localization.training",
    "load_map": "trexton.localization.map_files",
    "save_map": "trexton.localization.map_files",
    "Localizer": "trexton.localization.localizer",
    "Estimate": "trexton.localization.estimate",
    "TrextonError": "trexton.base.errors",
}

__all__ = ["__version__", *_EXPORTS]


def __getattr__(name: str) -> Any:
    if name in _EXPORTS:
        return getattr(import_module(_EXPORTS[name]), name)
    raise AttributeError(f"module 'trexton' has no attribute {name!r}")
