"""What numba compiles of textons: the steps by which they are learned, and the nearest one at every
position of an image. Offers `compiled`, `kohonen_steps` and `label_rows`.

Labels are found in integers, four bytes at a time. The largest score 2 p.t - |t|^2 marks the
nearest texton. With w = t - 128, a signed byte, p.t is p.w plus 128 sum(p), the same for all
textons. So a score is made of products of unsigned with signed bytes; some processors add four such
products to each of 16 sums in one instruction, others get 16-bit pairs.

A row of a patch is 3 P bytes of the image: ceil(3 P / 4) words. Word j at column x starts at byte 3
x + 4 j; word j + 3 at x is thus word j at x + 4, and three planes of words serve a whole image row.
"""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

# Sums of multiples of 2**-24 below 2**29 are exact in float64, so the order of additions is free
# for vectorization.
_EXACT = {"reassoc", "contract"}
LANES, GROUP, BLOCK = 16, 4, 64
_I8, _I16, _I32, _I64 = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_BYTES, _WORDS = ir.VectorType(_I8, LANES), ir.VectorType(_I32, LANES)
_HALVES, _PRODUCTS = ir.VectorType(_I16, 2 * LANES), ir.VectorType(_I32, 2 * LANES)


def compiled(**options):
    """Numba's `njit`: what it makes is kept beside the module or in the user's cache.

    Where neither can be written to, as for a service without a home, it is made at each start.
    """

    def decorate(function):
        try:
            return njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # no place
            return njit(nogil=True, **options)(function)

    return decorate


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


def _constant(kind, value):
    return ir.Constant(kind, [value] * kind.count)


def _splat(builder, value):
    lane = builder.insert_element(ir.Constant(_WORDS, ir.Undefined), value, _I32(0))
    return builder.shuffle_vector(lane, lane, _constant(_WORDS, 0))


def _dot(builder, vnni, total, pixels, weight):
    """`total` plus, in each lane, the products of four unsigned bytes with four signed ones."""
    if vnni:
        kind, name = ir.FunctionType(_WORDS, [_WORDS] * 3), "llvm.x86.avx512.vpdpbusd.512"
        intrinsic_ = builder.module.declare_intrinsic(name, (), kind)
        return builder.call(intrinsic_, [total, pixels, weight])
    pixels, weight = (builder.bitcast(word, _HALVES) for word in (pixels, weight))
    eight, low_byte = _constant(_HALVES, 8), _constant(_HALVES, 255)
    even = builder.and_(pixels, low_byte), builder.ashr(builder.shl(weight, eight), eight)
    odd = builder.lshr(pixels, eight), builder.ashr(weight, eight)
    for factors in (even, odd):
        product = builder.mul(*(builder.sext(half, _PRODUCTS) for half in factors))
        # Neighbours added: on most processors one instruction with the product.
        for first in (0, 1):
            lanes = ir.Constant(_WORDS, list(range(first, 2 * LANES, 2)))
            total = builder.add(total, builder.shuffle_vector(product, product, lanes))
    return total


def _add_word(builder, vnni, place, planes, weights, item, totals, strips):
    """Add to the scores of 4 textons, which stay in registers, what one word of the patch gives."""
    places = [builder.gep(planes.data, [builder.add(place, _I64(LANES * s))]) for s in strips]
    pixels = [builder.load(builder.bitcast(at, _WORDS.as_pointer()), align=4) for at in places]
    for t in range(GROUP):
        place = builder.add(builder.mul(item, _I64(GROUP)), _I64(t))
        weight = _splat(builder, builder.load(builder.gep(weights.data, [place])))
        for s in strips:
            total = totals[GROUP * s + t]
            builder.store(_dot(builder, vnni, builder.load(total), pixels[s], weight), total)


def _keep_better(builder, texton, bias, total, best, label):
    """Where the texton's score beats the best so far, it is the label; ties stay with the lower."""
    score = builder.shl(builder.load(total), _constant(_WORDS, 1))
    score, held = builder.add(score, _splat(builder, bias)), builder.load(best)
    better = builder.icmp_signed(">", score, held)
    name = _splat(builder, builder.trunc(texton, _I32))
    builder.store(builder.select(better, score, held), best)
    builder.store(builder.select(better, name, builder.load(label)), label)


@intrinsic
def _label_block(typing, planes, start, offsets, weights, bias, labels):
    """Label BLOCK positions: words at planes[start + offsets[...] + 0...] to labels[0...]."""
    kinds = planes, start, offsets, weights, bias, labels

    def generate(context, builder, signature, arguments):
        vnni = "+avx512vnni" in context.codegen().magic_tuple()[2]
        strips, start = range(4 if vnni else 1), arguments[1]
        planes, offsets, weights, bias, labels = (
            context.make_array(kinds[i])(context, builder, arguments[i]) for i in (0, 2, 3, 4, 5)
        )
        n_words = cgutils.unpack_tuple(builder, offsets.shape)[0]
        n_groups = cgutils.unpack_tuple(builder, weights.shape)[0]
        best, label = ([cgutils.alloca_once(builder, _WORDS) for _ in strips] for _ in range(2))
        totals = [cgutils.alloca_once(builder, _WORDS) for _ in range(GROUP * len(strips))]
        bounds = _I64(0), _I64(BLOCK), _I64(LANES * len(strips))
        with cgutils.for_range_slice(builder, *bounds, _I64) as (block, _):
            for lowest in best:
                builder.store(_constant(_WORDS, -(2**31)), lowest)
            with cgutils.for_range(builder, n_groups) as group:
                for total in totals:
                    builder.store(_constant(_WORDS, 0), total)
                with cgutils.for_range(builder, n_words) as word:
                    offset = builder.load(builder.gep(offsets.data, [word.index]))
                    place = builder.add(builder.add(start, block), offset)
                    item = builder.add(builder.mul(group.index, n_words), word.index)
                    _add_word(builder, vnni, place, planes, weights, item, totals, strips)
                for t in range(GROUP):
                    texton = builder.add(builder.mul(group.index, _I64(GROUP)), _I64(t))
                    size = builder.load(builder.gep(bias.data, [texton]))
                    for s in strips:
                        _keep_better(
                            builder, texton, size, totals[GROUP * s + t], best[s], label[s]
                        )
            for s in strips:
                place = builder.gep(labels.data, [builder.add(block, _I64(LANES * s))])
                names = builder.trunc(builder.load(label[s]), _BYTES)
                builder.store(names, builder.bitcast(place, _BYTES.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(*kinds), generate


@compiled()
def _fill_plane(line, start, plane):  # pragma: no cover - compiled
    """The word of four bytes at byte 3 x + `start` of a line, for every x."""
    for x in range((len(line) - start) // 3 - 1):
        byte = np.uint64(3 * x + start)
        low = np.uint32(line[byte]) | np.uint32(line[byte + np.uint64(1)]) << np.uint32(8)
        high = np.uint32(line[byte + np.uint64(2)]) | np.uint32(
            line[byte + np.uint64(3)]
        ) << np.uint32(8)
        plane[x] = low | high << np.uint32(16)


@compiled()
def label_rows(image, weights, bias, labels, counts, down, right):  # pragma: no cover - compiled
    """Label all positions of an image (or a strip of one) and count the labels in cells.

    image (H, 3 W) uint8; weights (G, P words, GROUP) int32, each four signed bytes; bias (G GROUP,)
    int32; labels (H - P + 1, W - P + 1) uint8, written; counts (K cells,) int64, added to, at the
    label and what down (H - P + 1,) and right (W - P + 1,) int64 say of the position's cell.
    """
    (height, n_bytes), (rows, columns) = image.shape, labels.shape
    patch = height - rows + 1
    words = weights.shape[1] // patch
    padded = (columns + BLOCK - 1) // BLOCK * BLOCK + 4 * patch
    # A ring of image rows; beyond a row the weights are 0.
    planes = np.zeros((patch, 3, padded), np.int32)
    offsets, out = np.empty(patch * words, np.int64), np.empty(padded, np.uint8)
    line = np.zeros(n_bytes + 16, np.uint8)
    for row in range(height):
        line[:n_bytes] = image[row]
        for j in range(3):
            _fill_plane(line[: n_bytes + 4 * j + 3], 4 * j, planes[row % patch, j])
        y = row - patch + 1
        if y < 0:
            continue
        for r in range(patch):
            for j in range(words):
                offsets[r * words + j] = ((y + r) % patch * 3 + j % 3) * padded + 4 * (j // 3)
        for x in range(0, columns, BLOCK):
            _label_block(planes, x, offsets, weights, bias, out[x:])  # type: ignore[call-arg]  # numba passes the context
        for x in range(columns):
            labels[y, x] = out[x]
            counts[down[y] + right[x] + out[x]] += 1
