"""Loops that numba compiles (the extra `fast`), point after point; `adjustment.kernels` chooses them."""
