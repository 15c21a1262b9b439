"""LAPACK at one front, against the functions of numpy, and whether other threads run meanwhile."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from musatpy.adjustment.dense import Columns

SIZES = [(1, 1), (6, 6), (30, 12), (150, 60)]  # n unknowns, p eliminated


def matrix(n: int) -> np.ndarray:
    """Return a positive definite matrix (n, n)."""
    J = np.random.default_rng(n).normal(size=(3 * n, n))
    return J.T @ J


def front(n: int, p: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (n, p) of a front and what is left (n - p, n - p), the upper halves of both anything."""
    lower = np.asfortranarray(np.tril(matrix(n)) + np.triu(np.full((n, n), np.nan), 1))
    return lower[:, :p], lower[p:, p:].copy(order="F")


@pytest.mark.parametrize(("n", "p"), SIZES)
def test_elimination(n: int, p: int) -> None:
    columns, left = front(n, p)
    assert Columns(columns).eliminate(left)
    N = matrix(n)
    L = np.linalg.cholesky(N)
    below = np.tril_indices(n, m=p)
    np.testing.assert_allclose(columns[below], L[below], rtol=1e-11, atol=1e-12)
    rest = np.tril_indices(n - p)
    expected = N[p:, p:] - L[p:, :p] @ L[p:, :p].T
    np.testing.assert_allclose(left[rest], expected[rest], rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("n", "p"), SIZES)
def test_inverse(n: int, p: int) -> None:
    columns, left = front(n, p)
    Columns(columns).eliminate(left)
    expected = np.linalg.inv(matrix(n))
    inverse = np.asfortranarray(np.tril(expected) + np.triu(np.full((n, n), np.nan), 1))
    inverse[:, :p] = np.nan
    Columns(columns).invert(inverse)
    below = np.tril_indices(n)
    np.testing.assert_allclose(inverse[below], expected[below], rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize(("n", "p"), SIZES)
@pytest.mark.parametrize("r", [1, 3])
def test_triangles(n: int, p: int, r: int) -> None:
    columns, left = front(n, p)
    L = Columns(columns)
    L.eliminate(left)
    expected = np.linalg.cholesky(matrix(n))[:, :p]
    rhs = np.random.default_rng(n).normal(size=(n, r))
    x = rhs[:p].copy()
    np.testing.assert_allclose(L.forward(x), expected[p:] @ x, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(expected[:p] @ x, rhs[:p], rtol=1e-10, atol=1e-12)
    y = x.copy()
    L.backward(x, rhs[p:])
    np.testing.assert_allclose(expected.T @ np.concatenate([x, rhs[p:]]), y, rtol=1e-10, atol=1e-12)


def test_a_front_that_is_not_positive_definite() -> None:
    columns = np.asfortranarray([[4.0], [1.0]])
    columns[0] = -4.0
    assert not Columns(columns).eliminate(np.ones((1, 1), order="F"))


def test_other_threads_run_meanwhile() -> None:
    """This one counts while another is at a front."""

    def counted() -> int:
        columns = np.asfortranarray(N)
        at_work = threading.Event()

        def work() -> None:
            at_work.set()
            Columns(columns).eliminate(np.zeros((0, 0), order="F"))
            at_work.clear()

        other, count = threading.Thread(target=work), 0
        other.start()
        at_work.wait(1.0)
        while at_work.is_set():
            count += 1
        other.join()
        return count

    N = matrix(600)
    assert any(counted() > 1000 for _ in range(200))
