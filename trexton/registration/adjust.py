"""Sparse global adjustment: all frames' poses at once, from their links and a few positions.

Levenberg-Marquardt on the poses of `trexton.registration.layout`, with a robust loss, so that a
wrong link does not bend the map.
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from trexton.registration.layout import (
    PARAMETERS,
    TYPICAL,
    Anchors,
    Links,
    Sparse,
    assemble,
    differences,
    factorized,
    floor_jacobian,
    floor_points,
    pick,
    solve,
)

_SIZE = len(PARAMETERS)
_HEIGHT = PARAMETERS.index("z")
# In typical heights: how well an anchor is known, how far a frame may stray from steady motion; in
# radians: how far the heading may turn between frames. The last two are weak holds for frames
# without links.
_ANCHOR, _MOTION, _TURN = 0.005, 0.3, 0.3
_ITERATIONS = 10  # at each width of the loss
_WIDTH = 2.0  # pixels of the loss, at last
_MEDIAN = 1.1774  # of the length of a plane vector with unit standard deviations
_GAIN = 1e-3  # share of the cost; a smaller gain ends a width


def adjust(
    poses: np.ndarray,
    links: Links,
    anchors: Anchors,
    focal: float,
    *,
    widths: Sequence[float] = (32.0, 8.0, 4.0, 2.0),
) -> np.ndarray:
    """Refine ``(N, 8)`` poses until links, anchors and level flight agree best (Cauchy loss).

    The loss is as wide as each of `widths` in turn, in pixels: wide first, so that a poor start is
    not taken for wrong links.
    """
    problem = _Problem(links, anchors, focal, poses)
    poses = poses / problem.scale  # in typical heights from here on
    for width in widths:
        damping, cost = 1e-6, problem.cost(poses, width)
        for _ in range(_ITERATIONS):
            normal, gradient = problem.linearized(poses, width)
            damped = normal + sparse.diags_array(damping * normal.diagonal())
            step = solve(damped, -gradient).reshape(poses.shape)
            trial = problem.cost(poses + step, width)
            if not trial < cost:
                damping *= 100
                continue
            gain = 1 - trial / cost
            poses, cost, damping = poses + step, trial, damping / 10
            if gain < _GAIN:
                break
    # The last bits depend on the linear algebra library; no result should.
    return np.round(poses, 9) * problem.scale


def left_out(poses: np.ndarray, links: Links, anchors: Anchors, focal: float) -> np.ndarray:
    """``(A, 2)`` metres to each anchor from where its frame would be without it, linearized about
    `poses`, which `adjust` found.
    """
    problem = _Problem(links, anchors, focal, poses)
    normal, _ = problem.linearized(poses / problem.scale, _WIDTH)
    factors = factorized(normal)
    result = anchors.position - poses[anchors.rows, :2]
    for each, row in zip(result, anchors.rows, strict=True):
        place = row * _SIZE + np.arange(2)
        unit = np.zeros((len(poses) * _SIZE, 2))
        unit[place, [0, 1]] = 1
        share = factors.solve(unit)[place] / problem.sigma**2
        # An anchor's own share of where its frame is: all where nothing else holds it.
        each[:] = np.linalg.solve(np.eye(2) - share + 1e-9 * np.eye(2), each)
    return result


def anchor_sigma(poses: np.ndarray, links: Links, anchors: Anchors, focal: float) -> float:
    """Standard deviation of anchors along an axis in metres, by how far each is off if left out."""
    off = np.hypot(*left_out(poses, links, anchors, focal).T)
    return max(float(np.median(off)) / _MEDIAN, _ANCHOR * float(np.median(poses[:, _HEIGHT])))


def link_errors(poses: np.ndarray, links: Links, focal: float) -> np.ndarray:
    """``(L,)``: median of the pixels between a link's points as its two frames place them."""
    return np.median(np.hypot(*np.moveaxis(_residuals(poses, links, focal), -1, 0)), axis=1)


def _residuals(poses: np.ndarray, links: Links, focal: float) -> np.ndarray:
    """``(L, K, 2)`` differences on the floor, in pixels of the pair's mean height."""
    first, second = (floor_points(poses[rows], points, focal) for rows, points in links.sides())
    return (first - second) * _pixels_per_unit(poses, links, focal)


def _pixels_per_unit(poses: np.ndarray, links: Links, focal: float) -> np.ndarray:
    return (focal / poses[links.pairs, _HEIGHT].mean(axis=1))[:, None, None]


class _Problem:
    """Cost and normal equations, in typical heights."""

    def __init__(self, links: Links, anchors: Anchors, focal: float, poses: np.ndarray):
        self.links, self.focal = links, focal
        height = float(np.median(poses[:, _HEIGHT]))
        self.scale = [height] * 3 + [1] * 5  # of a pose
        self.sigma = _ANCHOR if anchors.sigma is None else anchors.sigma / height
        in_heights = Anchors(anchors.rows, anchors.position / height)
        self.hold, self.expected = _holds(len(poses), in_heights, self.sigma)

    def cost(self, poses: np.ndarray, width: float) -> float:
        """Cauchy loss of the links, square pixels, plus the holds; infinite below the floor."""
        if not (poses[:, _HEIGHT] > 0).all():
            return np.inf
        squared = (_residuals(poses, self.links, self.focal) ** 2).sum(axis=-1)
        held = ((self.hold @ poses.ravel() - self.expected) ** 2).sum()
        return float(width**2 * np.log1p(squared / width**2).sum() + held)

    def linearized(self, poses: np.ndarray, width: float) -> tuple[Sparse, np.ndarray]:
        """The normal matrix and the gradient, the loss as iteratively reweighted squares."""
        links = self.links
        residual = _residuals(poses, links, self.focal)
        weight = 1 / (1 + (residual**2).sum(axis=-1) / width**2)
        unit = _pixels_per_unit(poses, links, self.focal)[..., None]
        sides = [floor_jacobian(poses[rows], at, self.focal) for rows, at in links.sides()]
        jacobian = np.concatenate([sides[0], -sides[1]], axis=-1) * unit
        # The residual is in pixels of the pair's height; without this term the map would shrink to
        # reduce it.
        heights = poses[links.pairs, _HEIGHT].sum(axis=1)[:, None, None, None]
        jacobian[..., [_HEIGHT, _SIZE + _HEIGHT]] -= residual[..., None] / heights
        jacobian = jacobian.reshape(len(links), 2 * residual.shape[1], 2 * _SIZE)
        weighted = jacobian.transpose(0, 2, 1) * np.repeat(weight, 2, axis=1)[:, None, :]
        normal = assemble(np.matmul(weighted, jacobian), links.pairs, _SIZE, len(poses))
        pulls = np.matmul(weighted, residual.reshape(*jacobian.shape[:2], 1))
        gradient = np.zeros_like(poses)
        np.add.at(gradient, links.pairs, pulls.reshape(len(links), 2, _SIZE))
        held = self.hold.T @ (self.hold @ poses.ravel() - self.expected)
        return normal + self.hold.T @ self.hold, gradient.ravel() + held


def _holds(count: int, anchors: Anchors, sigma: float) -> tuple[Sparse, np.ndarray]:
    """A sparse matrix and a target: ``matrix @ poses.ravel() - target`` in standard deviations."""

    def taken(of: np.ndarray, name: str, deviation: float) -> Sparse:
        return pick(of * _SIZE + PARAMETERS.index(name), count * _SIZE, 1 / deviation)

    every = np.arange(count)
    parts: list[tuple[Sparse, np.ndarray | float]] = [
        (taken(every, name, width), float(name == "z") / width) for name, width in TYPICAL.items()
    ]
    for axis, name in enumerate("xy"):
        parts.append((taken(anchors.rows, name, sigma), anchors.position[:, axis] / sigma))
        parts.append((differences(count, 2) @ taken(every, name, _MOTION), 0.0))
    parts.append((differences(count, 1) @ taken(every, "yaw", _TURN), 0.0))
    target = np.concatenate([np.broadcast_to(value, matrix.shape[0]) for matrix, value in parts])
    return sparse.vstack([matrix for matrix, _ in parts]).tocsr(), target
