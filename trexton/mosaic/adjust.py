"""Sparse global adjustment: the poses of all frames at once, from links between them and a few known positions.

`layout` solves linearly for similarities, which needs no first guess; `adjust` refines them to poses
(`trexton.mosaic.poses`) by Levenberg-Marquardt with a robust loss, so that a wrong link does not bend the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.mosaic.poses import PARAMETERS, TYPICAL, floor_jacobian, floor_points

__all__ = ["Links", "Anchors", "adjust", "layout", "link_errors"]

_SIZE = len(PARAMETERS)
_HEIGHT = PARAMETERS.index("z")
# In typical heights: how well an anchor is known, and how far a frame may stray from steady motion (a weak
# hold for frames without links); in radians: how far the heading may turn between frames.
_ANCHOR, _MOTION, _TURN = 0.005, 0.3, 0.3
_REWEIGHTED = 10  # rounds in which the layout gives less weight to links that disagree


@dataclass(frozen=True, eq=False)
class Links:
    """Pairs of frames that see the same floor, with `K` matched points each.

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
        return Links(np.concatenate([self.pairs, other.pairs]), np.concatenate([self.points, other.points]))

    def __getitem__(self, chosen: np.ndarray) -> Links:
        return Links(self.pairs[chosen], self.points[chosen])


@dataclass(frozen=True, eq=False)
class Anchors:
    """Frames whose position is known: `rows` ``(A,) int`` and `position` ``(A, 2)`` in metres."""

    rows: np.ndarray
    position: np.ndarray


def layout(count: int, links: Links, anchors: Anchors, focal: float) -> np.ndarray:
    """``(N, 8)`` first poses, level, from similarities between linked frames; nothing but linear problems.

    Points are complex numbers, right + i up: frame n sees pixel z at ``S_n z + T_n``. A link says ``S_j = S_i a`` and
    ``T_j = T_i + S_i b``. First the logarithms of all S are found, so that no scale can shrink to nothing, then all T.
    """
    first, second = (links.points[:, side, :, 0] - 1j * links.points[:, side, :, 1] for side in (0, 1))
    first_mean, second_mean = first.mean(axis=1), second.mean(axis=1)
    spread = second - second_mean[:, None]
    turn = (spread.conj() * (first - first_mean[:, None])).sum(axis=1) / (np.abs(spread) ** 2).sum(axis=1)
    shift = first_mean - turn * second_mean

    step = _steps(count, links.pairs)
    # Weak holds for frames without links: equal scale and heading, steady motion; and a common height.
    equal, steady = 1e-4 * _square(_differences(count, 1)), 1e-6 * _square(_differences(count, 2))
    common = _diagonal(np.full(count, 1e-3))
    pin = _diagonal(np.eye(1, count)[0])
    weight = np.ones(len(links))
    for _ in range(_REWEIGHTED):
        pull = step.T @ _diagonal(weight)
        graph = pull @ step
        scale = _solve(graph + equal + common, pull @ np.log(np.abs(turn)))
        heading = _solve(graph + equal + pin, pull @ np.angle(turn))
        similarity = np.exp(scale + 1j * heading)
        move = similarity[links.pairs[:, 0]] * shift
        place = _solve_complex(graph + steady + pin, pull @ move)
        errors = np.abs(step @ place - move)
        weight = 1 / (1 + (errors / (3 * np.median(errors) + 1e-9)) ** 2)
    # The links alone have decided which of them to trust; now the anchors bend the drifting chain into
    # place.
    goal = anchors.position @ [1, 1j]
    unit, origin = _fit(place[anchors.rows], goal)
    known, anchored = np.zeros(count, complex), np.zeros(count)
    known[anchors.rows], anchored[anchors.rows] = (goal - origin) / unit, 1.0
    place = _solve_complex(graph + steady + _diagonal(anchored), pull @ move + known)
    place, similarity = unit * place + origin, unit * similarity
    poses = np.zeros((count, _SIZE))
    poses[:, 0], poses[:, 1] = place.real, place.imag
    poses[:, 2], poses[:, 5] = focal * np.abs(similarity), np.angle(similarity)
    return poses


def _fit(source: np.ndarray, target: np.ndarray) -> tuple[complex, complex]:
    """The similarity ``target = a source + b`` of complex points, least squares."""
    away = source - source.mean()
    a = (away.conj() * (target - target.mean())).sum() / max((np.abs(away) ** 2).sum(), 1e-12)
    return a, target.mean() - a * source.mean()


def adjust(
    poses: np.ndarray, links: Links, anchors: Anchors, focal: float, *, widths: tuple[float, ...] = (32, 8, 4, 2)
) -> np.ndarray:
    """Refine ``(N, 8)`` poses until links, anchors and level flight agree best, under a Cauchy loss.

    The loss is as wide as each of `widths` in turn, in pixels: wide first, so that a poor start is not
    taken for wrong links.
    """
    height = float(np.median(poses[:, 2]))
    poses = poses / ([height] * 3 + [1] * 5)  # in typical heights from here on
    anchors = Anchors(anchors.rows, anchors.position / height)
    hold, expected = _priors(len(poses), anchors)
    for width in widths:
        damping = 1e-6
        cost = _cost(poses, links, hold, expected, focal, width)
        for _ in range(10):
            normal, gradient = _normal_equations(poses, links, hold, expected, focal, width)
            step = _solve(normal + _diagonal(damping * normal.diagonal()), -gradient).reshape(poses.shape)
            trial = _cost(poses + step, links, hold, expected, focal, width)
            if not trial < cost:
                damping *= 100
                continue
            poses, gain, cost, damping = poses + step, 1 - trial / cost, trial, damping / 10
            if gain < 1e-3:
                break
    # The last bits depend on the linear algebra library; no result should.
    return np.round(poses, 9) * ([height] * 3 + [1] * 5)


def link_errors(poses: np.ndarray, links: Links, focal: float) -> np.ndarray:
    """``(L, K)`` distances in pixels between the points of a link as its two frames place them on the floor."""
    return np.hypot(*np.moveaxis(_residuals(poses, links, focal), -1, 0))


def _pixels_per_unit(poses: np.ndarray, links: Links, focal: float) -> np.ndarray:
    return (focal / poses[links.pairs, 2].mean(axis=1))[:, None, None]


def _residuals(poses: np.ndarray, links: Links, focal: float) -> np.ndarray:
    first, second = (floor_points(poses[links.pairs[:, side]], links.points[:, side], focal) for side in (0, 1))
    return (first - second) * _pixels_per_unit(poses, links, focal)


def _priors(count: int, anchors: Anchors):
    """A sparse matrix and a target: ``matrix @ poses.ravel() - target`` in standard deviations."""
    from scipy import sparse

    def rows(where: np.ndarray, name: str, deviation: float):
        column = PARAMETERS.index(name)
        places = where * _SIZE + column
        return sparse.csr_array((np.full(len(where), 1 / deviation), (np.arange(len(where)), places)), (len(where), count * _SIZE))

    every = np.arange(count)
    parts = [(rows(every, name, deviation), float(name == "z") / deviation) for name, deviation in TYPICAL.items()]
    parts += [(rows(anchors.rows, name, _ANCHOR), anchors.position[:, axis] / _ANCHOR) for axis, name in enumerate("xy")]
    parts += [(_differences(count, 2) @ rows(every, name, _MOTION), 0.0) for name in "xy"]
    parts += [(_differences(count, 1) @ rows(every, "yaw", _TURN), 0.0)]
    target = np.concatenate([np.broadcast_to(value, matrix.shape[0]) for matrix, value in parts])
    return sparse.vstack([matrix for matrix, _ in parts]).tocsr(), target


def _cost(poses, links, hold, expected, focal, width) -> float:
    squared = (_residuals(poses, links, focal) ** 2).sum(axis=-1)
    if not (poses[:, 2] > 0).all():
        return np.inf
    return float(width**2 * np.log1p(squared / width**2).sum() + ((hold @ poses.ravel() - expected) ** 2).sum())


def _normal_equations(poses, links, hold, expected, focal, width):
    residual = _residuals(poses, links, focal)
    unit = _pixels_per_unit(poses, links, focal)[..., None]
    first, second = (floor_jacobian(poses[links.pairs[:, side]], links.points[:, side], focal) * unit for side in (0, 1))
    weight = 1 / (1 + (residual**2).sum(axis=-1) / width**2)  # Cauchy: iteratively reweighted
    jacobian = np.concatenate([first, -second], axis=-1)
    # Residuals are in pixels of the pair's mean height; without this term the map would shrink to shrink
    # them.
    jacobian[..., [_HEIGHT, _SIZE + _HEIGHT]] -= residual[..., None] / poses[links.pairs, _HEIGHT].sum(axis=1)[:, None, None, None]
    jacobian = jacobian.reshape(len(links), -1, 2 * _SIZE)
    weighted = jacobian.transpose(0, 2, 1) * np.repeat(weight, 2, axis=1)[:, None, :]
    normal = _assemble(np.matmul(weighted, jacobian), links.pairs, _SIZE, len(poses)) + hold.T @ hold
    pulls = np.matmul(weighted, residual.reshape(len(links), -1, 1)).reshape(len(links), 2, _SIZE)
    gradient = np.zeros_like(poses)
    np.add.at(gradient, links.pairs, pulls)
    return normal, gradient.ravel() + hold.T @ (hold @ poses.ravel() - expected)


def _assemble(blocks: np.ndarray, pairs: np.ndarray, size: int, count: int):
    """``(L, 2 size, 2 size)`` blocks of frame pairs summed into one sparse ``(count size, count size)`` matrix."""
    from scipy import sparse

    places = (pairs[:, :, None] * size + np.arange(size)).reshape(len(pairs), 2 * size)
    down = np.repeat(places, 2 * size, axis=1).ravel()
    across = np.tile(places, (1, 2 * size)).ravel()
    return sparse.coo_array((blocks.ravel(), (down, across)), (count * size, count * size)).tocsc()


def _differences(count: int, order: int):
    """Sparse finite differences of `order` 1 or 2 along the frames."""
    from scipy import sparse

    stencil = {1: [-1.0, 1.0], 2: [1.0, -2.0, 1.0]}[order]
    rows = max(count - order, 0)
    return sparse.diags_array(stencil, offsets=range(order + 1), shape=(rows, count)) if rows else sparse.csr_array((0, count))


def _steps(count: int, pairs: np.ndarray):
    """Sparse ``(L, count)``: the second frame of each pair minus the first."""
    from scipy import sparse

    every = np.arange(len(pairs))
    values = np.repeat([-1.0, 1.0], len(pairs))
    return sparse.csr_array((values, (np.tile(every, 2), pairs.T.ravel())), (len(pairs), count))


def _square(matrix):
    return matrix.T @ matrix


def _diagonal(values: np.ndarray):
    from scipy import sparse

    return sparse.diags_array(values)


def _solve_complex(matrix, vector: np.ndarray) -> np.ndarray:
    return _solve(matrix, vector.real) + 1j * _solve(matrix, vector.imag)


def _solve(matrix, vector: np.ndarray) -> np.ndarray:
    from scipy.sparse.linalg import splu

    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve(vector)
