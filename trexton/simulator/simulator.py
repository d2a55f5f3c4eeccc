"""The virtual room, live. Offers `Simulator`: a vehicle over a floor, and what its camera sees."""

from dataclasses import replace

import cv2
import numpy as np

from trexton.simulator.floor import Floor, Light
from trexton.simulator.sensor import Effects, Sensor
from trexton.simulator.vehicle import Vehicle, VehicleState
from trexton.vision.camera import Camera, transform_points

PERIOD = 0.08  # seconds between frames: the 12.5 Hz of the paper's camera
# Of the motion capture, in metres and radians.
TRUTH_NOISE = np.array([0.001, 0.001, 0.001, 0.002, 0.002, 0.002])
# pixels between the nodes at which the geometry is computed; between them it is linear to 0.02 px
_NODE = 8
_EXPOSURE_TIME = 3.0  # seconds over which the camera's gain changes

Moment = tuple[VehicleState, float, tuple[int, int]]  # with the gain, and part of the noise


class Simulator:
    """A camera on a vehicle over a floor.

    Parameters
    ----------
    floor : Floor or None
        None is the painted hall.
    camera, effects, light : Camera, Effects, Light
        The lens, what sensor and flight do to its pictures, and what shines on the floor.
    start : (2,) array or None
        First position in metres; the floor's middle unless given.
    height, speed : float
        See `Vehicle`.
    rng : numpy.random.Generator
        Flight, camera and motion capture each get a stream of it: looking changes nothing.
    """

    def __init__(
        self,
        floor: Floor | None = None,
        *,
        camera: Camera = Camera(),
        effects: Effects = Effects(),
        light: Light = Light(),
        start: np.ndarray | None = None,
        height: float = 1.0,
        speed: float = 0.5,
        rng: np.random.Generator,
    ):
        self.floor = Floor.painted() if floor is None else floor
        self.camera, self.effects = camera, effects
        flight_rng, sensor_rng, self._camera_rng, self._truth_rng = rng.spawn(4)
        middle = np.reshape(self.floor.area, (2, 2)).mean(axis=1)
        self.vehicle = Vehicle(
            middle if start is None else start,
            height=height,
            speed=speed,
            height_ripple=effects.height_ripple,
            yaw=effects.yaw,
            rng=flight_rng,
        )
        self._texture = self.floor.texture(light)
        self._sensor = Sensor(camera, effects, sensor_rng)
        self._nodes = _node_grid(camera)
        self._gain = 1.0 + effects.exposure * self._camera_rng.standard_normal()
        self._offset = Sensor.draw_offset(self._camera_rng)

    @property
    def state(self) -> VehicleState:
        """The camera's true state: the vehicle's, or level where the effects keep it level."""
        state, tilt = self.vehicle.state, self.effects.roll_pitch
        share = np.array([tilt, tilt, 1.0])
        return replace(state, attitude=state.attitude * share, rates=state.rates * share)

    def step(self, goal: np.ndarray | None = None) -> VehicleState:
        """The true state after a frame period towards `goal` (None: brake and hover)."""
        self.vehicle.advance(PERIOD, goal)
        fading = np.exp(-PERIOD / _EXPOSURE_TIME)
        kick = self.effects.exposure * np.sqrt(1 - fading**2) * self._camera_rng.standard_normal()
        self._gain = 1 + fading * (self._gain - 1) + kick
        self._offset = Sensor.draw_offset(self._camera_rng)
        return self.state

    def measure(self) -> np.ndarray:
        """``(6,)``: x, y, z, roll, pitch, yaw as motion capture reports them, noise included."""
        noise = TRUTH_NOISE * self._truth_rng.standard_normal(6)
        return np.concatenate(self.state.pose()) + noise

    def moment(self) -> Moment:
        """All that a frame at this moment depends on: it can be drawn later, in another thread."""
        state = self.state
        self._texture.level(self.camera.focal / state.position[2])  # threads find it made
        return state, max(self._gain, 0.1), self._offset

    def render(self) -> np.ndarray:
        """The frame at this moment, ``(H, W, 3) uint8`` Y, U, V, as `capture` would write it."""
        return self._sensor.deliver(self._frame(self.moment()))

    def capture(self, moment: Moment | None = None) -> tuple[bytes, str]:
        """The frame at this moment, or at another, as a file's bytes and its suffix."""
        return self._sensor.encode(self._frame(moment or self.moment()))

    def _frame(self, moment: Moment) -> np.ndarray:
        state, gain, offset = moment
        return self._sensor.develop(self._blur(self._project(state), state), gain, offset)

    def _project(self, state: VehicleState) -> np.ndarray:
        """``(H, W, 3) uint8`` Y, Cr, Cb: the floor as seen row after row while the camera moves."""
        texture, from_world = self._texture.level(self.camera.focal / state.position[2])
        readout = self.effects.rolling_shutter
        first, last = (
            from_world @ self.camera.world_from_pixel(*state.pose(delay))
            for delay in (-readout / 2, readout / 2)
        )
        # Within a readout the homography is linear in time to a hundredth of a pixel.
        time = (self._nodes[:, :1, 1] / max(self.camera.height - 1, 1))[..., None]
        start, change = self._nodes @ first.T, self._nodes @ (last - first).T
        nodes = start + time * change
        coarse = (nodes[..., :2] / nodes[..., 2:]).astype(np.float32)
        rows, columns = coarse.shape[:2]
        fine = cv2.resize(coarse, (columns * _NODE, rows * _NODE), interpolation=cv2.INTER_LINEAR)
        fine = fine[_NODE : _NODE + self.camera.height, _NODE : _NODE + self.camera.width]
        seen = cv2.remap(  # type: ignore[call-overload]  # OpenCV's types forget that one map may hold both
            texture, fine, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return cv2.cvtColor(seen, cv2.COLOR_BGRA2BGR)

    def _blur(self, scene: np.ndarray, state: VehicleState) -> np.ndarray:
        """Smear along the path that the floor under the image centre takes during the exposure."""
        half = self.effects.motion_blur / 2
        center = np.array([self.camera.principal_point])
        seen = transform_points(self.camera.world_from_pixel(*state.pose(-half)), center)
        back = np.linalg.inv(self.camera.world_from_pixel(*state.pose(half)))
        kernel = _line_kernel((transform_points(back, seen) - center)[0])
        if kernel is None:
            return scene
        return cv2.filter2D(scene, -1, kernel, borderType=cv2.BORDER_REFLECT_101)


def _node_grid(camera: Camera) -> np.ndarray:
    """``(rows, columns, 3)`` homogeneous pixels of nodes amid their cells, one beyond each side."""
    x, y = (
        np.arange(-1, -(-size // _NODE) + 1) * _NODE + (_NODE - 1) / 2
        for size in (camera.width, camera.height)
    )
    return np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)


def _line_kernel(path: np.ndarray, longest: float = 41.0) -> np.ndarray | None:
    """Kernel that averages along a path of (x, y) pixels; None where it would change nothing."""
    length = float(np.hypot(*path))
    if length < 0.1:
        return None
    path = path * min(1.0, longest / length)
    radius = int(np.ceil(np.abs(path).max() / 2))
    count = 4 * int(np.ceil(min(length, longest))) + 1
    points = np.linspace(-0.5, 0.5, count)[:, None] * path + radius
    kernel = np.zeros((2 * radius + 2, 2 * radius + 2), np.float32)
    whole = np.floor(points).astype(int)
    part = points - whole
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            np.add.at(kernel, (whole[:, 1] + dy, whole[:, 0] + dx), share)
    return kernel[:-1, :-1] / kernel.sum()
