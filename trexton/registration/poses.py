"""Where a frame sees the floor: eight numbers for each frame, which together are its homography.

A pose is ``x, y, z, roll, pitch, yaw, shear, stretch``: the pinhole camera of
`trexton.vision.camera` over a plane, plus two numbers for what a rolling shutter does to a moving
camera (each row is displaced in proportion to its number). All eight have a physical size that a
hovering vehicle keeps small, which is what holds a large mosaic flat.

Everything here works in units of the flight's typical height, so that a room and a field need the
same settings.
"""

from __future__ import annotations

import numpy as np

from trexton.vision.camera import Camera

PARAMETERS = ("x", "y", "z", "roll", "pitch", "yaw", "shear", "stretch")
# Standard deviations that hold frames near level flight at the common height; positions and heading
# are free.
TYPICAL = {"z": 0.05, "roll": 0.06, "pitch": 0.06, "shear": 0.02, "stretch": 0.02}


def floor_points(poses: np.ndarray, offsets: np.ndarray, focal: float) -> np.ndarray:
    """``(L, K, 2)`` floor points that ``(L, 8)`` poses see at ``(L, K, 2)`` pixels.

    Pixels are offsets from the principal point. Analytic in the poses, so complex poses give
    derivatives.
    """
    x, y, z, roll, pitch, yaw, shear, stretch = (column[:, None] for column in poses.T)
    right = (offsets[..., 0] + shear * offsets[..., 1]) / focal
    up = -(1 + stretch) * offsets[..., 1] / focal
    # The ray (right, up, -1) turned by roll about forward, then pitch about right, then yaw about
    # up.
    cos, sin = np.cos(roll), np.sin(roll)
    right, down = cos * right - sin, sin * right + cos
    cos, sin = np.cos(pitch), np.sin(pitch)
    up, down = cos * up + sin * down, cos * down - sin * up
    cos, sin = np.cos(yaw), np.sin(yaw)
    right, up = cos * right - sin * up, sin * right + cos * up
    return np.stack([x + z * right / down, y + z * up / down], axis=-1)


def floor_jacobian(poses: np.ndarray, offsets: np.ndarray, focal: float) -> np.ndarray:
    """``(L, K, 2, 8)`` derivatives of `floor_points` by the poses, exact (complex step)."""
    step = 1e-30
    columns = []
    for parameter in range(len(PARAMETERS)):
        shifted = poses.astype(complex)
        shifted[:, parameter] += 1j * step
        columns.append(floor_points(shifted, offsets, focal).imag / step)
    return np.stack(columns, axis=-1)


def world_from_pixel(pose: np.ndarray, camera: Camera) -> np.ndarray:
    """``(3, 3)`` homography from pixels to the floor for one ``(8,)`` pose."""
    shear, stretch = pose[6:]
    cx, cy = camera.principal_point
    rows = np.array([[1, shear, -shear * cy], [0, 1 + stretch, -stretch * cy], [0, 0, 1]])
    return camera.world_from_pixel(pose[:3], pose[3:6]) @ rows
