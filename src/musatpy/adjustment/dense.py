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
_ZERO, _ONE, _MINUS_ONE, _STEP = byref(c_double(0.0)), byref(c_double(1.0)), byref(c_double(-1.0)), byref(_Int(1))


def _routine(module: ModuleType, name: str, arguments: int) -> Any:
    """Return a routine of scipy, to be called with addresses."""
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
_dgemm = _routine(cython_blas, "dgemm", 13)


def _int(number: int) -> Any:
    return byref(_Int(number))


def _address(array: FloatArray) -> int:
    return array.ctypes.data


def eliminate(columns: FloatArray, left: FloatArray) -> bool:
    """Factorise the columns (n, p) of a front in place, L11 and L21, and take L21 L21' from `left` (n - p, n - p).

    Returns whether L11 L11' was positive definite.
    """
    n, p = columns.shape
    failed = _Int(0)
    L11, ld, own, others = _address(columns), _int(n), _int(p), _int(n - p)
    _dpotrf(b"L", own, L11, ld, byref(failed))
    if failed.value:
        return False
    if n > p:
        L21 = L11 + 8 * p
        _dtrsm(b"R", b"L", b"T", b"N", others, own, _ONE, L11, ld, L21, ld)
        _dsyrk(b"L", b"N", others, own, _MINUS_ONE, L21, ld, _ONE, _address(left), others)
    return True


def invert(columns: FloatArray, inverse: FloatArray) -> None:
    """Set the first p columns of the inverse (n, n) of a front, of which the others are known.

    `columns` (n, p) are L11 and L21.
    """
    n, p = columns.shape
    inverse[:, :p] = columns
    Z, ld, own, others = _address(inverse), _int(n), _int(p), _int(n - p)
    if n > p:
        W = columns[p:].copy(order="F")
        _dtrsm(b"R", b"L", b"N", b"N", others, own, _ONE, _address(columns), ld, _address(W), others)  # L21 L11^-1
        Z22 = Z + 8 * (n + 1) * p
        _dsymm(b"L", b"L", others, own, _MINUS_ONE, Z22, ld, _address(W), others, _ZERO, Z + 8 * p, ld)
    _dpotri(b"L", own, Z, ld, byref(_Int(0)))
    if n > p:
        _dgemm(b"T", b"N", own, own, others, _MINUS_ONE, _address(W), others, Z + 8 * p, ld, _ONE, Z, ld)


def solve_lower(columns: FloatArray, x: FloatArray, transposed: bool) -> None:
    """Set x (p, r) to L11^-1 x, or to that of L11'; of `columns` (n, p)."""
    p, r = x.shape
    trans = b"T" if transposed else b"N"
    L11, of_x = _int(len(columns)), _int(max(p, x.strides[1] // 8))  # the strides of one vector may be any
    _dtrsm(b"L", b"L", trans, b"N", _int(p), _int(r), _ONE, _address(columns), L11, _address(x), of_x)
