"""The multifrontal factor and its selected inverse, against dense matrices."""

import os

import numpy as np
import pytest

from musatpy.adjustment import kernels
from musatpy.adjustment.normals import Cofactors, NormalMatrix, factorised
from musatpy.adjustment.sparse import Pattern, factorise


def cliques_of(strips: int, photos: int, rng: np.random.Generator) -> tuple[int, list[np.ndarray]]:
    """Return a block of photos in which neighbours along and across the strips meet, numbered at random."""
    count, cliques, _ = placed_cliques(strips, photos, rng)
    return count, cliques


def placed_cliques(strips: int, photos: int, rng: np.random.Generator) -> tuple[int, list[np.ndarray], np.ndarray]:
    """Return these with the places of the photos, in strips that run askew."""
    ids = rng.permutation(strips * photos).reshape(strips, photos)
    strip, along = np.divmod(np.argsort(ids.reshape(-1)), photos)
    place = np.stack([along + 0.5 * strip, 2.0 * strip - 0.3 * along, np.full(len(strip), 9.0)], axis=1)
    cliques: dict[int, list[np.ndarray]] = {}
    for s in range(strips):
        for p in range(photos):
            near = ids[s : s + 2, p : p + 3].reshape(-1)
            cliques.setdefault(len(near), []).append(near)
    return strips * photos, [np.array(rows) for rows in cliques.values()], place


def matrix_on(pattern: Pattern, cliques: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Return blocks (e, q, q) of a positive definite matrix that has the pattern of the cliques."""
    q = pattern.size
    blocks = np.zeros((len(pattern.pairs), q, q))
    for clique in cliques:
        k, m = clique.shape
        J = rng.normal(size=(k, 9 * m, q * m))
        N = np.einsum("kai,kaj->kij", J, J).reshape(k, m, q, m, q)
        for a in range(m):
            for b in range(m):
                upper = clique[:, a] <= clique[:, b]
                rows = pattern.find(clique[upper, a], clique[upper, b])
                np.add.at(blocks, rows, N[upper][:, a, :, b, :])
    return blocks


def dense(pattern: Pattern, blocks: np.ndarray) -> np.ndarray:
    n, q = pattern.count, pattern.size
    whole = np.zeros((n, q, n, q))
    i, j = pattern.pairs.T
    whole[i, :, j] = blocks
    whole[j, :, i] = np.swapaxes(blocks, 1, 2)
    return whole.reshape(n * q, n * q)


@pytest.mark.parametrize(("strips", "photos"), [(1, 1), (1, 2), (1, 40), (3, 9), (9, 14)])
@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize("placed", [False, True])
@pytest.mark.parametrize("shared", [False, True])
def test_solution_and_selected_inverse_are_those_of_the_dense_matrix(
    monkeypatch: pytest.MonkeyPatch, strips: int, photos: int, size: int, placed: bool, shared: bool
) -> None:
    """Of fronts worked at one after the other, or `shared` by threads."""
    if shared:
        monkeypatch.setattr(kernels, "_FEWEST", 0)
    rng = np.random.default_rng(strips * 100 + photos)
    count, cliques, place = placed_cliques(strips, photos, rng)
    pattern = Pattern.of(count, size, cliques, place if placed else None)
    blocks = matrix_on(pattern, cliques, rng)
    N = dense(pattern, blocks)
    factor = factorise(pattern, blocks)
    rhs = rng.normal(size=(count * size, 3))
    # the matrices are well conditioned: rounding only
    np.testing.assert_allclose(N @ factor.solve(rhs), rhs, atol=1e-10)
    np.testing.assert_allclose(factor.solve(rhs[:, 0]), factor.solve(rhs)[:, 0], atol=1e-14)
    np.testing.assert_array_equal(factor.solve(np.asfortranarray(rhs)), factor.solve(rhs))
    inverse = np.linalg.inv(N).reshape(count, size, count, size)
    i, j = pattern.pairs.T
    np.testing.assert_allclose(factor.selected_inverse(), inverse[i, :, j], atol=1e-12 * np.abs(inverse).max())


def test_cofactors_of_photos_in_any_order_are_those_of_the_dense_matrix() -> None:
    rng = np.random.default_rng(5)
    count, cliques = cliques_of(3, 6, rng)
    pattern = Pattern.of(count, 6, cliques)
    blocks = matrix_on(pattern, cliques, rng)
    nothing = np.zeros((6 * count, 0))
    cofactors = Cofactors(pattern=pattern, blocks=blocks, border=nothing, corner=np.zeros((0, 0)))
    whole = dense(pattern, blocks)
    for clique in cliques:
        rows = pattern.rows(clique)
        of_rows = whole[rows[:, :, None], rows[:, None, :]]
        np.testing.assert_allclose(cofactors.of_photos(clique), of_rows, rtol=1e-12)
        partials, index = rng.normal(size=(len(clique), 2, rows.shape[1])), np.zeros((len(clique), 0), dtype=int)
        expected = partials @ of_rows @ np.swapaxes(partials, 1, 2)
        for some in (slice(None), slice(0)):  # all points, and none
            functions = cofactors.cofactors_of(clique[some], index[some], partials[some])
            np.testing.assert_allclose(functions, expected[some], atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("placed", [False, True])
@pytest.mark.parametrize("g", [0, 2])
def test_cofactors_of_a_bordered_matrix_are_those_of_the_dense_one(placed: bool, g: int) -> None:
    rng = np.random.default_rng(8)
    count, cliques, place = placed_cliques(5, 9, rng)
    pattern = Pattern.of(count, 6, cliques, place if placed else None)
    blocks, border = matrix_on(pattern, cliques, rng), rng.normal(size=(6 * count, g))
    corner = border.T @ factorise(pattern, blocks).solve(border) + np.eye(g)
    factor = factorised(NormalMatrix(pattern=pattern, blocks=blocks, border=border, corner=corner))
    assert factor is not None
    whole = np.linalg.inv(np.block([[dense(pattern, blocks), border], [border.T, corner]]))
    for clique in cliques:
        index = rng.integers(0, max(g, 1), (len(clique), 3 if g else 0))
        rows = np.concatenate([pattern.rows(clique), 6 * count + index], axis=1)
        expected = whole[rows[:, :, None], rows[:, None, :]]
        found = factor.cofactors().with_border(clique, index)
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_parts_that_do_not_meet_are_factorised_one_by_one() -> None:
    rng = np.random.default_rng(4)
    _, first = cliques_of(2, 20, rng)
    cliques = [*first, *(clique + 40 for clique in first)]
    pattern = Pattern.of(80, 6, cliques)
    blocks = matrix_on(pattern, cliques, rng)
    rhs = rng.normal(size=480)
    np.testing.assert_allclose(dense(pattern, blocks) @ factorise(pattern, blocks).solve(rhs), rhs, atol=1e-10)


def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    count, cliques = cliques_of(2, 30, np.random.default_rng(6))
    pattern = Pattern.of(count, 6, cliques)
    blocks = matrix_on(pattern, cliques, np.random.default_rng(7))
    blocks[pattern.find(np.array([17]), np.array([17]))] = -np.eye(6)
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        factorise(pattern, blocks)


def test_factor_and_inverse_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit by bit: every front is worked at by one thread, its children added in their order."""
    rng = np.random.default_rng(5)
    count, cliques, place = placed_cliques(12, 30, rng)
    blocks = matrix_on(Pattern.of(count, 6, cliques), cliques, rng)
    monkeypatch.setattr(kernels, "_FEWEST", 0)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    found = []
    for most in (1, 3):
        monkeypatch.setattr(kernels, "_MOST", most)
        pattern = Pattern.of(count, 6, cliques, place)
        subtrees, *above = pattern.elimination.stages
        assert len(subtrees) > 4 and len(above) > 2
        fronts = [front for stage in pattern.elimination.stages for part in stage for front in part]
        assert sorted(fronts) == list(range(len(pattern.elimination.fronts)))
        factor = factorise(pattern, blocks)
        found.append((factor.solve(np.ones(6 * count)), factor.selected_inverse()))
    for a, b in zip(*found, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("exponent", range(-12, 0))
@pytest.mark.parametrize("limit", [1e-10, 1e-8, 1e-4])
def test_weak_is_what_has_a_smallest_eigenvalue_below_the_limit(exponent: int, limit: float) -> None:
    """Of a matrix with a unit diagonal, in which all blocks meet: it is weak against one alternating vector."""
    count, size, weakest = 6, 6, 3.0 * 10.0**exponent
    u = (-1.0) ** np.arange(count * size)
    N = np.eye(len(u)) + (weakest - 1.0) * (np.outer(u, u) - np.eye(len(u))) / (len(u) - 1)
    np.testing.assert_allclose(np.linalg.eigvalsh(N)[0], weakest, atol=1e-14)
    pattern = Pattern.of(count, size, [np.arange(count)[None]])
    i, j = pattern.pairs.T
    blocks = N.reshape(count, size, count, size)[i, :, j]
    corner = np.zeros((0, 0))
    factor = factorised(NormalMatrix(pattern=pattern, blocks=blocks, border=np.zeros((len(u), 0)), corner=corner))
    assert factor is not None
    assert factor.is_weak(limit) == (weakest < limit)
