"""Method `fine` as a filter: it compares the frame itself with a picture of the floor. Offers
`Registration`, which is trained, and what runs in flight."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from trexton.base.errors import MapError
from trexton.base.options import option
from trexton.localization.base import Area, learned
from trexton.localization.estimate import Estimate, Measurement, nowhere
from trexton.localization.filters import Filter
from trexton.localization.lens import camera_of, check_lens, flight_camera, learned_lens, lens_of
from trexton.localization.observation import Observation
from trexton.localization.training_set import Training
from trexton.registration.ground import Ground, fine_cell
from trexton.registration.tracker import FloorTracker
from trexton.registration.trust import PHOTOGRAPHS_S, FloorFix, Trust, learn_trust
from trexton.vision.camera import MapImage, wrapped

if TYPE_CHECKING:
    from trexton.flights.flight import Flight
    from trexton.localization.texton_map import TextonMap

_LEARN = 250  # training frames, at most, that trust is learned from
_RECENT = 4  # fixes in a row that a velocity is taken from
_BENDS = 0.5  # m/s^2: what a vehicle accelerates meanwhile, one standard deviation along an axis


@dataclass(eq=False)
class Registration(Filter):
    """Finds each frame on a picture of the floor."""

    knows_velocity: ClassVar[bool] = True
    knows_heading: ClassVar[bool] = True
    attitude_sigma: float = option(
        0.007, "standard deviation of the autopilot's attitude, radians, if it comes", above=0
    )
    height_sigma: float = option(
        0.02, "standard deviation of the autopilot's height, metres, if it comes", above=0
    )
    floor: Any = learned()  # (H, W) uint8 luma, north up
    mapped: Any = learned()  # (H, W) uint8, 1 where the floor is mapped
    place: Any = learned()  # x, y of the top left cell's centre, side of a cell
    # Width, height, focal length, principal point, usual height above the floor.
    camera: Any = learned()
    trust: Any = learned()  # the fields of `Trust`

    def prepare(self) -> None:
        check_lens(self.camera, "the picture's")
        if self.floor.ndim != 2 or self.floor.shape != self.mapped.shape:
            raise MapError(
                f"a floor of shape {self.floor.shape}, its mask {self.mapped.shape}: expected "
                "(H, W) twice, train the map again"
            )

    def fit(self, training: Training) -> Self:
        """Take or stitch the picture of the floor, and learn from the frames how far to trust it.

        Raises
        ------
        MapError
            There are no frames, or the camera or its height are not known.
        """
        flight = training.flight
        if flight is None:
            raise MapError(
                "method fine learns from the frames of a flight: choose it when training, as in "
                "trexton train FLIGHT --method fine"
            )
        if not flight.has_images:
            raise MapError(
                "method fine needs images, and this flight has none: train on one with images"
            )
        picture, lens = _surroundings(flight)
        camera, height = camera_of(lens)
        ground = Ground.from_map(picture, fine_cell(camera, height))
        fitted = self.with_learned(
            floor=np.clip(np.rint(ground.luma), 0, 255).astype(np.uint8),
            mapped=ground.mask.astype(np.uint8),
            place=np.array([*ground.corner, ground.cell]),
            camera=lens,
            trust=np.array(astuple(Trust())),
        )
        fixes = fitted._try(flight, training)
        trust = learn_trust(fixes, training.positions[: len(fixes)], height, Trust())
        return fitted.with_learned(trust=np.array(astuple(trust)))

    def _try(self, flight: Flight, training: Training) -> list[FloorFix]:
        """Fixes of the first frames, attitude as noisy as it will be in flight, if it is known."""
        tracker, fixes = self.tracker(training.period_s), []
        for row in range(min(_LEARN, len(flight))):
            attitude = None
            if flight.attitude is not None and np.isfinite(flight.attitude[row]).all():
                noise = self.attitude_sigma * training.rng.standard_normal(3)
                attitude = flight.attitude[row] + noise
            fixes.append(tracker.step(flight.image(row), attitude=attitude))
        return fixes

    def tracker(self, period_s: float) -> FloorTracker:
        """A tracker on the learned picture, for frames so far apart, which knows nothing yet."""
        x, y, cell = self.place
        world = np.array([[cell, 0, x], [0, -cell, y], [0, 0, 1]])
        camera, above = camera_of(self.camera)
        return FloorTracker(
            MapImage(self.floor, world, self.mapped > 0),
            camera,
            above,
            trust=Trust(*self.trust.tolist()),
            attitude_sigma=self.attitude_sigma,
            height_sigma=self.height_sigma,
            alone=period_s >= PHOTOGRAPHS_S,
        )

    def open(
        self, parts: Mapping[str, Any], texton_map: TextonMap, rng: np.random.Generator
    ) -> RunningRegistration:
        if self.floor is None:
            raise MapError("method fine has no picture of the floor: train the map for it")
        return RunningRegistration(
            self.tracker(texton_map.period_s), texton_map.area, texton_map.period_s
        )


class RunningRegistration:
    """A `FloorTracker` in flight.

    Parameters
    ----------
    area : (x_min, x_max, y_min, y_max)
        Its middle is the estimate as long as nothing was seen.
    period_s : float
        From frame to frame, where frames bear no stamps.
    """

    def __init__(self, tracker: FloorTracker, area: Area, period_s: float):
        self.tracker, self._period_s = tracker, period_s
        self._time = 0.0
        self._recent: deque[tuple[float, np.ndarray]] = deque(maxlen=_RECENT)  # when, and where
        self._area = area
        self._fix: FloorFix | None = None

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self.tracker.reset()
        self._fix = None
        self._recent.clear()

    def step(self, observation: Observation | None) -> FloorFix:
        """Advance one frame; None where nothing was observed."""
        stamp = None
        if observation is None:
            self._fix = fix = self.tracker.step(None)
        elif observation.frame is None:
            raise MapError("method fine needs images, and was given a histogram: give frames")
        else:
            aiding, stamp = observation.aiding, observation.time
            self._fix = fix = self.tracker.step(
                observation.frame,
                # None is NaN here: not known
                attitude=np.array([aiding.roll, aiding.pitch, aiding.yaw], dtype=float),
                height=aiding.height,
            )
        self._time = self._time + self._period_s if stamp is None else stamp
        if fix.lost:
            self._recent.clear()
        elif fix.observed:
            self._recent.append((self._time, fix.position))
        return fix

    def estimate(self) -> Estimate:
        """The latest fix; it is a measurement for others unless the vehicle is lost."""
        fix = self._fix
        if fix is None or not np.isfinite(fix.position).all():
            return nowhere(self._area)
        own = Measurement(fix.position, fix.covariance) if fix.observed and not fix.lost else None
        velocity, joint = self._motion(fix.covariance)
        seen = np.isfinite(fix.heading_sigma)
        return Estimate(
            fix.position, fix.covariance, lost=fix.lost, observed=fix.observed, measurement=own,
            velocity=velocity, joint=joint, tilt_bias=self.tracker.tilt_bias,
            heading=float(wrapped(fix.pose[5])) if seen else None,
            heading_sigma=fix.heading_sigma if seen else None,
        )  # fmt: skip

    def _motion(self, covariance: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Velocity, by a line through the latest fixes, and the covariance of both."""
        if len(self._recent) < _RECENT or self._recent[-1][0] < self._time:
            return None, None
        times, places = (np.array(column) for column in zip(*self._recent, strict=True))
        ages = times - times.mean()
        if ages[-1] <= 0:
            return None, None
        slope = ages / (ages @ ages)
        # The line's velocity is that of its middle.
        of_velocity = (slope @ slope) * covariance + (_BENDS * ages[-1]) ** 2 * np.eye(2)
        shared = slope[-1] * covariance
        return slope @ places, np.block([[covariance, shared], [shared, of_velocity]])


def _surroundings(flight: Flight) -> tuple[MapImage, np.ndarray]:
    """The flight's picture of the floor, or a mosaic of its frames where it has none; the camera
    and its usual height, see `learned_lens`.
    """
    if flight.floor is not None:
        return flight.floor, learned_lens(flight, "stitch the picture")
    from trexton.registration.mosaic import stitch  # SciPy: on the ground only

    mosaic = stitch(flight)
    if mosaic.doubt:
        raise MapError(
            f"the mosaic of flight {flight.name!r} is not to be trusted: {mosaic.doubt}; train on "
            "frames that overlap more, give a picture of the floor, or choose method field"
        )
    height = float(np.median(mosaic.poses[mosaic.used, 2]))
    return mosaic.map, lens_of(flight_camera(flight), height)
