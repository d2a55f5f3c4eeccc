"""Parts that look at images themselves need the camera and its usual height. Offers both as learned
from a training flight, and checks on them."""

import numpy as np

from trexton.base.errors import FlightError, MapError
from trexton.flights.flight import Flight
from trexton.vision.camera import Camera

_FOCAL = 0.8  # image widths, where the camera is not known
_LONGEST = 100.0  # widths: a longer focal length is none, and a pixel so far off never found


def learned_lens(flight: Flight, advice: str) -> np.ndarray:
    """``(6,)`` width, height, focal length, principal point in pixels, usual height in metres.

    Raises `MapError`, with `advice`, where the flight lacks images, heights above the floor or its
    camera, and `FlightError` where the camera takes pictures of another size.
    """
    heights = np.empty(0) if flight.height is None else flight.height
    above = heights[np.isfinite(heights) & (heights > 0)]
    has = {
        "images": flight.has_images, "its camera": flight.camera is not None,
        "the camera's heights above the floor in metres": len(above) > 0,
    }  # fmt: skip
    lacking = [what for what, present in has.items() if not present]
    if lacking:
        raise MapError(
            f"flight {flight.name!r} lacks {' and '.join(lacking)}: add them to the flight, "
            f"or {advice}"
        )
    return lens_of(flight_camera(flight), float(np.median(above)))


def flight_camera(flight: Flight) -> Camera:
    """The camera of a flight, or a usual one; `FlightError` if it takes other images."""
    height, width = flight.image(0).shape[:2]
    camera = flight.camera or Camera(width, height, _FOCAL * width)
    if (camera.width, camera.height) != (width, height):
        raise FlightError(
            f"the images of flight {flight.name!r} are {width}x{height}, "
            f"its camera takes {camera.width}x{camera.height}: correct [camera] in flight.toml"
        )
    return camera


def lens_of(camera: Camera, usual: float) -> np.ndarray:
    """``(6,)``: a camera and its usual height as `learned_lens` gives them."""
    lens = (camera.width, camera.height, camera.focal, *camera.principal_point, usual)
    return np.array(lens, dtype=float)


def check_lens(lens: np.ndarray, what: str) -> None:
    """Raise `MapError` for numbers that no `learned_lens` gives."""
    if lens.shape != (6,) or not (
        np.isfinite(lens).all()
        and (lens[[0, 1, 2, 5]] > 0).all()
        and 1 / _LONGEST < lens[2] / lens[0] < _LONGEST
        and (np.abs(lens[3:5]) < _LONGEST * lens[:2]).all()
    ):
        raise MapError(
            f"{what} camera is {lens.tolist()}: expected its width, height, "
            "focal length, principal point and usual height, train the map again"
        )


def camera_of(lens: np.ndarray) -> tuple[Camera, float]:
    """The camera, and its usual height in metres."""
    width, height, focal, *center, usual = lens.tolist()
    return Camera(int(width), int(height), focal, (center[0], center[1])), usual
