"""What a file is that is no deck: told once, in place of every line that is no card."""

from __future__ import annotations

import codecs

from musatpy.formats.cards.spec import Family

_LOOKED_AT = 100  # lines
_FEWEST = 10  # lines without a card that make a file no deck; of fewer each is told
_BINARY = (  # how files begin, and what they are
    (codecs.BOM_UTF16_LE, "text in UTF-16: save it as plain text (ASCII, or UTF-8)"),
    (codecs.BOM_UTF16_BE, "text in UTF-16: save it as plain text (ASCII, or UTF-8)"),
    (b"LASF", "a cloud of points (LAS): musat correct takes it"),
    (b"PK\x03\x04", "an archive or an office document: save the cards as plain text"),
    (b"%PDF", "a document (PDF)"),
    (b"\x89PNG", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"II*\x00", "a picture or a raster (TIFF)"),
    (b"MM\x00*", "a picture or a raster (TIFF)"),
    (b"SQLite format 3", "a database, such as a GeoPackage"),
)
_SURVEY = ("ANG", "DIR", "HDIR", "HOR", "VDIR", "ZEN", "AZI", "AZM", "BRG", "BEAR", "TACH", "THEO", "TRAV")


def of_survey(line: str) -> str:
    """Return what to do with a line of terrestrial survey, by how it begins; nothing for any other."""
    if not line.upper().startswith(_SURVEY):
        return ""
    return (
        "; angles, directions and coordinates of terrestrial survey are not adjusted here: adjust them first, and "
        "give the points with their covariances (CTG or CTX, and CTC)"
    )


def foreign(data: bytes, family: Family) -> str:
    """Return what the bytes of a file are that is no deck of a family; nothing for a deck, and for a few lines."""
    start = data.lstrip()[:4096]
    for magic, name in _BINARY:
        if data.startswith(magic):
            return name
    if start.count(b"\x00") > len(start) // 10:
        return "no text: many of its characters are zero"
    if b"\r" in data and b"\n" not in data:
        return "text whose lines end with CR alone: save it with line ends LF or CR LF"
    if start.startswith(b"{"):
        return "a record (JSON), not the deck of its run: musat report prints it" if b"musat" in start else "JSON"
    if start.removeprefix(b"1").startswith(b"MUSATPY "):
        return "a listing, not the deck of its run"
    lines = [line.decode("latin-1") for line in data.split(b"\n", _LOOKED_AT)[:_LOOKED_AT] if line.strip()]
    mnemonics = {line[:3] for line in lines}
    if len(lines) < _FEWEST or mnemonics & family.cards.keys():
        return ""
    if {mnemonic.upper() for mnemonic in mnemonics} & family.cards.keys():
        return "a deck in small letters: cards are in capitals"
    survey = next((what for line in lines if (what := of_survey(line))), "")
    return (
        f"no deck: none of its first {len(lines)} lines begins with a card; files of other agencies go through "
        f"musat convert; the first line is '{lines[0][:40].strip()}'{survey}"
    )
