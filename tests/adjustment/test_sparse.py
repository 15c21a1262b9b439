"""The multifrontal factor and its selected inverse, against dense matrices; pieces of work on threads."""

import multiprocessing
import os
import threading
import time

import numpy as np
import pytest

from musatpy.adjustment import kernels
from musatpy.adjustment.kernels import side_by_side
from musatpy.adjustment.normals import NormalMatrix, factorised
from musatpy.adjustment.sparse import Pattern, factorise


def placed_cliques(
    strips: int, photos: int, rng: np.random.Generator, blocks: int = 1
) -> tuple[int, list[np.ndarray], np.ndarray]:
    """Return a block of photos, or several that do not meet, and their places, in strips that run askew.

    Neighbours along and across the strips meet; photos are numbered at random.
    """
    size = strips * photos
    ids = rng.permutation(size).reshape(strips, photos)
    strip, along = np.divmod(np.argsort(ids.reshape(-1)), photos)
    place = np.stack([along + 0.5 * strip, 2.0 * strip - 0.3 * along, np.full(len(strip), 9.0)], axis=1)
    cliques: dict[int, list[np.ndarray]] = {}
    for s in range(strips):
        for p in range(photos):
            near = ids[s : s + 2, p : p + 3].reshape(-1)
            cliques.setdefault(len(near), []).extend(near + size * block for block in range(blocks))
    places = np.concatenate([np.add(place, [1e3 * block, 0.0, 0.0]) for block in range(blocks)])
    return size * blocks, [np.array(rows) for rows in cliques.values()], places


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


@pytest.mark.parametrize(
    ("strips", "photos", "parts"), [(1, 1, 1), (1, 2, 1), (1, 40, 1), (3, 9, 1), (9, 14, 1), (2, 20, 2)]
)
@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize("placed", [False, True])
@pytest.mark.parametrize("shared", [False, True])
def test_solution_and_selected_inverse_are_those_of_the_dense_matrix(
    monkeypatch: pytest.MonkeyPatch, strips: int, photos: int, parts: int, size: int, placed: bool, shared: bool
) -> None:
    """Of fronts worked at one after the other, or `shared` by threads."""
    if shared:
        monkeypatch.setattr(kernels, "_FEWEST", 0)
    rng = np.random.default_rng(strips * 100 + photos)
    count, cliques, place = placed_cliques(strips, photos, rng, parts)
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
        partials = rng.normal(size=(len(clique), 2, rows.shape[1]))
        functions = factor.cofactors().cofactors_of(clique, index, partials)
        of_them = partials @ expected @ np.swapaxes(partials, 1, 2)
        np.testing.assert_allclose(functions, of_them, atol=1e-12 * np.abs(of_them).max())


def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    count, cliques, _ = placed_cliques(2, 30, np.random.default_rng(6))
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


MANY = 10**6  # rays


@pytest.fixture
def cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 3)


@pytest.mark.usefixtures("cores")
def test_a_piece_may_share_its_work_which_its_own_thread_does() -> None:
    def work(piece: int) -> set[str]:
        return {threading.current_thread().name, *side_by_side(inner, range(4), MANY)}

    def inner(_: int) -> str:
        return threading.current_thread().name

    assert all(len(names) == 1 for names in side_by_side(work, range(12), MANY))


@pytest.mark.usefixtures("cores")
def test_what_a_piece_raises_is_raised_when_nothing_runs_any_more() -> None:
    running: set[int] = set()

    def work(piece: int) -> None:
        if piece == 1:
            raise ValueError(piece)
        running.add(piece)
        time.sleep(0.02)
        running.remove(piece)

    with pytest.raises(ValueError, match="1"):
        list(side_by_side(work, range(20), MANY))
    assert not running


def _sum() -> int:
    return sum(side_by_side(abs, range(10), MANY))


@pytest.mark.usefixtures("cores")
@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own() -> None:
    assert _sum() == 45
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(_sum).get(timeout=20) == 45
