"""Normal equations with a few points more or less, against a factor from scratch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.adjustment.normals import Factor, NormalMatrix, factorised
from musatpy.adjustment.pattern import Pattern
from musatpy.adjustment.updated_factor import UpdatedFactor
from musatpy.arrays import FloatArray, IntArray

PHOTOS, SIZE, GLOBALS = 8, 6, 2
RELATIVE = 1e-9  # some digits go where points go that others hardly replace


def chain() -> NormalMatrix:
    """Normal equations of photos in a strip, each meeting the next two, and of two globals."""
    first = np.arange(PHOTOS - 2)[:, None] + np.arange(3)
    pattern = Pattern.of(PHOTOS, SIZE, [first])
    rng = np.random.default_rng(4)
    matrix = NormalMatrix(
        pattern=pattern,
        blocks=np.zeros((len(pattern.pairs), SIZE, SIZE)),
        border=np.zeros((PHOTOS * SIZE, GLOBALS)),
        corner=np.zeros((GLOBALS, GLOBALS)),
    )
    for photos in first:
        index = unknowns(photos)
        rows = observations(rng, 30, index)
        matrix = plus(matrix, index, rows.T @ rows)
    return matrix


def observations(rng: np.random.Generator, count: int, index: IntArray) -> FloatArray:
    """Return partials of observations: by angles they are some hundred times those by coordinates."""
    return rng.normal(size=(count, len(index))) * np.where(index % SIZE < 3, 1.0, 200.0)


def unknowns(photos: IntArray) -> IntArray:
    """Return the unknowns of photos, and of all globals."""
    of_photos = (photos[:, None] * SIZE + np.arange(SIZE)).reshape(-1)
    return np.concatenate([of_photos, PHOTOS * SIZE + np.arange(GLOBALS)])


def plus(matrix: NormalMatrix, index: IntArray, change: FloatArray) -> NormalMatrix:
    """Return the normal equations plus a change in some unknowns."""
    whole = np.zeros((matrix.size, matrix.size))
    whole[np.ix_(index, index)] = change
    i, j = matrix.pattern.pairs.T
    split = len(matrix.border)
    blocks = whole[:split, :split].reshape(PHOTOS, SIZE, PHOTOS, SIZE).transpose(0, 2, 1, 3)[i, j]
    return replace(
        matrix,
        blocks=matrix.blocks + blocks,
        border=matrix.border + whole[:split, split:],
        corner=matrix.corner + whole[split:, split:],
    )


def factor_of(matrix: NormalMatrix) -> Factor:
    factor = factorised(matrix)
    assert factor is not None
    return factor


def change(index: IntArray, sign: float) -> FloatArray:
    """Return by what three observations change the normal equations, in or out."""
    rows = observations(np.random.default_rng(5), 3, index)
    return sign * rows.T @ rows


@pytest.mark.parametrize("sign", [1.0, -0.2])
def test_an_updated_factor_is_one_from_scratch(sign: float) -> None:
    matrix, index = chain(), unknowns(np.array([2, 3, 4]))
    if sign < 0.0:  # what goes out was in
        matrix = plus(matrix, index, change(index, 1.0))
    updated = UpdatedFactor.of(factor_of(matrix), index, change(index, sign))
    assert updated is not None
    assert updated.columns.shape[1] == 3
    scratch = factor_of(plus(matrix, index, change(index, sign)))
    rhs = np.random.default_rng(6).normal(size=matrix.size) / scratch.scale
    np.testing.assert_allclose(updated.solve(rhs), scratch.solve(rhs), rtol=RELATIVE)
    cofactors, twin = updated.cofactors(), scratch.cofactors()
    for name in ("blocks", "border", "corner"):
        values = getattr(twin, name)
        np.testing.assert_allclose(getattr(cofactors, name), values, rtol=0.0, atol=RELATIVE * np.abs(values).max())
    photo, columns = np.array([[1, 2], [4, 5]]), np.array([[0, 1], [1, 0]])
    some, values = updated.with_border(photo, columns), twin.with_border(photo, columns)
    np.testing.assert_allclose(some, values, rtol=0.0, atol=RELATIVE * np.abs(values).max())
    partials = np.random.default_rng(7).normal(size=(2, 3, some.shape[1]))
    functions = partials @ values @ np.swapaxes(partials, 1, 2)
    of_functions = updated.cofactors_of(photo, columns, partials)
    np.testing.assert_allclose(of_functions, functions, rtol=0.0, atol=RELATIVE * np.abs(functions).max())


def test_normal_equations_that_lose_what_determines_them_are_not_updated() -> None:
    matrix, index = chain(), unknowns(np.array([2, 3, 4]))
    assert UpdatedFactor.of(factor_of(plus(matrix, index, change(index, 1e9))), index, change(index, -1e9)) is None
    assert UpdatedFactor.of(factor_of(matrix), index, change(index, -100.0)) is None


def test_nothing_changed_changes_nothing() -> None:
    factor, nothing = factor_of(chain()), np.zeros(0, dtype=np.int64)
    updated = UpdatedFactor.of(factor, nothing, np.zeros((0, 0)))
    assert updated is not None
    rhs = np.random.default_rng(6).normal(size=factor.matrix.size)
    np.testing.assert_array_equal(updated.solve(rhs), factor.solve(rhs))
    np.testing.assert_array_equal(updated.cofactors().blocks, factor.cofactors().blocks)
