"""Memory that a program has no more use for, and that it may not have; the cores that it may use."""

from __future__ import annotations

import mmap
import os
import sys
from contextlib import suppress
from functools import cache

_WORKING_MEMORY = 40 << 20  # bytes, a little more than OpenBLAS takes
_LIBRARY = 95 << 20  # bytes that numpy takes with its libraries, or scipy, when they are loaded


def give_back() -> None:
    """Give memory that is free back to the system where its C library, that of GNU, would keep it.

    After the adjustment of 5,000 photos that is half a gigabyte, and what comes next would stand on top of it.
    """
    import ctypes  # costs the start of every program else

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def limit() -> int | None:
    """Return how many bytes this process may have (`ulimit -v`), None where nothing but the machine bounds it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    bound = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if bound == resource.RLIM_INFINITY else bound


@cache
def take_working_memory() -> None:
    """Have the linear algebra take its memory while it is known to be there; raises `MemoryError` where it is not.

    OpenBLAS, of which numpy and scipy have one each, takes 32 MB when it is first used, which may be while it is
    loaded. Where the system refuses them (`ulimit -v`) some of its versions end the process, and others ask for
    ever: the job would never end.
    """
    try:
        _require_room("numpy")
        import numpy as np

        np.linalg.cholesky(np.eye(1))
        _require_room("scipy.linalg")
        from scipy.linalg.lapack import dpotrf

        dpotrf(np.eye(1))
        _require_room("numpy")  # of a small job: without it the interpreter fails where no message can be given
    except (ImportError, OSError) as error:  # libraries find no room either
        raise MemoryError from error


def _require_room(library: str) -> None:
    """Raise `OSError` where there is none for a library, if it is not loaded yet, and its working memory."""
    mmap.mmap(-1, _WORKING_MEMORY + (0 if library in sys.modules else _LIBRARY)).close()


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
