"""Files that a program leaves: whole, or as they were."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

_JOURNAL = "-journal"  # behind the name of a database of SQLite, while it is written


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
    the files of an earlier run as they were. What is `outdated` is removed just before the last file, which may
    tell of all, gets its name. Folders that are missing are made. Raises `OSError`.
    """
    # `remove_leftovers` knows the temporary names
    temporary = {path: path.with_name(f".{path.name}.{os.getpid()}") for path in files}
    try:
        for path, data in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with _about(path), temporary[path].open("wb") as file:
                file.writelines([data] if isinstance(data, bytes | memoryview) else data)
                _to_disk(file)
        places = list(files)
        for path in places[:-1]:
            _rename(temporary[path], path)
        for path in outdated:
            with _about(path):
                path.unlink(missing_ok=True)
        for path in places[-1:]:
            _rename(temporary[path], path)
    finally:
        for leftover in temporary.values():
            with suppress(OSError):  # why nothing could be written is told already
                leftover.unlink()


def write_file(path: Path, data: bytes | memoryview) -> None:
    """Write one file as `write_files` does; what a killed process left of it is removed. Raises `OSError`."""
    remove_leftovers([path])
    write_files({path: data})


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
        for left in folder.glob(".*") if os.path.isdir(folder) else ():
            parts = re.fullmatch(rf"\.(.+)\.(\d+)(?:{_JOURNAL})?", left.name)
            if parts and parts[1] in names and not is_alive(int(parts[2])):
                with suppress(OSError):
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
    return not _is_zombie(pid)


def _is_zombie(pid: int) -> bool:
    """Tell whether a process has ended, by Linux's table of them; no where there is none."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return False
    return stat.rpartition(b")")[2].split()[:1] == [b"Z"]  # the state follows the command, which may hold ")"


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file for writing under a temporary name in its folder; it gets its own when all is written.

    A missing folder is made, and what a killed process left of the file removed. Raises `OSError`.
    """
    with whole_path(path) as temporary:
        try:
            file = temporary.open("wb")
        except OSError as error:  # of the name that was asked for
            raise OSError(error.errno, error.strerror, str(path)) from error
        try:
            with file:
                yield file
                file.flush()
        except OSError as error:
            if error.filename is None:  # of a full disk, which names no file
                raise OSError(error.errno, error.strerror, str(path)) from error
            raise


@contextmanager
def whole_path(path: Path) -> Iterator[Path]:
    """Yield the temporary name under which a package writes a file in its folder; it gets its own at the end.

    A missing folder is made, and what a killed process left of the file removed. Raises `OSError`.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers([path])
    try:
        yield temporary
        with _about(path), temporary.open("rb+") as file:
            _to_disk(file)
        _rename(temporary, path)
    finally:
        for leftover in (temporary, temporary.with_name(f"{temporary.name}{_JOURNAL}")):
            with suppress(OSError):
                leftover.unlink()
