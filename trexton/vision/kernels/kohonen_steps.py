"""The sequential part of learning a dictionary, compiled. Offers one update a patch, in the order
given."""

from __future__ import annotations

import numpy as np

from trexton.vision.kernels import compiled

# Sums of multiples of 2**-24 below 2**29 are exact in float64, so the order of additions is free
# for vectorization.
_EXACT = {"reassoc", "contract"}


@compiled(fastmath=_EXACT)
def _squared_distance(texton, patch):
    total = 0.0
    for i in range(patch.size):
        difference = patch[i] - texton[i]
        total += difference * difference
    return total


@compiled(fastmath=_EXACT)
def kohonen_steps(patches, textons, gains, grain):
    """Move `textons` in place towards each patch in turn.

    Parameters
    ----------
    patches : (N, D) uint8 array
    textons : (K, D) float64 array
        Multiples of 1 / `grain`, and they stay so.
    gains : (S, K) float64 array
        Gain by distance on the chain; row s serves the s-th of S equal parts of the patches.
    """
    n_patches, n_textons = len(patches), len(textons)
    patch = np.empty(patches.shape[1])
    for n in range(n_patches):
        for i in range(patch.size):
            patch[i] = patches[n, i]
        winner, best = 0, _squared_distance(textons[0], patch)
        for j in range(1, n_textons):
            distance = _squared_distance(textons[j], patch)
            if distance < best:
                winner, best = j, distance
        gain = gains[n * len(gains) // n_patches]
        for j in range(n_textons):
            g = gain[abs(j - winner)]
            if g > 0:
                texton = textons[j]
                for i in range(patch.size):
                    texton[i] = np.rint((texton[i] + g * (patch[i] - texton[i])) * grain) / grain
