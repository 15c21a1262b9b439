"""Folders that one batch at a time writes to.

The lock is the system's (flock) on a file that holds the pid for messages. The system gives it up when the last
process that has the file open is gone, however that ended, so that no lock is ever left behind: what a killed batch
leaves is a file that nobody holds. Worker processes inherit the locks: a batch waits until those of a killed one,
which end by themselves, are gone, and never works beside them.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import time
from pathlib import Path
from typing import Any, Self

from musatpy.errors import MusatError
from musatpy.files import NO_LINK, is_alive, is_at, real_path

NAME = ".musat-batch.lock"
_PATIENCE = 30.0  # seconds until the processes of a killed batch must be gone
_PAUSE = 0.05


class LockedError(MusatError):
    """Another batch is at work in a folder."""


class FolderLocks:
    """The locks of a batch, which are given up with the end of the `with` block."""

    def __init__(self) -> None:
        self.fds: dict[Path, int] = {}  # by the file of the lock
        self.taken_over: list[str] = []  # notes about batches that did not end

    def take(self, folder: Path, elsewhere: str = "") -> None:
        """Lock a folder, which is made where it is missing.

        Raises `LockedError` where another batch is at work there, and `OSError` where nothing can be written, with
        what is to be said of how results can go `elsewhere`.
        """
        path = real_path(folder) / NAME
        if path in self.fds:
            return
        try:
            fd = _locked(path)
        except OSError as error:
            if os.path.lexists(path):
                why = f"{error.strerror}; where no batch is at work it may be removed"
                raise OSError(error.errno, why, str(path)) from error
            raise OSError(error.errno, f"{error.strerror}{elsewhere}", str(folder)) from error
        self.fds[path] = fd
        left = _holder(fd)
        if left:
            self.taken_over.append(f"{folder}: took over the lock of a batch that did not end ({_name(left)})")
        # On a full disk the lock holds without the pid, which serves messages only.
        with contextlib.suppress(OSError):
            os.ftruncate(fd, 0)
            os.pwrite(fd, json.dumps({"pid": os.getpid(), "host": socket.gethostname()}).encode(), 0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Give all locks up, and take their files away."""
        for path, fd in self.fds.items():
            with contextlib.suppress(OSError):
                path.unlink()
            os.close(fd)


def _locked(path: Path) -> int:
    """Return an open file that is locked; waits for the processes of a batch that is gone."""
    end = time.monotonic() + _PATIENCE
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            fd = os.open(path, os.O_RDWR | os.O_CREAT | NO_LINK, 0o666)
        except FileNotFoundError:
            continue  # a baseline took its folder away between the two lines
        if _try(fd, path):
            return fd
        holder = _holder(fd)
        os.close(fd)
        late = time.monotonic() > end
        if _alive(holder) or (late and not holder):
            raise LockedError(f"{path.parent}: another batch is at work here ({_name(holder)}); let it end first")
        if late:
            raise LockedError(
                f"{path.parent}: processes of a batch that was killed ({_name(holder)}) are still at work here; "
                f"end them, they have {path.name} open"
            )
        time.sleep(_PAUSE)


def _try(fd: int, path: Path) -> bool:
    """Lock an open file if nobody else has it, and it still is the one of that name."""
    try:
        import fcntl
    except ImportError as error:  # Windows
        raise MusatError("a batch needs the file locks of a POSIX system") from error
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            return False
        os.close(fd)
        raise OSError(error.errno, f"no lock can be had: {error.strerror}", str(path)) from error
    return is_at(fd, path)  # the batch before may have taken the file away between our opening and locking it


def _holder(fd: int) -> dict[str, Any]:
    """Return pid and host that stand in the file of a lock, nothing where they do not."""
    try:
        holder = json.loads(os.pread(fd, 1000, 0) or b"{}")
    except (OSError, ValueError):
        return {}
    return holder if isinstance(holder, dict) and isinstance(holder.get("pid"), int) else {}


def _alive(holder: dict[str, Any]) -> bool:
    """Tell whether the batch that holds a lock may be at work; of another host nobody here knows."""
    if not holder:
        return False
    return holder.get("host") != socket.gethostname() or is_alive(holder["pid"])


def _name(holder: dict[str, Any]) -> str:
    """Return what is known of a batch."""
    if not holder:
        return "pid not known"
    return f"pid {holder['pid']} on {holder.get('host', 'this host')}"
