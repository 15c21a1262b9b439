"""Dense work at a front of a sparse factor, by LAPACK: other threads run meanwhile.

A front has n unknowns, of which the first p are eliminated. Matrices are in the order of FORTRAN, only lower halves
of symmetric ones are looked at. The routines are those of scipy, by the addresses that it has for C: its own
functions for Python keep the others from running.
"""

from __future__ import annotations

import sys
from ctypes import CFUNCTYPE, byref, c_char_p, c_double, c_int, c_int64, c_void_p, py_object, pythonapi
from types import ModuleType
from typing import Any

from scipy.linalg import cython_blas, cython_lapack

from musatpy.arrays import FloatArray

# Of 32 or 64 bits, as scipy was built: where bytes go from the least on, the first half is the number too.
_Int = c_int64 if sys.byteorder == "little" else c_int
_ZERO, _ONE, _MINUS_ONE = (byref(c_double(factor)) for factor in (0.0, 1.0, -1.0))


def _routine(module: ModuleType, name: str, arguments: int) -> Any:
    """Return a routine of scipy, which takes addresses."""
    capsule = module.__pyx_capi__[name]
    name_of, address_of = pythonapi.PyCapsule_GetName, pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = c_char_p, [py_object]
    address_of.restype, address_of.argtypes = c_void_p, [py_object, c_char_p]
    return CFUNCTYPE(None, *[c_void_p] * arguments)(address_of(capsule, name_of(capsule)))


_dpotrf = _routine(cython_lapack, "dpotrf", 5)
_dpotri = _routine(cython_lapack, "dpotri", 5)
_dtrsm = _routine(cython_blas, "dtrsm", 11)
_dsyrk = _routine(cython_blas, "dsyrk", 10)
_dsymm = _routine(cython_blas, "dsymm", 12)


class Columns:
    """The own columns (n, p) of a front, in the order of FORTRAN: of its matrix at first, then L11 and L21."""

    def __init__(self, array: FloatArray) -> None:
        self.array = array
        n, p = array.shape
        self._n, self._p, self._others = (byref(_Int(size)) for size in (n, p, n - p))
        self._L11 = array.ctypes.data
        self._L21 = self._L11 + 8 * p

    def eliminate(self, left: FloatArray) -> bool:
        """Factorise the columns in place, and take L21 L21' from `left` (n - p, n - p).

        Returns whether L11 L11' was positive definite.
        """
        n, p, others, failed = self._n, self._p, self._others, _Int(0)
        _dpotrf(b"L", p, self._L11, n, byref(failed))
        if failed.value:
            return False
        if len(left):
            _dtrsm(b"R", b"L", b"T", b"N", others, p, _ONE, self._L11, n, self._L21, n)
            _dsyrk(b"L", b"N", others, p, _MINUS_ONE, self._L21, n, _ONE, left.ctypes.data, others)
        return True

    def invert(self, inverse: FloatArray) -> None:
        """Set the first p columns of the inverse (n, n) of the front, of which the others are known."""
        n, p, others, first = self._n, self._p, self._others, self.array.shape[1]
        inverse[:, :first] = self.array
        Z11, Z21, W = inverse.ctypes.data, inverse.ctypes.data + 8 * first, self.array[first:].copy(order="F")
        if len(W):
            Z22, of_W = Z21 + 8 * first * len(inverse), W.ctypes.data
            _dtrsm(b"R", b"L", b"N", b"N", others, p, _ONE, self._L11, n, of_W, others)  # L21 L11^-1
            _dsymm(b"L", b"L", others, p, _MINUS_ONE, Z22, n, of_W, others, _ZERO, Z21, n)
        _dpotri(b"L", p, Z11, n, byref(_Int(0)))
        inverse[:first, :first] -= W.T @ inverse[first:, :first]

    def forward(self, x: FloatArray) -> FloatArray:
        """Set x (p, r), in the order of C, to L11^-1 x; return the product of L21 with it."""
        self._solve(x, transposed=False)
        return self.array[len(x) :] @ x

    def backward(self, x: FloatArray, others: FloatArray) -> None:
        """Set x (p, r), in the order of C, to L11^-T (x - L21' others)."""
        if len(others):
            x -= self.array[len(x) :].T @ others
        self._solve(x, transposed=True)

    def _solve(self, x: FloatArray, transposed: bool) -> None:
        trans, r = b"N" if transposed else b"T", byref(_Int(x.shape[1]))  # x' from the right
        _dtrsm(b"R", b"L", trans, b"N", r, self._p, _ONE, self._L11, self._n, x.ctypes.data, r)
