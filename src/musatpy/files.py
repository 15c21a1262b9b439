"""Files that a program leaves: whole, or as they were."""

from __future__ import annotations

import errno
import os
import re
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

_LOCK = ".lock"
NO_LINK = getattr(os, "O_NOFOLLOW", 0)  # Windows has none


class _Held(threading.local):
    """The locks of a thread, of the blocks of `together` that it is in: file of the lock -> its descriptor."""

    fds: dict[Path, int] | None = None


_held = _Held()


def real_path(path: Path) -> Path:
    """Return where a path leads; unlike `Path.resolve` one whose links lead in a circle stays as it is."""
    return Path(os.path.realpath(path))


def name_fault(name: str) -> str:
    """Return why a name that an input gives is not the plain name of a file, which stays in its folder.

    Empty for one that is. Names with separators, drives, `..` or characters that are not printable lead elsewhere,
    on this system or another one, or hide what they are.
    """
    if not name.strip(". "):
        return "is no name of a file"
    if not name.isprintable():
        return "has a character that is not printable"
    if any(character in name for character in "/\\:"):
        return "is not a plain name: results stay in their folder"
    return ""


def write_files(files: Mapping[Path, bytes | memoryview | Iterable[bytes]], outdated: Iterable[Path] = ()) -> None:
    """Write all files under temporary names in their folders, then rename them: never half a file.

    Contents are whole, or come piece by piece. None is renamed before all are written, so that a full disk leaves
    the files of an earlier run as they were, nor while another process renames files the first of which has the
    same name: what stands there in the end is of one of them. What is `outdated` is removed just before the last
    file, which may tell of all, gets its name. Folders that are missing are made, and what killed processes left of
    the files removed. Raises `OSError`.
    """
    remove_leftovers(files)
    places, outdated = list(files), list(outdated)
    with ExitStack() as stack:
        temporary = {path: _temporary(path) for path in places}
        for path, data in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with _about(path), temporary[path].open("xb") as file:  # one that is new, and no link
                stack.callback(_remove, temporary[path])
                file.writelines([data] if isinstance(data, bytes | memoryview) else data)
                _to_disk(file)
        stack.enter_context(together())
        if len(places) + len(outdated) > 1:
            _lock(places[0])
        for path in places[:-1]:
            _rename(temporary[path], path)
        for path in outdated:
            with _about(path):
                path.unlink(missing_ok=True)
        for path in places[-1:]:
            _rename(temporary[path], path)


def write_file(path: Path, data: bytes | memoryview) -> None:
    """Write one file as `write_files` does. Raises `OSError`."""
    write_files({path: data})


@contextmanager
def together() -> Iterator[None]:
    """Keep the locks of all `write_files` in a block until it ends: what it writes one after another is of one run.

    Another process that writes files of these names waits for its end. Blocks within blocks are part of these.
    """
    if _held.fds is not None:
        yield
        return
    fds = _held.fds = {}
    try:
        yield
    finally:
        _held.fds = None
        for path, fd in fds.items():
            with suppress(OSError):
                path.unlink()
            os.close(fd)


def _lock(path: Path) -> None:
    """Lock the files that go with one of this name, until the block of `together` ends.

    As the lock of a batch, a system's lock on a file that is taken away; file systems that have none go without.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        return
    place = real_path(path.parent) / f".{path.name}{_LOCK}"
    assert _held.fds is not None
    while place not in _held.fds:
        fd = os.open(place, os.O_RDONLY | os.O_CREAT | NO_LINK, 0o666)
        try:
            with suppress(OSError):
                fcntl.flock(fd, fcntl.LOCK_EX)
            if is_at(fd, place):
                _held.fds[place] = fd
        finally:
            if place not in _held.fds:
                os.close(fd)


def is_at(fd: int, path: Path) -> bool:
    """Tell whether an open file still is the one of a name: who held its lock may have taken it away meanwhile."""
    try:
        return os.path.samestat(os.fstat(fd), os.stat(path))
    except FileNotFoundError:
        return False


def _temporary(path: Path) -> Path:
    """Return a name beside a file that nobody can know before, and by which `remove_leftovers` knows it."""
    return path.with_name(f".{path.name}.{os.getpid()}.{os.urandom(8).hex()}")


def _to_disk(file: BinaryIO) -> None:
    """Have the system write a file to the disk: after a loss of power its new name may be there without it else."""
    file.flush()
    os.fsync(file.fileno())


def _rename(temporary: Path, path: Path) -> None:
    """Give a file its own name; raises `OSError` about that name."""
    with _about(path):
        temporary.replace(path)


@contextmanager
def _about(path: Path) -> Iterator[None]:
    """Let what the system says name the file that is meant, and not a temporary one, or none for a full disk."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def remove_leftovers(paths: Iterable[Path]) -> None:
    """Remove what killed processes left of these files under temporary names; those at work keep theirs.

    What may not be removed stays: it is in nobody's way.
    """
    folders: dict[Path, set[str]] = {}
    for path in paths:
        folders.setdefault(path.parent, set()).add(path.name)
    for folder, names in folders.items():
        for name in os.listdir(folder) if os.path.isdir(folder) else ():
            parts = re.fullmatch(r"\.(.+)\.(\d+)\.[0-9a-f]{16}", name) if name[0] == "." else None
            if parts and parts[1] in names and not is_alive(int(parts[2])):
                _remove(folder / name)
            elif name[0] == "." and name.endswith(_LOCK) and name[1 : -len(_LOCK)] in names:
                _remove_lock(folder / name)


def _remove_lock(path: Path) -> None:
    """Remove the file of a lock that nobody holds."""
    with suppress(OSError, ImportError):
        import fcntl

        fd = os.open(path, os.O_RDONLY | NO_LINK)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
        finally:
            os.close(fd)


def _remove(left: Path) -> None:
    """Remove a temporary file, or the folder of one."""
    with suppress(OSError):
        if left.is_dir() and not left.is_symlink():
            from shutil import rmtree  # rarely needed

            rmtree(left)
        else:
            left.unlink()


def is_alive(pid: int) -> bool:
    """Tell whether a process of this machine is at work, whoever's it is.

    One that has ended and that no parent has waited for (a zombie) is not: where the first process of a container
    waits for none, the orphans of a killed batch stay so.
    """
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    try:
        stat = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:  # no Linux
        return True
    return stat.rpartition(b")")[2].split()[:1] != [b"Z"]  # the state follows the command, which may hold ")"


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file for writing under a temporary name in its folder; it gets its own when all is written.

    A missing folder is made, and what a killed process left of the file removed. Raises `OSError`.
    """
    with whole_path(path) as inside:
        try:
            with inside.open("xb") as file:
                yield file
        except OSError as error:
            if error.filename is None:  # of a full disk, which names no file
                raise OSError(error.errno, error.strerror, str(path)) from error
            raise


@contextmanager
def whole_path(path: Path) -> Iterator[Path]:
    """Yield a name under which a package writes a file; it gets its own at the end.

    That is in a temporary folder beside it, which is this user's alone: packages write through links. A missing
    folder is made, and what a killed process left of the file removed. Raises `OSError`.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers([path])
    folder = _temporary(path)
    with _about(path):
        folder.mkdir(mode=0o700)
    inside = folder / path.name
    try:
        yield inside
        with _about(path), inside.open("rb+") as file:
            _to_disk(file)
        _rename(inside, path)
    finally:
        _remove(folder)
