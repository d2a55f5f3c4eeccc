"""Linked frames, and where each sees the floor. Offers `Links`, the geometry of a pose, and
`layout`, a first layout of all frames: linear, without a guess.

A pose is ``x, y, z, roll, pitch, yaw, shear, stretch``: the pinhole camera of
`trexton.vision.camera` over a plane, plus two numbers for what a rolling shutter does to a moving
camera (each row is displaced in proportion to its number). All eight have a physical size that a
hovering vehicle keeps small, which is what holds a large mosaic flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu, spsolve

from trexton.base.errors import MapError
from trexton.vision.camera import Camera

Sparse = Any  # one of SciPy's sparse arrays, which carry no types

PARAMETERS = ("x", "y", "z", "roll", "pitch", "yaw", "shear", "stretch")
# Standard deviations, lengths in typical heights, that hold frames near level flight at the common
# height; positions and heading are free.
TYPICAL = {"z": 0.05, "roll": 0.06, "pitch": 0.06, "shear": 0.02, "stretch": 0.02}
_REWEIGHTED = 10  # rounds in which links that disagree with the others lose weight
_EXACT = 0.1  # pixels: a smaller disagreement is none
_RIGID = 5.0  # times as surely is a link's turn and scale known as the way between two positions
_LEAST_SPREAD = 0.25  # of half a frame: how far from their middle the anchors must reach
# Weak holds for frames without links, beside a weight of 1 for a link: neighbours in time are equal
# in scale and heading, they move steadily, and all fly at a common height.
_EQUAL, _STEADY, _COMMON = 1e-4, 1e-6, 1e-3


@dataclass(frozen=True, eq=False)
class Links:
    """Pairs of frames that see the same floor, with K matched points each.

    Attributes
    ----------
    pairs : (L, 2) int array
        Rows of the two frames.
    points : (L, 2, K, 2) array
        Offsets from the principal point in pixels, in the first and in the second frame.
    """

    pairs: np.ndarray
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.pairs)

    def __add__(self, other: Links) -> Links:
        return Links(
            np.concatenate([self.pairs, other.pairs]), np.concatenate([self.points, other.points])
        )

    def __getitem__(self, chosen: np.ndarray) -> Links:
        return Links(self.pairs[chosen], self.points[chosen])

    def sides(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Rows ``(L,)`` and points ``(L, K, 2)`` of the first frames, then of the second."""
        return [(self.pairs[:, side], self.points[:, side]) for side in (0, 1)]


@dataclass(frozen=True, eq=False)
class Anchors:
    """Frames whose position is known: `rows` ``(A,) int`` and `position` ``(A, 2)`` in metres, of
    standard deviation `sigma` along an axis; None for that of motion capture.
    """

    rows: np.ndarray
    position: np.ndarray
    sigma: float | None = None

    def __getitem__(self, chosen: np.ndarray) -> Anchors:
        return Anchors(self.rows[chosen], self.position[chosen], self.sigma)


def floor_points(poses: np.ndarray, offsets: np.ndarray, focal: float) -> np.ndarray:
    """``(L, K, 2)`` floor points that ``(L, 8)`` poses see at ``(L, K, 2)`` pixels.

    Pixels are offsets from the principal point. Complex poses give derivatives.
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


def layout(count: int, links: Links, anchors: Anchors, focal: float) -> np.ndarray:
    """``(N, 8)`` level poses that agree with the links, placed in the world by the anchors.

    Points are complex numbers, right + i up: frame n sees pixel z at ``S_n z + T_n``. A link says
    ``S_j = S_i a`` and ``T_j = T_i + S_i b``. First the logarithms of all S are found, so that no
    scale can shrink to nothing, then all T.

    Raises
    ------
    MapError
        The anchors are so near to one another that they say nothing about scale and heading.
    """
    turn, shift = _similarities(links)
    step = steps(count, links.pairs)
    second = differences(count, 2)
    equal, steady = _EQUAL * _square(differences(count, 1)), _STEADY * _square(second)
    diagonal = sparse.diags_array
    common, pin = diagonal(np.full(count, _COMMON)), diagonal(np.eye(1, count)[0])
    weight = np.ones(len(links))
    for _ in range(_REWEIGHTED):
        pull = step.T @ diagonal(weight)
        graph = pull @ step
        scale = solve(graph + equal + common, pull @ np.log(np.abs(turn)))
        heading = solve(graph + equal + pin, pull @ np.angle(turn))
        similarity = np.exp(scale + 1j * heading)
        move = similarity[links.pairs[:, 0]] * shift
        place = solve(graph + steady + pin, pull @ move)
        errors = np.abs(step @ place - move)
        weight = 1 / (1 + (errors / (3 * np.median(errors) + _EXACT)) ** 2)
    # The links alone have decided which of them to trust; now the anchors bend the drifting chain
    # into place.
    goal = anchors.position @ [1, 1j]
    piece = connected(count, links.pairs)[anchors.rows]
    least = _LEAST_SPREAD * np.abs(links.points).max()
    unit, origin = _fit(place[anchors.rows], goal, piece, least)
    fixed, held = np.zeros(count, complex), np.zeros(count)
    fixed[anchors.rows], held[anchors.rows] = (goal - origin) / unit, 1.0
    place = solve(graph + steady + diagonal(held), pull @ move + fixed)
    return _level_poses(unit * place + origin, unit * similarity, focal)


def layout_by_positions(count: int, links: Links, anchors: Anchors, focal: float) -> np.ndarray:
    """``(N, 8)`` level poses by positions that err, and links between frames that have one.

    With the words of `layout`: positions g give a second equation a link, ``g_j - g_i = S_i b``, so
    that a link is believed as far as it agrees with where its two frames were taken.
    """
    turn, shift = _similarities(links)
    first, step = pick(links.pairs[:, 0], count, 1.0), steps(count, links.pairs)
    goal, held = np.zeros(count, complex), np.zeros(count)
    goal[anchors.rows], held[anchors.rows] = anchors.position @ [1, 1j], 1.0
    moved = step @ goal
    scale = np.median(np.abs(moved) / np.maximum(np.abs(shift), _EXACT))
    errors = np.abs(np.abs(shift) * scale - np.abs(moved))
    reach = _RIGID * np.abs(links.points).max() * scale
    diagonal = sparse.diags_array
    equal = _EQUAL * _square(differences(count, 1)) + _STEADY * sparse.eye_array(count)
    for _ in range(_REWEIGHTED):
        weight = 1 / (1 + (errors / (3 * np.median(errors) + _EXACT * scale)) ** 2)
        agree = diagonal(reach * np.sqrt(weight)) @ (step + first - diagonal(turn) @ first)
        along = diagonal(np.sqrt(weight) * shift) @ first
        normal = agree.conj().T @ agree + along.conj().T @ along + reach**2 * equal
        similarity = spsolve(normal.tocsc(), along.conj().T @ (np.sqrt(weight) * moved))
        move = similarity[links.pairs[:, 0]] * shift
        errors = np.abs(move - moved)
    pull = step.T @ diagonal(weight)
    steady = _STEADY * _square(differences(count, 2))
    place = solve(pull @ step + steady + diagonal(held), pull @ move + goal)
    poses = _level_poses(place, similarity, focal)
    poses[:, 5] = np.unwrap(poses[:, 5])
    return poses


def _similarities(links: Links) -> tuple[np.ndarray, np.ndarray]:
    """``(L,)`` complex a and b of each link: ``first = a second + b``, by least squares."""
    points = links.points[..., 0] - 1j * links.points[..., 1]
    first, second = points[:, 0], points[:, 1]
    first_mean, second_mean = first.mean(axis=1), second.mean(axis=1)
    spread = second - second_mean[:, None]
    turn = (spread.conj() * (first - first_mean[:, None])).sum(axis=1)
    turn = turn / (np.abs(spread) ** 2).sum(axis=1)
    return turn, first_mean - turn * second_mean


def _fit(
    source: np.ndarray, target: np.ndarray, piece: np.ndarray, least: float
) -> tuple[complex, complex]:
    """The similarity ``target = a source + b`` of complex points that spread at least so far.

    Only what lies on the same `piece` of linked frames says how large and how turned the map is.
    """
    away, goal = (values - _means(values, piece) for values in (source, target))
    unit = (away.conj() * goal).sum() / max((np.abs(away) ** 2).sum(), 1e-12)
    if np.abs(away).max() < least or np.abs(goal).max() == 0 or unit == 0:
        raise MapError(
            f"the {len(source)} anchors lie too near to one another to scale and turn a map: "
            "use a flight that covers more floor, or more anchors"
        )
    return unit, target.mean() - unit * source.mean()


def _means(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """The mean of each value's group."""
    sums = np.bincount(group, values.real) + 1j * np.bincount(group, values.imag)
    return (sums / np.maximum(np.bincount(group), 1))[group]


def _level_poses(place: np.ndarray, similarity: np.ndarray, focal: float) -> np.ndarray:
    poses = np.zeros((len(place), len(PARAMETERS)))
    columns = [PARAMETERS.index(name) for name in ("x", "y", "z", "yaw")]
    poses[:, columns] = np.column_stack(
        [place.real, place.imag, focal * np.abs(similarity), np.angle(similarity)]
    )
    return poses


def _square(matrix: Sparse) -> Sparse:
    return matrix.T @ matrix


def connected(count: int, pairs: np.ndarray) -> np.ndarray:
    """``(count,)`` number of the piece that each frame is of, joined by ``(L, 2)`` pairs."""
    graph = sparse.coo_array((np.ones(len(pairs)), tuple(pairs.T)), (count, count))
    return connected_components(graph, directed=False)[1]


def differences(count: int, order: int) -> Sparse:
    """``(count - order, count)`` finite differences of `order` 1 or 2."""
    stencil = {1: [-1.0, 1.0], 2: [1.0, -2.0, 1.0]}[order]
    if count <= order:
        return sparse.csr_array((0, count))
    return sparse.diags_array(stencil, offsets=range(order + 1), shape=(count - order, count))


def steps(count: int, pairs: np.ndarray) -> Sparse:
    """``(L, count)``: the second of each of the ``(L, 2)`` pairs minus the first."""
    frames = sparse.eye_array(count, format="csr")
    return frames[pairs[:, 1]] - frames[pairs[:, 0]]


def pick(columns: np.ndarray, count: int, factor: float) -> Sparse:
    """``(len(columns), count)``: row i takes `factor` times entry ``columns[i]``."""
    return factor * sparse.eye_array(count, format="csr")[columns]


def assemble(blocks: np.ndarray, pairs: np.ndarray, size: int, count: int) -> Sparse:
    """``(L, 2 size, 2 size)`` blocks of pairs, summed into ``(count size, count size)``."""
    places = (pairs[:, :, None] * size + np.arange(size)).reshape(len(pairs), 2 * size)
    down = np.repeat(places, 2 * size, axis=1).ravel()
    across = np.tile(places, (1, 2 * size)).ravel()
    return sparse.coo_array((blocks.ravel(), (down, across)), (count * size, count * size)).tocsc()


def factorized(matrix: Sparse) -> Any:
    """The factors of a symmetric, positive definite matrix."""
    # An ordering for symmetric matrices, without pivoting: far less fill than the general one.
    return splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )  # fmt: skip


def solve(matrix: Sparse, vector: np.ndarray) -> np.ndarray:
    """The solution of a symmetric, positive definite system; `vector` may be complex."""
    factors = factorized(matrix)
    if np.iscomplexobj(vector):
        return factors.solve(vector.real) + 1j * factors.solve(vector.imag)
    return factors.solve(vector)
