"""Nearest texton at every position of an image, in integers, four bytes at a time.

The largest score 2 p.t - |t|^2 marks the nearest texton. With w = t - 128, which fits a signed byte, p.t is p.w plus
128 sum(p), the same for all textons. So a score is made of products of unsigned with signed bytes, and some processors
add four such products to each of 16 sums in one instruction (AVX-512 VNNI). Others get products of 16-bit pairs.

A row of a patch is 3 P neighbouring bytes of the image: ceil(3 P / 4) words of four bytes. Word j of the patch at column x
starts at byte 3 x + 4 j; word j + 3 at x is thus word j at x + 4, and three planes of words serve a whole image row.
The scores of 4 textons at up to 64 positions stay in registers while all words of the patch pass by.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

LANES, GROUP, BLOCK = 16, 4, 64
_I8, _I16, _I32, _I64 = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_WORDS, _HALVES = ir.VectorType(_I32, LANES), ir.VectorType(_I16, 2 * LANES)


def _constant(kind, value):
    return ir.Constant(kind, [value] * kind.count)


def _splat(builder, value):
    lane = builder.insert_element(ir.Constant(_WORDS, ir.Undefined), value, _I32(0))
    return builder.shuffle_vector(lane, lane, _constant(_WORDS, 0))


def _load(builder, pointer, index):
    return builder.load(builder.bitcast(builder.gep(pointer, [index]), _WORDS.as_pointer()), align=4)


def _dot(builder, vnni, total, pixels, weight):
    """`total` plus, in each lane, the products of four unsigned bytes with four signed ones."""
    if vnni:
        kind = ir.FunctionType(_WORDS, [_WORDS] * 3)
        return builder.call(builder.module.declare_intrinsic("llvm.x86.avx512.vpdpbusd.512", (), kind), [total, pixels, weight])
    pixels, weight = (builder.bitcast(word, _HALVES) for word in (pixels, weight))
    eight, low_byte = _constant(_HALVES, 8), _constant(_HALVES, 255)
    even = builder.and_(pixels, low_byte), builder.ashr(builder.shl(weight, eight), eight)
    odd = builder.lshr(pixels, eight), builder.ashr(weight, eight)
    for factors in (even, odd):
        product = builder.mul(*(builder.sext(half, ir.VectorType(_I32, 2 * LANES)) for half in factors))
        for first in (0, 1):  # neighbouring products added: the form that becomes one instruction on most processors
            lanes = ir.Constant(_WORDS, list(range(first, 2 * LANES, 2)))
            total = builder.add(total, builder.shuffle_vector(product, product, lanes))
    return total


@intrinsic
def _label_block(typing, planes, start, offsets, weights, bias, labels):
    """Label BLOCK positions: words at planes[start + offsets[...] + 0...], labels[0...] (bytes) written."""
    kinds = planes, start, offsets, weights, bias, labels

    def generate(context, builder, signature, arguments):
        vnni = "+avx512vnni" in context.codegen().magic_tuple()[2]
        strips = range(4 if vnni else 1)
        arrays = [None if kind is start else context.make_array(kind)(context, builder, value) for kind, value in zip(kinds, arguments)]
        planes, _, offsets, weights, bias, labels = (array and array.data for array in arrays)
        n_words = cgutils.unpack_tuple(builder, arrays[2].shape)[0]
        n_groups = cgutils.unpack_tuple(builder, arrays[3].shape)[0]
        best, label, totals = ([cgutils.alloca_once(builder, _WORDS) for _ in range(n)] for n in (4, 4, 4 * GROUP))
        with cgutils.for_range_slice(builder, _I64(0), _I64(BLOCK), _I64(LANES * len(strips)), _I64) as (block, _):
            for s in strips:
                builder.store(_constant(_WORDS, -(2**31)), best[s])
            with cgutils.for_range(builder, n_groups) as group:
                for total in totals:
                    builder.store(_constant(_WORDS, 0), total)
                with cgutils.for_range(builder, n_words) as word:
                    place = builder.add(builder.add(arguments[1], block), builder.load(builder.gep(offsets, [word.index])))
                    pixels = [_load(builder, planes, builder.add(place, _I64(LANES * s))) for s in strips]
                    row = builder.add(builder.mul(group.index, n_words), word.index)
                    for t in range(GROUP):
                        item = builder.add(builder.mul(row, _I64(GROUP)), _I64(t))
                        weight = _splat(builder, builder.load(builder.gep(weights, [item])))
                        for s in strips:
                            total = totals[GROUP * s + t]
                            builder.store(_dot(builder, vnni, builder.load(total), pixels[s], weight), total)
                for t in range(GROUP):
                    texton = builder.add(builder.mul(group.index, _I64(GROUP)), _I64(t))
                    offset, name = _splat(builder, builder.load(builder.gep(bias, [texton]))), _splat(builder, builder.trunc(texton, _I32))
                    for s in strips:
                        score = builder.add(builder.shl(builder.load(totals[GROUP * s + t]), _constant(_WORDS, 1)), offset)
                        held = builder.load(best[s])
                        better = builder.icmp_signed(">", score, held)  # strict: ties stay with the lower index
                        builder.store(builder.select(better, score, held), best[s])
                        builder.store(builder.select(better, name, builder.load(label[s])), label[s])
            for s in strips:
                place = builder.gep(labels, [builder.add(block, _I64(LANES * s))])
                bytes_ = ir.VectorType(_I8, LANES)
                builder.store(builder.trunc(builder.load(label[s]), bytes_), builder.bitcast(place, bytes_.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(*kinds), generate


@njit(cache=True, nogil=True)
def _fill_plane(line, start, plane):
    """The word of four bytes that starts at byte 3 x + `start`, for every x; bytes beyond the line count as 0."""
    whole = max(0, (len(line) - start - 1) // 3)
    for x in range(whole):
        byte = np.uint64(3 * x + start)
        low = np.uint32(line[byte]) | np.uint32(line[byte + np.uint64(1)]) << np.uint32(8)
        high = np.uint32(line[byte + np.uint64(2)]) | np.uint32(line[byte + np.uint64(3)]) << np.uint32(8)
        plane[x] = low | high << np.uint32(16)
    for x in range(whole, len(line) // 3):
        word = np.uint32(0)
        for i in range(max(0, len(line) - 3 * x - start)):
            word |= np.uint32(line[3 * x + start + i]) << np.uint32(8 * i)
        plane[x] = word


@njit(cache=True, nogil=True)
def label_rows(image, weights, bias, labels, counts):
    """Label all positions of an image (or a strip of one) and count the labels.

    image (H, 3 W) uint8; weights (G, P * words, GROUP) int32, each four signed bytes; bias (G * GROUP,) int32;
    labels (H - P + 1, W - P + 1) uint8, written; counts (K,) int64, added to.
    """
    height, n_bytes = image.shape
    rows, columns = labels.shape
    patch = height - rows + 1
    words = weights.shape[1] // patch
    padded = (columns + BLOCK - 1) // BLOCK * BLOCK + 4 * patch
    planes = np.zeros((patch, 3, padded), np.int32)  # a ring of image rows; beyond the end of a row the weights are 0
    offsets = np.empty(patch * words, np.int64)
    line = np.empty(padded, np.uint8)
    for row in range(height):
        for j in range(3):
            _fill_plane(image[row], 4 * j, planes[row % patch, j])
        y = row - patch + 1
        if y < 0:
            continue
        for r in range(patch):
            for j in range(words):
                offsets[r * words + j] = ((y + r) % patch * 3 + j % 3) * padded + 4 * (j // 3)
        for x in range(0, columns, BLOCK):
            _label_block(planes, x, offsets, weights, bias, line[x:])
        for x in range(columns):
            labels[y, x] = line[x]
            counts[line[x]] += 1
