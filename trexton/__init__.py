"""trexton: texton-based global localization for micro aerial vehicles.

A flight becomes a map, a map and a frame become a position.

Names are imported on first use, so that ``import trexton`` costs next to nothing.
"""

import os
from importlib import import_module
from typing import Any

__version__ = "1.0.0"

# OpenCV reads these once, when it is loaded: no picture may declare more pixels than a camera has
# (every format), and what it would print about a damaged one is said by an error of ours.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "50000000")
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")

# The declared interface, at most 40 names: a minor release keeps them and what they take and give.
_EXPORTS = {
    "Flight": "trexton.flights.flight",
    "read_flight": "trexton.flights.folder",
    "write_flight": "trexton.flights.writing",
    "import_flight": "trexton.flights.importing",
    "Aiding": "trexton.flights.aiding",
    "Camera": "trexton.vision.camera",
    "TextonDictionary": "trexton.vision.textons",
    "texton_histogram": "trexton.vision.histograms",
    "sampled_histogram": "trexton.vision.histograms",
    "TextonMap": "trexton.localization.texton_map",
    "train_map": "trexton.localization.training",
    "with_choices": "trexton.localization.training",
    "load_map": "trexton.localization.map_files",
    "save_map": "trexton.localization.map_files",
    "Localizer": "trexton.localization.localizer",
    "Estimate": "trexton.localization.estimate",
    "Measurement": "trexton.localization.estimate",
    "NearestHistograms": "trexton.localization.neighbors",
    "ParticleFilter": "trexton.localization.filters",
    "LandingZone": "trexton.localization.landing",
    "TouchdownZone": "trexton.localization.landing",
    # What one adds to a method, to the onboard script, to the book.
    "Options": "trexton.base.options",
    "option": "trexton.base.options",
    "Part": "trexton.localization.base",
    "Training": "trexton.localization.training_set",
    "learned": "trexton.localization.base",
    "Distance": "trexton.localization.neighbors",
    "MotionModel": "trexton.localization.motion",
    "MeasurementModel": "trexton.localization.measurement",
    "Filter": "trexton.localization.filters",
    "Resampling": "trexton.localization.particle_parts",
    "Estimation": "trexton.localization.particle_parts",
    "Recovery": "trexton.localization.particle_parts",
    "Sink": "trexton.onboard.sinks",
    "Source": "trexton.onboard.sources",
    "Frame": "trexton.onboard.sources",
    "Fix": "trexton.onboard.fix",
    "TrextonError": "trexton.base.errors",
}

__all__ = ["__version__", *_EXPORTS]


def __getattr__(name: str) -> Any:
    if name in _EXPORTS:
        return getattr(import_module(_EXPORTS[name]), name)
    raise AttributeError(f"module 'trexton' has no attribute {name!r}")
