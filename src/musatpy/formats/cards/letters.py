"""Letters beyond ASCII in a deck: bytes <-> text."""

from __future__ import annotations

import codecs

_UTF_8, _MARKED, LATIN_1 = "utf-8", "utf-8-sig", "latin-1"


def text_of(data: bytes) -> tuple[str, str]:
    """Return the text of the bytes of a deck without byte order mark, and its encoding: UTF-8, else Latin-1."""
    encoding = _MARKED if data.startswith(codecs.BOM_UTF8) else _UTF_8
    try:
        return data.decode(encoding), encoding
    except UnicodeDecodeError:
        return data.decode(LATIN_1), LATIN_1


def bytes_of(text: str, encoding: str) -> bytes:
    """Return the bytes of a text in an encoding; in UTF-8 where that lacks one of the letters."""
    try:
        return text.encode(encoding)
    except UnicodeEncodeError:
        return text.encode(_UTF_8)
