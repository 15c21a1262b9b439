"""Memory that a program has no more use for."""

from __future__ import annotations

from contextlib import suppress


def give_back() -> None:
    """Give memory that is free back to the system where its C library, that of GNU, would keep it.

    After the adjustment of 5,000 photos that is half a gigabyte, and what comes next would stand on top of it.
    """
    import ctypes  # costs the start of every program else

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
