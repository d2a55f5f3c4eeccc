"""The texton dictionary: patches that stand for the texture of a place (Methods, "Texton
Dictionary").

A Kohonen network [1]_ clusters random patches: textons sit on a chain; each patch pulls its nearest
texton, and that one's neighbours on the chain a little less, towards itself. Learning rate and
neighbourhood shrink geometrically over the pass, from a coarse ordering to fine averaging. The
authors' flight code had no neighbourhood and a constant rate; that is the method
``"winner-take-all"``.

All arithmetic is exact: textons move on a grid of 2**-12 grey levels with gains in steps of 2**-16,
and end rounded to bytes. Equal seeds therefore give equal dictionaries on any machine.

Throughout, P is the patch size, K the number of textons; a patch is ``(P, P, 3) uint8``: rows,
columns, and Y, U, V.

.. [1] T. Kohonen, "The self-organizing map", Proceedings of the IEEE 78(9), 1990.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np

from trexton.base.defaults import PATCH, TEXTONS
from trexton.base.errors import ImageError, MapError, ParameterError
from trexton.base.options import whole
from trexton.base.streams import generator
from trexton.vision.images import draw_patches

METHODS = ("kohonen", "winner-take-all")
MAX_TEXTONS = 256  # a label is a byte
MAX_PATCH = 48  # keeps the exact sums below inside float64 and int32
GRAIN = 2.0**12
# From the start to the end: the learning rate, and the neighbourhood in steps on the chain, whose
# start is a quarter of the chain.
RATE, LEAST_RADIUS = (0.5, 0.01), 0.3
# The authors' constant rate, and how many patches the first image gives.
WINNER_RATE, FIRST = 10 / 255, 1000
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class TextonDictionary:
    """K textons, rounded to bytes so that every label is a matter of exact integers.

    Parameters
    ----------
    textons : (K, P, P, 3) uint8 array

    Raises
    ------
    MapError
        The array has another shape or type, more than 256 textons, or patches larger than 48
        pixels.
    """

    textons: np.ndarray

    def __post_init__(self) -> None:
        textons = np.asarray(self.textons)
        shape = textons.shape
        square = textons.ndim == 4 and shape[1] == shape[2] <= MAX_PATCH and shape[3] == 3
        if (
            not square
            or textons.dtype != np.uint8
            or not textons.size
            or len(textons) > MAX_TEXTONS
        ):
            raise MapError(
                f"textons are a (K, P, P, 3) uint8 array with K up to {MAX_TEXTONS} and P up to "
                f"{MAX_PATCH}, found {textons.dtype} {textons.shape}: learn the dictionary again"
            )
        textons = np.array(textons, order="C")
        textons.flags.writeable = False
        object.__setattr__(self, "textons", textons)

    @property
    def n_textons(self) -> int:
        return len(self.textons)

    @property
    def patch(self) -> int:
        return self.textons.shape[1]

    @cached_property
    def weights(self) -> np.ndarray:
        """``(3 P P, K)``: 2 t; the nearest texton has the largest score ``2 p.t - |t|^2``, as
        ``|p|^2`` is common.

        Single precision where every partial sum stays below 2**24 (6x6 patches do), and so is exact
        in any order.
        """
        size = self.textons[0].size
        exact = np.float32 if 2 * size * 255**2 < 2**24 else np.float64
        return np.ascontiguousarray(2 * self.textons.reshape(self.n_textons, size).T.astype(exact))

    @cached_property
    def bias(self) -> np.ndarray:
        """``(K,)``: -\\|t\\|^2, in the type of `weights`."""
        flat = self.textons.reshape(self.n_textons, -1).astype(np.int64)
        return -np.square(flat).sum(axis=1).astype(self.weights.dtype)

    @cached_property
    def words(self) -> np.ndarray:
        """``(G, P ceil(3 P / 4), 4) int32``: t - 128 as signed bytes, four a word, in groups of 4
        textons.

        The layout of `trexton.vision.kernels`; missing bytes and textons are 0.
        """
        groups, row_bytes = -(-self.n_textons // 4), 3 * self.patch
        padded = np.zeros((4 * groups, self.patch, -(-row_bytes // 4) * 4), dtype=np.int8)
        signed = self.textons.reshape(self.n_textons, self.patch, row_bytes).astype(np.int16) - 128
        padded[: self.n_textons, :, :row_bytes] = signed
        words = padded.view("<i4").astype(np.int32).reshape(groups, 4, -1)
        return np.ascontiguousarray(words.transpose(0, 2, 1))

    @cached_property
    def words_bias(self) -> np.ndarray:
        """``(4 G,) int32``: `bias` with missing textons out of reach."""
        return np.pad(
            self.bias.astype(np.int32), (0, -self.n_textons % 4), constant_values=-(2**30)
        )

    def label(self, patches: np.ndarray) -> np.ndarray:
        """Nearest texton of each patch by Euclidean distance; ties go to the lowest index.

        Parameters
        ----------
        patches : (N, P, P, 3) uint8 array

        Returns
        -------
        (N,) int64 array
        """
        flat = _check_patches(patches, self.patch).reshape(len(patches), self.textons[0].size)
        blocks = (flat[start : start + _BLOCK] for start in range(0, max(len(flat), 1), _BLOCK))
        labels = [
            (block.astype(self.weights.dtype) @ self.weights + self.bias).argmax(axis=1)
            for block in blocks
        ]
        return labels[0] if len(labels) == 1 else np.concatenate(labels)

    @classmethod
    def learn(
        cls,
        source: Any,
        n_textons: int = TEXTONS,
        patch: int = PATCH,
        *,
        rng: np.random.Generator,
        method: str = "kohonen",
        images: int = 100,
        patches_per_image: int = 1000,
    ) -> TextonDictionary:
        """Learn a dictionary from a flight's images or from patches.

        With fewer patches than textons, or fewer different ones, some textons are equal; the lowest
        index gets all labels.

        Parameters
        ----------
        source : Flight or (N, P, P, 3) uint8 array
            A flight gives `patches_per_image` random patches from each of its first `images`
            images.
        n_textons, patch : int
            K and P; P is that of the patches where patches are given.
        method : {"kohonen", "winner-take-all"}
            A Kohonen network, or as in the authors' flight code.

        Raises
        ------
        ParameterError
            Unknown method, or a number outside its range.
        ImageError
            No patches, or an array of another shape or type.
        MapError
            The flight has no images.
        """
        if method not in METHODS:
            raise ParameterError(f"method {method!r} is unknown: choose {' or '.join(METHODS)}")
        rng = generator(rng)
        n_textons, images = whole(n_textons, "n_textons", 1, MAX_TEXTONS), whole(images, "images")
        if isinstance(source, np.ndarray):
            patches = source
        else:
            if not getattr(source, "has_images", False):
                raise MapError(
                    f"flight {getattr(source, 'name', source)!r:.60} has no images to learn "
                    "textons from: give a dictionary, a flight with images, or patches"
                )
            patch = whole(patch, "patch", 1, MAX_PATCH)
            patches = draw_patches(islice(source.images(), images), patch, patches_per_image, rng)
        return _learned(patches, n_textons, rng, method)


def _learned(
    patches: np.ndarray, n_textons: int, rng: np.random.Generator, method: str
) -> TextonDictionary:
    """Kohonen: patches in random order, start at random patches. At progress s in [0, 1) a texton j
    steps away from the winner on the chain moves by ``rate(s) exp(-j^2 / (2 radius(s)^2))`` of its
    difference to the patch, where ``rate(s) = RATE[0] (RATE[1] / RATE[0])^s`` and likewise the
    radius.

    Winner-take-all: patches in the order given, start at random patches of the first image; only
    the winner moves, by `WINNER_RATE`.
    """
    patches = _check_patches(patches)
    if not len(patches):
        raise ImageError("no patches to learn textons from: give an image as large as a patch")
    flat = patches.reshape(len(patches), -1)
    if method == "kohonen":
        flat = flat[rng.permutation(len(flat))]
        start = flat[-n_textons:]  # those that are seen last
        radius, parts = (max(n_textons / 4, LEAST_RADIUS), LEAST_RADIUS), min(len(flat), 1000)
        progress = np.arange(parts)[:, None] / parts
        rates, radii = (start * (end / start) ** progress for start, end in (RATE, radius))
        gains = rates * np.exp(-np.square(np.arange(n_textons)) / (2 * radii**2))
    else:
        start = flat[rng.permutation(min(FIRST, len(flat)))[:n_textons]]
        gains = np.r_[WINNER_RATE, np.zeros(n_textons - 1)][None]
    textons = np.resize(start, (n_textons, flat.shape[1])).astype(np.float64)
    from trexton.vision.kernels import kohonen_steps  # numba takes a while to load

    kohonen_steps(flat, textons, np.rint(gains * 2.0**16) / 2.0**16, GRAIN)
    rounded = np.rint(textons).astype(np.uint8).reshape(n_textons, *patches.shape[1:])
    return TextonDictionary(rounded)


def _check_patches(patches: np.ndarray, patch: int | None = None) -> np.ndarray:
    patches = np.asarray(patches)
    size = patches.shape[1] if patch is None and patches.ndim == 4 else patch
    if patches.ndim != 4 or patches.shape[1:] != (size, size, 3) or patches.dtype != np.uint8:
        side = "P" if patch is None else patch
        raise ImageError(
            f"patches are an (N, {side}, {side}, 3) uint8 array, found {patches.dtype} "
            f"{patches.shape}: cut them from images"
        )
    return patches
