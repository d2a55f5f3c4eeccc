"""Camera calibrations are read here. They are an ASL ``sensor.yaml``, what OpenCV's calibration
writes (YAML, JSON), or Kalibr's ``camchain.yaml``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.files import read_text
from trexton.base.pictures import MOST_PIXELS
from trexton.vision.camera import COEFFICIENTS, Camera

# OpenCV may add every point it saw. What may open a level is counted: parsers call themselves for
# each, and may overflow the stack.
MOST_CHARACTERS = 2**17
# What the radial and tangential model is called; a fisheye's coefficients mean something else.
_RADIAL = ("radial-tangential", "radtan", "plumb_bob", "rational_polynomial")
OPENING, MOST_OPENINGS = "[{<:-?", 10_000


def read_calibration(path: Path, camera_name: str = "cam0") -> tuple[Camera, np.ndarray | None]:
    """The camera and its distortion coefficients (None where all are zero); `camera_name` is that
    of one in a chain of Kalibr's. Raises `FlightError` where the file is of neither kind, far
    longer or deeper than a calibration, or of no camera.
    """
    text = read_text(path)
    try:
        if len(text) > MOST_CHARACTERS or sum(map(text.count, OPENING)) > MOST_OPENINGS:
            raise ValueError("too long or too deep for one")
        camera, distortion = _described(_yaml(text), camera_name)
        if camera.width * camera.height > MOST_PIXELS or not np.isfinite(distortion).all():
            limits = f"1 to {MOST_PIXELS:,} pixels and finite numbers"
            raise ParameterError(f"expected a picture of {limits}")
        if distortion.any() and len(distortion) not in COEFFICIENTS:
            taken = ", ".join(map(str, COEFFICIENTS[1:]))
            raise ParameterError(f"{len(distortion)} distortion coefficients: OpenCV takes {taken}")
    except ParameterError as error:  # a calibration, but of no camera
        raise FlightError(f"{path}: {error}: correct it") from None
    except (
        ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError,
    ) as error:  # fmt: skip
        why = " ".join(str(error).split())[:200]
        found = f"no calibration of OpenCV (YAML or JSON), ASL or Kalibr ({why})"
        raise FlightError(f"{path}: {found}: correct it") from None
    return camera, distortion if distortion.any() else None


def _described(content: Mapping[str, Any], camera_name: str) -> tuple[Camera, np.ndarray]:
    if "camera_matrix" in content:
        (fx, _, cx), (_, fy, cy), _ = _matrix(content["camera_matrix"])
        width, height = int(content["image_width"]), int(content["image_height"])
        distortion = _matrix(content["distortion_coefficients"]).ravel() * _radial(content)
        return Camera(width, height, float(fx + fy) / 2, (float(cx), float(cy))), distortion
    if "cam0" in content or camera_name in content:  # Kalibr's, in the words of ASL
        content = content[camera_name]
        content = {"distortion_coefficients": content.get("distortion_coeffs", []), **content}
    width, height = (int(value) for value in content["resolution"])
    fx, fy, cx, cy = (float(value) for value in content["intrinsics"][-4:])
    given = content.get("distortion_coefficients", []) if _radial(content) else []
    distortion = np.array(given, dtype=float).ravel()
    return Camera(width, height, (fx + fy) / 2, (cx, cy)), distortion


def _radial(content: Mapping[str, Any]) -> bool:
    """Whether a lens distorts as OpenCV's does; a fisheye, and other models, do otherwise."""
    pinhole = content.get("camera_model", "pinhole") == "pinhole"
    known = content.get("distortion_model", _RADIAL[0]) in _RADIAL
    return pinhole and known and not content.get("fisheye_model")


def _matrix(node: Mapping[str, Any]) -> np.ndarray:
    return np.array(node["data"], dtype=float).reshape(int(node["rows"]), int(node["cols"]))


def _yaml(text: str) -> Mapping[str, Any]:
    """What YAML or JSON says, with OpenCV's matrices as mappings."""
    import yaml

    class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        pass

    Loader.add_multi_constructor(
        "tag:yaml.org,2002:opencv", lambda loader, _, node: loader.construct_mapping(node, True)
    )
    lines = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    try:
        # A few that name one another stand for billions of values.
        if any(isinstance(token, yaml.AliasToken) for token in yaml.scan(lines, Loader)):
            raise ValueError("an alias in it")
        return Loader(lines).get_single_data()  # safe, with OpenCV's tags: it makes no objects
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None
