"""The virtual room: geometry against the camera model, the trace of every effect, determinism."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from trexton.base.errors import ImageError, ParameterError
from trexton.simulator.floor import Floor, Light
from trexton.simulator.hall import SIDE
from trexton.simulator.sensor import Effects, Sensor
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera, MapImage, transform_points
from trexton.vision.images import read_image

SMALL = Camera(160, 120, 130.0)
# A perfect camera, level and at constant height.
NOTHING = Effects().without(*Effects().as_dict())
DOTS = np.array([[x, y] for x in np.arange(0.3, 2.8, 0.21) for y in np.arange(0.31, 2.8, 0.21)])


def plain_floor(level: int = 128, side: float = 4.0) -> Floor:
    size = round(side * 128)
    return Floor(MapImage.from_extent(np.full((size, size, 3), level, np.uint8), 0.0, side, 128))


def dotted_floor() -> Floor:
    """White dots of 6 cm at `DOTS` on black, 3 m x 3 m."""
    picture = MapImage.from_extent(np.zeros((1536, 1536, 3), np.uint8), 0.0, 3.0, 512)
    for x, y in picture.to_pixels(DOTS):
        cv2.circle(
            picture.image,
            (round(x * 16), round(y * 16)),
            16 * 16,
            (255, 255, 255),
            -1,
            cv2.LINE_AA,
            4,
        )
    return Floor(picture)


def patterned_floor(rng: np.random.Generator, cells: int = 20) -> Floor:
    coarse = rng.integers(0, 256, (cells, cells, 3), dtype=np.uint8)
    return Floor(
        MapImage.from_extent(
            cv2.resize(coarse, (512, 512), interpolation=cv2.INTER_CUBIC), 0.0, 2.0, 256
        )
    )


def flying(floor: Floor, effects: Effects, steps: int = 14, seed: int = 5, **options) -> Simulator:
    """A simulator in the middle of a manoeuvre: moving, tilted, turning."""
    simulator = Simulator(
        floor, camera=SMALL, effects=effects, speed=1.0, rng=np.random.default_rng(seed), **options
    )
    for number in range(steps):
        simulator.step((1.6, 1.5) if number < steps - 3 else (0.9, 0.9))
    return simulator


def centroids(luma: np.ndarray, expected: np.ndarray, reach: int = 9) -> np.ndarray:
    """Centre of brightness in a window around each expected pixel; NaN where the window leaves the
    image.
    """
    found = np.full(expected.shape, np.nan)
    rows, columns = np.mgrid[: luma.shape[0], : luma.shape[1]]
    for index, (x, y) in enumerate(np.rint(expected).astype(int)):
        if reach <= x < luma.shape[1] - reach and reach <= y < luma.shape[0] - reach:
            window = np.s_[y - reach : y + reach + 1, x - reach : x + reach + 1]
            weight = luma[window].astype(float) - 10
            weight[weight < 0] = 0
            found[index] = (
                np.array([(weight * columns[window]).sum(), (weight * rows[window]).sum()])
                / weight.sum()
            )
    return found


def test_floor_points_land_where_the_camera_model_says():
    simulator = flying(dotted_floor(), replace(NOTHING, roll_pitch=1.0, yaw=0.2, height_ripple=0.1))
    state = simulator.state
    assert np.abs(state.attitude).min() > 0.005  # all three angles take part
    expected = transform_points(
        np.linalg.inv(SMALL.world_from_pixel(state.position, state.attitude)), DOTS
    )
    found = centroids(simulator.render()[..., 0], expected)
    seen = np.isfinite(found).all(axis=1)
    assert seen.sum() >= 5
    assert np.abs(found - expected)[seen].max() < 0.1


def test_rolling_shutter_reads_each_row_at_its_own_time():
    readout = 0.08
    simulator = flying(dotted_floor(), replace(NOTHING, roll_pitch=1.0, rolling_shutter=readout))
    state = simulator.state

    def pixel(point: np.ndarray, delay: float) -> np.ndarray:
        pose = state.pose(delay)
        return transform_points(np.linalg.inv(SMALL.world_from_pixel(*pose)), point[None])[0]

    expected = []
    for point in (
        DOTS
    ):  # the row at which a point is seen, and the time at which that row is read, by fixed point
        delay = 0.0
        for _ in range(30):
            delay = readout * (pixel(point, delay)[1] / (SMALL.height - 1) - 0.5)
        expected.append(pixel(point, delay))
    expected = np.array(expected)
    found = centroids(simulator.render()[..., 0], expected)
    seen = np.isfinite(found).all(axis=1)
    still = np.array([pixel(point, 0.0) for point in DOTS])
    assert seen.sum() >= 5
    assert np.abs(expected - still)[seen].max() > 0.7  # else the test would not see the shutter
    assert np.abs(found - expected)[seen].max() < 0.15


def test_motion_blur_smears_along_the_true_motion(rng):
    floor, exposure = patterned_floor(rng, cells=60), 0.04
    sharp = flying(floor, replace(NOTHING, roll_pitch=1.0))
    blurred = flying(floor, replace(NOTHING, roll_pitch=1.0, motion_blur=exposure))
    state = sharp.state
    moments = [
        sharp._project(replace(state, position=p, attitude=a))
        for p, a in map(state.pose, np.linspace(-0.5, 0.5, 21) * exposure)
    ]
    average = np.mean(np.stack(moments).astype(float), axis=0)[8:-8, 8:-8, 0]
    frame = blurred.render()[8:-8, 8:-8, 0].astype(float)
    unblurred = sharp.render()[8:-8, 8:-8, 0].astype(float)
    assert np.abs(frame - average).mean() < 0.25 * np.abs(unblurred - average).mean()


def test_vignetting_darkens_the_corners():
    off = flying(plain_floor(200), NOTHING).render()[..., 0]
    on = flying(plain_floor(200), replace(NOTHING, vignetting=0.4)).render()[..., 0]
    assert off.min() == off.max() == 200
    assert on[60, 80] == 200 and abs(int(on[0, 0]) - 120) <= 1


def test_noise_has_the_strength_asked_for_and_changes_from_frame_to_frame():
    quiet = flying(plain_floor(), NOTHING)
    noisy = flying(plain_floor(), replace(NOTHING, noise=3.0))
    assert quiet.render().std(axis=(0, 1)).max() == 0
    first = noisy.render()[..., 0].astype(float)
    assert abs(first.std() - 3.0) < 0.2 and abs(first.mean() - 128) < 0.2
    noisy.step()
    second = noisy.render()[..., 0].astype(float)
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.05
    dark = flying(plain_floor(20), replace(NOTHING, noise=3.0)).render()[..., 0]
    assert dark.std() < 0.8 * first.std()


def test_exposure_changes_brightness_slowly():
    def brightness(effects: Effects) -> np.ndarray:
        simulator = Simulator(
            plain_floor(), camera=SMALL, effects=effects, rng=np.random.default_rng(3)
        )
        return np.array(
            [simulator.render()[..., 0].mean() for _ in range(150) if simulator.step() is not None]
        )

    assert np.ptp(brightness(NOTHING)) == 0
    changing = brightness(replace(NOTHING, exposure=0.1))
    assert changing.std() > 2 and np.abs(np.diff(changing)).max() < 0.1 * 128


def test_chroma_is_shared_by_two_pixels(rng):
    def sensed(effects: Effects) -> np.ndarray:
        simulator = flying(patterned_floor(np.random.default_rng(1)), effects)
        return simulator._sensor.develop(simulator._project(simulator.state), 1.0, (0, 0))

    every = sensed(NOTHING)
    shared = sensed(replace(NOTHING, chroma_subsampling=1.0))
    assert (every[:, 0::2, 1:] != every[:, 1::2, 1:]).any()
    assert np.array_equal(shared[:, 0::2, 1:], shared[:, 1::2, 1:])
    assert np.array_equal(shared[..., 0], every[..., 0])
    pairs = every[..., 1:].reshape(120, 80, 2, 2).astype(int).sum(axis=2)
    assert np.array_equal(shared[:, 0::2, 1:], (pairs + 1) // 2)


def test_the_sensor_equals_its_plain_definition(rng):
    effects = replace(NOTHING, noise=4.0, vignetting=0.3)
    sensor = Sensor(SMALL, effects, np.random.default_rng(2))
    tile = np.random.default_rng(2).standard_normal((3, 120 + 256, 160 + 256), dtype=np.float32)
    scene = rng.integers(0, 256, (120, 160, 3), dtype=np.uint8)
    columns, rows = np.meshgrid(np.arange(160) - 79.5, np.arange(120) - 59.5)
    factor = 1.07 * (1 - 0.3 * (columns**2 + rows**2) / (79.5**2 + 59.5**2))
    noise = tile[:, 7:127, 8:168]
    luma = np.minimum(scene[..., 0] * factor, 255)
    sigma = 4.0 * (0.55 + 0.45 * luma / 128)
    expected = np.stack(
        [luma + sigma * noise[0]]
        + [128 + (scene[..., c] - 128.0) * factor + sigma / 2 * noise[c] for c in (1, 2)],
        axis=-1,
    )
    assert np.abs(sensor.develop(scene, 1.07, (7, 8)) - np.clip(expected, 0, 255)).max() < 1.6


@pytest.mark.parametrize("jpeg, suffix", [(90.0, ".jpg"), (0.0, ".png")])
def test_a_live_frame_equals_the_recorded_file(tmp_path, rng, jpeg, suffix):
    simulator = flying(patterned_floor(rng), replace(Effects(), jpeg=jpeg))
    data, found_suffix = simulator.capture()
    path = tmp_path / f"frame{found_suffix}"
    path.write_bytes(data)
    assert found_suffix == suffix
    assert np.array_equal(read_image(path), simulator.render())


def test_a_level_camera_and_constant_height_and_heading():
    simulator = flying(plain_floor(), NOTHING)
    state = simulator.state
    assert (state.attitude == 0).all() and (state.rates == 0).all() and state.position[2] == 1.0
    assert np.hypot(*state.velocity[:2]) > 0.1


def test_the_light_an_hour_later_is_another_light():
    floor = Floor(MapImage.from_extent(np.full((640, 640, 3), 128, np.uint8), 0.0, 5.0, 128))
    now, later = (floor.texture(light).levels[0] for light in (Light(), Light.later()))
    assert later[..., 0].mean() < now[..., 0].mean()
    assert (
        later[..., 1].mean() > now[..., 1].mean() and later[..., 2].mean() < now[..., 2].mean()
    )  # redder, less blue
    middle = later[len(later) // 2, :, 0].astype(int)
    assert middle[-1000] > middle[1000]


def test_looking_does_not_change_the_flight(rng):
    floor = patterned_floor(rng)
    watched, unwatched = (
        Simulator(floor, camera=SMALL, rng=np.random.default_rng(9)) for _ in range(2)
    )
    for _ in range(5):
        watched.step((1.5, 1.0))
        first, again = watched.render(), watched.render()
        assert np.array_equal(first, again)
        unwatched.step((1.5, 1.0))
    assert np.array_equal(watched.render(), unwatched.render())
    assert np.array_equal(watched.measure(), unwatched.measure())


def test_frames_do_not_depend_on_the_number_of_threads(rng):
    frames, threads = [], cv2.getNumThreads()
    try:
        for count in (1, 2):
            cv2.setNumThreads(count)
            simulator = Simulator(
                patterned_floor(np.random.default_rng(1)), rng=np.random.default_rng(4)
            )
            for _ in range(8):
                simulator.step((1.5, 1.5))
            frames.append(simulator.capture()[0])
    finally:
        cv2.setNumThreads(threads)
    assert frames[0] == frames[1]


def test_higher_up_a_coarser_level_is_used_and_the_place_is_the_same():
    texture = dotted_floor().texture()
    (fine, fine_from_world), (coarse, coarse_from_world) = texture.level(520), texture.level(130)
    assert fine.shape[0] == 4 * coarse.shape[0]
    for image, matrix in ((fine, fine_from_world), (coarse, coarse_from_world)):
        expected = transform_points(matrix, DOTS[70:71])
        assert (
            np.abs(
                centroids(image[..., 0], expected, 24 * image.shape[0] // fine.shape[0]) - expected
            ).max()
            < 0.1
        )


# -- the floor
# ----------------------------------------------------------------------------------------


def test_a_floor_of_no_seed_is_refused():
    with pytest.raises(ParameterError, match="the floor.s seed is -1: expected 0 or more"):
        Floor.painted(seed=-1)


def test_the_painted_hall_is_the_same_for_the_same_seed_and_carries_its_tags():
    floor = Floor.painted("hall")
    assert floor.area == (0.0, SIDE, 0.0, SIDE)
    assert Floor.painted("hall") is floor
    grey = cv2.cvtColor(floor.picture.image, cv2.COLOR_BGR2GRAY)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250))
    _, numbers, _ = detector.detectMarkers(grey)
    assert len(np.unique(numbers)) > 40


def test_a_picture_file_becomes_a_floor_with_ground_where_it_is_transparent(tmp_path):
    image = np.zeros((100, 200, 4), np.uint8)
    image[..., 1], image[:, :100, 3] = 255, 255
    cv2.imwrite(str(tmp_path / "floor.png"), image)
    floor = Floor.from_file(tmp_path / "floor.png", 4.0)
    assert floor.area == (0.0, 4.0, 0.0, 2.0)
    simulator = Simulator(
        floor, camera=SMALL, effects=NOTHING, start=(2.0, 1.0), rng=np.random.default_rng(0)
    )
    frame = simulator.render()
    green, ground = frame[60, 40].astype(int), frame[60, 120].astype(int)
    assert np.abs(green - (150, 44, 21)).max() <= 3  # pure green in Y, U, V
    assert np.abs(ground[1:] - 128).max() < 6
    restored = cv2.imdecode(np.frombuffer(floor.png(), np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(restored, image)


def test_the_real_floor_serves_as_a_floor(shared_data):
    path = shared_data / "maps" / "cyberzoo_small.png"
    if not path.exists():
        pytest.skip(
            "the authors' floor picture is not here: put maps/cyberzoo_small.png into TREXTON_DATA"
        )
    floor = Floor.from_file(path, 5.0)
    assert floor.area[1] == 5.0 and abs(floor.area[3] - 4.58) < 0.01
    frame = Simulator(floor, rng=np.random.default_rng(0)).render()
    assert frame.shape == (480, 640, 3) and frame[..., 0].std() > 10


def test_bad_floors_and_effects_are_refused(tmp_path):
    (tmp_path / "floor.png").write_text("no picture")
    for path in (tmp_path / "floor.png", tmp_path / "missing.png"):
        with pytest.raises(ImageError):
            Floor.from_file(path, 5.0)
    for width in (0.0, -1.0, np.nan, 1e6):
        with pytest.raises(ParameterError):
            Floor.from_file(tmp_path / "floor.png", width)
    for shape in ((1, 400, 3), (400, 1, 3)):
        cv2.imwrite(str(tmp_path / "strip.png"), np.zeros(shape, np.uint8))
        with pytest.raises(ParameterError, match="length, by the shape of its picture, is"):
            Floor.from_file(tmp_path / "strip.png", 5.0)
    clear = np.dstack([np.eye(64, dtype=np.uint8)] * 3 + [np.zeros((64, 64), np.uint8)])
    for shown in (np.zeros((64, 64), np.uint8), np.full((64, 64), 255, np.uint8), clear):
        cv2.imwrite(str(tmp_path / "plain.png"), shown)
        with pytest.raises(ImageError, match="shows one colour, or nothing at all"):
            Floor.from_file(tmp_path / "plain.png", 5.0)
    with pytest.raises(ParameterError, match="no parameter 'fog'"):
        Effects().without("fog")
    for name in Effects().as_dict():
        with pytest.raises(ParameterError, match=name):
            replace(Effects(), **{name: -1.0})
        assert getattr(Effects().without(name), name) == 0
