"""Fly a recorded flight once more, and play what every step saw in one page without other hosts.

Offers `replay` of an experiment, `record_replay` of a localizer, and the page, `player_html`.
"""

import base64
import json
from collections.abc import Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import asdict, dataclass, field
from importlib.resources import files
from typing import Any

import cv2
import jinja2
import numpy as np

from trexton.base.errors import MapError
from trexton.base.streams import stream
from trexton.companion import player
from trexton.companion.experiments.declaration import MapParameters
from trexton.companion.experiments.evaluation import flown, frames_of, map_of
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.vision.camera import MapImage
from trexton.vision.images import bgr_from_yuv, sample_positions

_WIDTH = 200  # pixels of a frame on the page
_FLOOR_WIDTH = 420
_QUALITY = 38
_MOST_PATCHES = 250  # sampled patches drawn; more the eye cannot tell apart


@dataclass(frozen=True)
class PlayedFlight:
    """What a player shows.

    Attributes
    ----------
    flight : str
    area : (x_min, x_max, y_min, y_max), metres
    frames : list of dict
        One a shown frame: ``frame``, ``time_s``, ``truth_cm``, ``histogram`` (per mille),
        ``neighbors_cm``, ``particles_cm``, ``spread_cm``, ``estimates_cm`` by name, ``errors_cm``
        by name (to a tenth below 10), ``image`` (a data URI) and ``patches`` (left, top in
        thousandths of the image).
        What a flight or a method does not have is None.
    floor : dict or None
        ``image``, a data URI, and ``extent_m`` (left, right, bottom, top).
    """

    flight: str
    area: tuple[float, float, float, float]
    frames: list[dict[str, Any]] = field(default_factory=list)
    floor: dict[str, Any] | None = None


def replay(train: Flight, test: Flight, parameters: MapParameters) -> PlayedFlight:
    """What the first run of the experiment sees and draws, beside every method that can learn here.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms. `fine` is shown where the flight has a picture of its
        floor, and the camera and its height, with which frames are laid on it.
    parameters : MapParameters
        The map's, and the seed.
    """
    rng, texton_map = stream(parameters.seed, "flight", 0), map_of(train, parameters)
    counts: dict[str, Any] = {"samples": parameters.samples, "particles": parameters.particles}
    localizer = Localizer(texton_map, rng=rng, **counts)  # run 0, which every page quotes
    known = (train.floor, train.camera, train.height)
    laid = test.has_images and all(each is not None for each in known)
    others = {}
    for method in ("field", "fine") if laid else ("field",):
        with suppress(MapError):  # too short a flight, for one; the paper's method learns from any
            others[method] = flown(train, test, parameters, method, repeats=1)[0].position
    return record_replay(localizer, test, others)


def record_replay(
    localizer: Localizer,
    flight: Flight,
    others: Mapping[str, np.ndarray],
    *,
    most_frames: int = 180,
) -> PlayedFlight:
    """Step the localizer of the paper's filter through all frames of `flight`, and keep a part of
    them evenly.

    Parameters
    ----------
    others : mapping of str to (N, 2) array
        What other methods estimated, beside it and the plain mean of its neighbours.
    most_frames : int
        Frames to keep at most; the localizer sees all of them.

    Raises
    ------
    ImageError, MapError
        The flight does not fit the map.
    """
    every = -(-len(flight) // most_frames)
    kept = []
    for row, frame in enumerate(flight.images() if flight.has_images else frames_of(flight)):
        before = deepcopy(localizer.rng)
        estimate = localizer.step(frame, time=float(flight.time[row]))
        if row % every:
            continue
        estimates = {"the paper's filter": estimate.position}
        if estimate.neighbors is not None:
            estimates["neighbours alone"] = estimate.neighbors.position.mean(axis=0)
        estimates |= {name: each[row] for name, each in others.items()}
        truth = flight.position[row]
        neighbors, counts = estimate.neighbors, estimate.histogram
        shares = None if counts is None else np.rint(1000 * counts).astype(int).tolist()
        # A method that compares images counts no patches.
        counted = flight.has_images and counts is not None
        kept.append(
            {
                "frame": int(flight.frame[row]),
                "time_s": round(float(flight.time[row] - flight.time[0]), 2),
                "truth_cm": _cm(truth),
                "histogram": shares,
                "neighbors_cm": None if neighbors is None else _cm(neighbors.position),
                "particles_cm": _cm(estimate.particles),
                "spread_cm": _cm(estimate.spread),
                "estimates_cm": {name: _cm(place) for name, place in estimates.items()},
                "errors_cm": {name: _error_cm(place - truth) for name, place in estimates.items()},
                "image": _uri(bgr_from_yuv(frame), _WIDTH) if flight.has_images else None,
                "patches": _patches(localizer, frame, before) if counted else None,
            }
        )
    return PlayedFlight(
        flight.name, flight.area, kept, None if flight.floor is None else _floor(flight.floor)
    )


def _cm(metres: Any) -> Any:
    """Whole centimetres, nested as they were; None where there is no position."""
    values = np.asarray(metres, dtype=float)  # None is NaN
    if np.isnan(values).all():
        return None
    return [_cm(each) for each in values] if values.ndim else round(100 * float(values))


def _error_cm(apart: np.ndarray) -> int | float | None:
    """As far off as two digits tell: below 10 cm to a tenth."""
    error = 100 * float(np.hypot(*apart))
    if np.isnan(error):
        return None
    return round(error) if error >= 10 else round(error, 1)


def _patches(
    localizer: Localizer, frame: np.ndarray, rng: np.random.Generator
) -> list[list[int]] | None:
    """Where the step sampled: drawn again from the generator as it was before the step."""
    dictionary = localizer.map.dictionary
    if localizer.samples is None or dictionary is None:
        return None
    drawn = sample_positions(frame.shape, dictionary.patch, localizer.samples, rng)
    share = 1000 * drawn[:_MOST_PATCHES, ::-1] / np.array([frame.shape[1], frame.shape[0]])
    return [[int(x), int(y)] for x, y in share]


def _floor(floor: MapImage) -> dict[str, Any]:
    """A picture of a floor turned north up, transparent where it shows nothing."""
    rows, columns = floor.image.shape[:2]
    (left, bottom), (right, top) = floor.corners.min(axis=0), floor.corners.max(axis=0)
    scale = max(rows, columns) / max(right - left, top - bottom)
    size = tuple(max(1, round(scale * each)) for each in (right - left, top - bottom))
    place = np.array([[scale, 0, -scale * left - 0.5], [0, -scale, scale * top - 0.5], [0, 0, 1]])
    shown = cv2.cvtColor(floor.image, cv2.COLOR_BGR2BGRA)
    if floor.mask is not None:
        shown[..., 3] = 255 * (floor.mask > 0)
    picture = cv2.warpPerspective(shown, place @ floor.world_from_pixel, size)
    extent = [round(float(each), 3) for each in (left, right, bottom, top)]
    return {"image": _uri(picture, _FLOOR_WIDTH), "extent_m": extent}


def _uri(picture: np.ndarray, width: int) -> str:
    """A copy of the picture, so many pixels wide, as a data URI."""
    height = max(1, round(picture.shape[0] * width / picture.shape[1]))
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    coded = cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])[1]
    return "data:image/webp;base64," + base64.b64encode(coded.tobytes()).decode()


def player_html(recording: PlayedFlight, title: str = "") -> str:
    """The page that plays `recording`, with its data, its style and its script; `title` in place of
    the flight's name.
    """
    data = json.dumps(asdict(recording), separators=(",", ":")).replace("<", "\\u003c")
    style, script, page = (
        (files(player) / f"player.{kind}").read_text("utf-8") for kind in ("css", "js", "html")
    )
    template = jinja2.Environment(autoescape=True, keep_trailing_newline=True).from_string(page)
    return template.render(title=title or recording.flight, style=style, data=data, script=script)
