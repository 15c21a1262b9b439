"""Parts of the fronts of a sparse factor, each by one call, during which other threads run.

The twin is `plain_fronts`, which calls the same routines front by front: threads wait for one another as often.
Matrices are in the order of C and have upper halves: for LAPACK, in the order of FORTRAN, lower ones.
"""

from __future__ import annotations

from typing import NamedTuple

from musatpy.adjustment.kernels.addresses import address, call
from musatpy.arrays import BoolArray, ByteArray, FloatArray, IntArray
from musatpy.compiling import compiled

_Three = tuple[int, int, int]
_Four = tuple[int, int, int, int]
_Six = tuple[int, int, int, int, int, int]


class Fronts(NamedTuple):
    """f fronts, and room for what those of a subtree need: as many matrices as it has levels."""

    own: IntArray  # (f,) own unknowns
    size: IntArray  # (f,)
    parent: IntArray  # (f,)
    leaf: BoolArray  # (f,) has no children
    eldest: BoolArray  # (f,) is the first child of its parent
    start: IntArray  # (f,) of the own unknowns in the order of elimination
    boundary: IntArray  # the others of all fronts in it
    other: IntArray  # (f + 1,) where those of each begin
    columns: IntArray  # (f,) where the own columns are, as rows of the unknowns of a block
    runs: IntArray  # (r, 3) of the boundary in the parent: first, last, and first there
    run: IntArray  # (f + 1,) where those of each begin
    pairs: IntArray  # (f + 1,) where the blocks of each begin, in the order of the fronts
    order: IntArray  # (e,) rows of these blocks
    turned: BoolArray  # (e,) whether they are on the other side of the diagonal
    rows: IntArray  # (e, size of a block) where they are in the columns
    left: IntArray  # (f,) where there is room for what it leaves
    inverse: IntArray  # (f,) where there is room for its inverse


class Lapack(NamedTuple):
    """Addresses of the routines, what they are called with, and numbers that are written for each call."""

    routines: IntArray  # dpotrf, dpotri, dtrsm, dsyrk, dsymm, dgemm, dtrsv, dgemv
    letters: ByteArray  # LRNT
    factors: FloatArray  # -1, 0, 1
    numbers: IntArray  # (6,) size of the front, own unknowns, others, failure, right sides, 1


@compiled
def _matrix(memory: FloatArray, begin: int, rows: int, columns: int) -> FloatArray:
    return memory[begin : begin + rows * columns].reshape(rows, columns)


@compiled
def _clear(matrix: FloatArray) -> None:
    for i in range(len(matrix)):
        matrix[i, i:] = 0.0


@compiled
def _own(fronts: Fronts, i: int, store: FloatArray, begin: int) -> FloatArray:
    at = (fronts.columns[i] - begin) * fronts.rows.shape[1]
    return _matrix(store, at, fronts.own[i], fronts.size[i])


@compiled
def _left(fronts: Fronts, i: int, last: int, room: FloatArray, update: FloatArray) -> FloatArray:
    others = fronts.size[i] - fronts.own[i]
    return update if i == last - 1 else _matrix(room, fronts.left[i], others, others)


@compiled
def _inverse(fronts: Fronts, i: int, last: int, room: FloatArray, of_root: FloatArray) -> FloatArray:
    return of_root if i == last - 1 else _matrix(room, fronts.inverse[i], fronts.size[i], fronts.size[i])


@compiled
def add_update(update: FloatArray, runs: IntArray, own: FloatArray, left: FloatArray) -> None:
    """Add what a child leaves, whose boundary has the `runs` in a front, to its rows: `own`, then `left`."""
    p = len(own)
    for number in range(len(runs)):
        first, last, at = runs[number]
        for i in range(first, last):
            row = at + i - first
            for other in range(number, len(runs)):
                start, end, to = runs[other]
                if other == number:
                    start, to = i, row
                if row < p:
                    own[row, to : to + end - start] += update[i, start:end]
                else:
                    left[row - p, to - p : to - p + end - start] += update[i, start:end]


@compiled
def hand_down(above: FloatArray, runs: IntArray, inverse: FloatArray, p: int) -> None:
    """Set the inverse of the boundary of a front, behind its p own unknowns, from that of its parent."""
    for number in range(len(runs)):
        first, last, at = runs[number]
        for i in range(first, last):
            row = at + i - first
            for other in range(number, len(runs)):
                start, end, to = runs[other]
                if other == number:
                    start, to = i, row
                inverse[p + i, p + start : p + end] = above[row, to : to + end - start]


@compiled
def enter(first: int, last: int, fronts: Fronts, values: FloatArray, memory: FloatArray) -> None:
    """Let the blocks (e, size, size) of a matrix enter the columns of some fronts (r, size)."""
    size = fronts.rows.shape[1]
    for e in range(fronts.pairs[first], fronts.pairs[last]):
        block = values[fronts.order[e]]
        for a in range(size):
            row = memory[fronts.rows[e, a] - fronts.columns[first]]
            for b in range(size):
                row[b] = block[b, a] if fronts.turned[e] else block[a, b]


@compiled
def _arguments(lapack: Lapack) -> tuple[_Four, _Three, _Six]:
    """Return the addresses of the letters, the factors and the numbers, in their order."""
    letter, factor, number = address(lapack.letters), address(lapack.factors), address(lapack.numbers)
    return (
        (letter, letter + 1, letter + 2, letter + 3),
        (factor, factor + 8, factor + 16),
        (number, number + 8, number + 16, number + 24, number + 32, number + 40),
    )


@compiled
def eliminate(
    first: int, last: int, fronts: Fronts, store: FloatArray, room: FloatArray, update: FloatArray, lapack: Lapack
) -> int:
    """Factorise the fronts of a subtree, whose columns `store` has, and add to the `update` that its root leaves.

    Returns the number of the front that is not positive definite, or -1.
    """
    potrf, _, trsm, syrk, _, _, _, _ = lapack.routines
    (L, R, N, T), (minus_one, _, one), (n_, p_, others_, failed_, _, _) = _arguments(lapack)
    begin = fronts.columns[first]
    for i in range(first, last):
        n, p = fronts.size[i], fronts.own[i]
        lapack.numbers[0], lapack.numbers[1], lapack.numbers[2], lapack.numbers[3] = n, p, n - p, 0
        left = _left(fronts, i, last, room, update)
        if fronts.leaf[i]:
            _clear(left)
        L11 = address(_own(fronts, i, store, begin))
        L21 = L11 + 8 * p
        call(potrf, (L, p_, L11, n_, failed_))
        if lapack.numbers[3] != 0:
            return i
        if n > p:
            call(trsm, (R, L, T, N, others_, p_, one, L11, n_, L21, n_))
            call(syrk, (L, N, others_, p_, minus_one, L21, n_, one, address(left), others_))
        if i < last - 1:
            parent = fronts.parent[i]
            above = _left(fronts, parent, last, room, update)
            if fronts.eldest[i]:
                _clear(above)
            runs = fronts.runs[fronts.run[i] : fronts.run[i + 1]]
            add_update(left, runs, _own(fronts, parent, store, begin), above)
    return -1


@compiled
def invert(
    first: int,
    last: int,
    fronts: Fronts,
    store: FloatArray,
    room: FloatArray,
    of_root: FloatArray,
    out: FloatArray,
    lapack: Lapack,
) -> None:
    """Set the inverse of the root of a subtree, given that of its boundary, and the blocks `out` (e, size, size).

    Of those at the diagonal the upper halves.
    """
    _, potri, trsm, _, symm, gemm, _, _ = lapack.routines
    (L, R, N, T), (minus_one, zero, one), (n_, p_, others_, failed_, _, _) = _arguments(lapack)
    begin, size = fronts.columns[first], fronts.rows.shape[1]
    for i in range(last - 1, first - 1, -1):
        n, p = fronts.size[i], fronts.own[i]
        lapack.numbers[0], lapack.numbers[1], lapack.numbers[2] = n, p, n - p
        inverse = _inverse(fronts, i, last, room, of_root)
        if i < last - 1:
            above = _inverse(fronts, fronts.parent[i], last, room, of_root)
            hand_down(above, fronts.runs[fronts.run[i] : fronts.run[i + 1]], inverse, p)
        own = _own(fronts, i, store, begin)
        W = _matrix(room, 0, p, n - p)
        inverse[:p] = own
        W[:] = own[:, p:]
        Z11, of_W = address(inverse), address(W)
        Z21 = Z11 + 8 * p
        if n > p:
            Z22 = Z21 + 8 * p * n
            call(trsm, (R, L, N, N, others_, p_, one, address(own), n_, of_W, others_))
            call(symm, (L, L, others_, p_, minus_one, Z22, n_, of_W, others_, zero, Z21, n_))
        call(potri, (L, p_, Z11, n_, failed_))
        if n > p:
            call(gemm, (T, N, p_, p_, others_, minus_one, of_W, others_, Z21, n_, one, Z11, n_))
        for e in range(fronts.pairs[i], fronts.pairs[i + 1]):
            block = out[fronts.order[e]]
            for a in range(size):
                row, column = divmod((fronts.rows[e, a] - fronts.columns[i]) * size, n)
                for b in range(size):
                    if fronts.turned[e]:
                        block[b, a] = inverse[row, column + b]
                    else:
                        block[a, b] = inverse[row, column + b]


@compiled
def forward(
    first: int, last: int, fronts: Fronts, store: FloatArray, room: FloatArray, x: FloatArray, lapack: Lapack
) -> None:
    """Solve for the own unknowns of a subtree in the right sides x (u, r), and take them from the others."""
    _, _, trsm, _, _, gemm, trsv, gemv = lapack.routines
    (L, R, N, T), (_, zero, one), (n_, p_, others_, _, r_, one_) = _arguments(lapack)
    begin, r, product = fronts.columns[first], x.shape[1], address(room)
    lapack.numbers[4], lapack.numbers[5] = r, 1
    for i in range(first, last):
        n, p, begin_of_others = fronts.size[i], fronts.own[i], fronts.other[i]
        lapack.numbers[0], lapack.numbers[1], lapack.numbers[2] = n, p, n - p
        L11, of_x = address(_own(fronts, i, store, begin)), address(x) + 8 * r * fronts.start[i]
        L21 = L11 + 8 * p
        if r == 1:
            call(trsv, (L, N, N, p_, L11, n_, of_x, one_))
        else:
            call(trsm, (R, L, T, N, r_, p_, one, L11, n_, of_x, r_))
        if n == p:
            continue
        if r == 1:
            call(gemv, (N, others_, p_, one, L21, n_, of_x, one_, zero, product, one_))
        else:
            call(gemm, (N, T, r_, others_, p_, one, of_x, r_, L21, n_, zero, product, r_))
        for k in range(n - p):
            row = x[fronts.boundary[begin_of_others + k]]
            for c in range(r):
                row[c] -= room[k * r + c]


@compiled
def backward(
    first: int, last: int, fronts: Fronts, store: FloatArray, room: FloatArray, x: FloatArray, lapack: Lapack
) -> None:
    """Solve for the own unknowns of a subtree in x (u, r), where the others are known."""
    _, _, trsm, _, _, gemm, trsv, gemv = lapack.routines
    (L, R, N, T), (minus_one, _, one), (n_, p_, others_, _, r_, one_) = _arguments(lapack)
    begin, r, known = fronts.columns[first], x.shape[1], address(room)
    lapack.numbers[4], lapack.numbers[5] = r, 1
    for i in range(last - 1, first - 1, -1):
        n, p, begin_of_others = fronts.size[i], fronts.own[i], fronts.other[i]
        lapack.numbers[0], lapack.numbers[1], lapack.numbers[2] = n, p, n - p
        L11, of_x = address(_own(fronts, i, store, begin)), address(x) + 8 * r * fronts.start[i]
        L21 = L11 + 8 * p
        for k in range(n - p):
            row = x[fronts.boundary[begin_of_others + k]]
            for c in range(r):
                room[k * r + c] = row[c]
        if n > p:
            if r == 1:
                call(gemv, (T, others_, p_, minus_one, L21, n_, known, one_, one, of_x, one_))
            else:
                call(gemm, (N, N, r_, p_, others_, minus_one, known, r_, L21, n_, one, of_x, r_))
        if r == 1:
            call(trsv, (L, T, N, p_, L11, n_, of_x, one_))
        else:
            call(trsm, (R, L, N, N, r_, p_, one, L11, n_, of_x, r_))
