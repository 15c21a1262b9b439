"""Headers of LAS files, looked at before they are believed: what they count must fit into the file.

Names in them are ASCII by the specification (ASPRS, LAS 1.4 R15) and Latin-1 in many files.
"""

from __future__ import annotations

import io
import math
import os
import struct
from typing import Any, BinaryIO

_SIGNATURE = b"LASF"
_SIZES = {(1, 4): 375}  # bytes of a header by version; 227 of earlier ones
_SHORTEST = 227
_NEWEST = 4  # 1.4
_RECORD = struct.Struct("<2x16sHH32s")  # head of a variable length record
_EXTENDED = struct.Struct("<2x16sHQ32s")  # likewise behind the points
_EXTRA_BYTES = ("LASF_Spec", 4, 192)  # user and number of the record of extra dimensions, bytes of each of these
_COMPRESSED = 0xC0  # bits of the point format
_DENSEST = 10_000  # compressed points in a byte: more than any are alike


def checked_head(file: BinaryIO) -> bytes:
    """Return what stands before the points, its names in UTF-8, and leave the file at its start.

    Raises `ValueError` for what no file can have: a size, a count or a place beyond its end.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    header = file.read(max(_SIZES.values()))
    if len(header) < _SHORTEST or header[:4] != _SIGNATURE:
        raise ValueError("it does not begin with such a header")
    if header[24] != 1 or header[25] > _NEWEST:
        raise ValueError(f"version {header[24]}.{header[25]} is not known")
    header_size, points, records = struct.unpack_from("<HII", header, 94)
    extended = (header[24], header[25]) in _SIZES
    _require(_SIZES.get((header[24], header[25]), _SHORTEST) <= header_size <= points <= size, "its header", size)
    _require(header_size + records * _RECORD.size <= points, f"{records} records before its points", size)
    _check_points(file, header, points, size)
    numbers = struct.unpack_from("<6d", header, 131)
    if not all(map(math.isfinite, numbers)) or 0.0 in numbers[:3]:
        raise ValueError("its scales or offsets are no numbers")
    if extended:
        place, count = struct.unpack_from("<QI", header, 235)
        _check_extended(file, place, count, size)
    file.seek(0)
    head = bytearray(file.read(points))
    file.seek(0)
    place = header_size
    for _ in range(records):
        _require(place + _RECORD.size <= points, "a record before its points", size)
        user, number, length, _ = _RECORD.unpack_from(head, place)
        _require(place + _RECORD.size + length <= points, "a record before its points", size)
        _to_utf_8(head, place + 2, 16)
        text = head[place + 22 : place + _RECORD.size]  # read and written in ASCII alone, and nobody's name
        head[place + 22 : place + _RECORD.size] = bytes(byte if byte < 128 else ord("?") for byte in text)
        place += _RECORD.size
        if (user.rstrip(b"\0").decode("latin-1"), number) == _EXTRA_BYTES[:2]:
            for start in range(place, place + length - _EXTRA_BYTES[2] + 1, _EXTRA_BYTES[2]):
                _to_utf_8(head, start + 4, 32)
                _to_utf_8(head, start + 160, 32)
        place += length
    return bytes(head)


def _require(fits: bool, what: str, size: int) -> None:
    if not fits:
        raise ValueError(f"{what} would not fit into its {size} bytes")


def _check_points(file: BinaryIO, header: bytes, points: int, size: int) -> None:
    """Raise `ValueError` where points, or the table of their chunks where they are compressed, would not fit."""
    form, length, count = struct.unpack_from("<BHI", header, 104)
    if header[25] >= 4:
        (count,) = struct.unpack_from("<Q", header, 247)
    if not form & _COMPRESSED:
        _require(points + count * length <= size, f"{count} points of {length} bytes", size)
        return
    file.seek(points)
    (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
    if table == -1:  # it was not known yet when they were written
        file.seek(-8, os.SEEK_END)
        (table,) = struct.unpack("<q", file.read(8))
    _require(points <= table <= size - 8, "the table of its chunks", size)
    file.seek(table)
    _, chunks = struct.unpack("<II", file.read(8))
    _require(chunks <= size and count <= size * _DENSEST, f"{count} points in {chunks} chunks", size)


def _check_extended(file: BinaryIO, place: int, count: int, size: int) -> None:
    _require(count * _EXTENDED.size <= size, f"{count} records behind its points", size)
    for _ in range(count):
        _require(place + _EXTENDED.size <= size, "a record behind its points", size)
        file.seek(place)
        _, _, length, _ = _EXTENDED.unpack(file.read(_EXTENDED.size))
        place += _EXTENDED.size + length
        _require(place <= size, "a record behind its points", size)


def _to_utf_8(head: bytearray, start: int, length: int) -> None:
    """Turn a name into UTF-8 where it is none, as far as it has room."""
    name = bytes(head[start : start + length])
    try:
        name.decode()
    except UnicodeDecodeError:
        text = name.decode("latin-1").encode()[:length].decode(errors="ignore")
        head[start : start + length] = text.encode().ljust(length, b"\0")


class Headed(io.RawIOBase):
    """A file whose first bytes are other ones."""

    def __init__(self, file: BinaryIO, head: bytes) -> None:
        self.file = file
        self.head = head

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place, and return it."""
        return self.file.seek(offset, whence)

    def tell(self) -> int:
        """Return the place."""
        return self.file.tell()

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer, and return by how many bytes."""
        start = self.file.tell()
        data = self.file.read(len(buffer))
        if start < len(self.head):
            head = self.head[start : start + len(data)]
            data = head + data[len(head) :]
        buffer[: len(data)] = data
        return len(data)


class Name(str):
    """A name that is written in Latin-1, whatever the package that writes it thinks of."""

    __slots__ = ()

    def encode(self, encoding: str = "", errors: str = "") -> bytes:
        """Return the bytes of the name."""
        return super().encode("latin-1", "replace")


def name_all(header: Any) -> None:
    """Make the names of a header, and of its records, such as can be written again."""
    for attribute in ("system_identifier", "generating_software"):
        setattr(header, attribute, _name(getattr(header, attribute)))
    for number, record in enumerate(header.vlrs):
        if not record.user_id.isascii():  # one of no standard kind
            user, data = Name(record.user_id), record.record_data
            header.vlrs[number] = type(record)(user, record.record_id, record.description, data)


def _name(text: str | bytes) -> Name:
    return Name(text.decode("latin-1") if isinstance(text, bytes) else text)
