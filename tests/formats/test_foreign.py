"""A file that is no deck is told once, by what it is."""

import codecs
from pathlib import Path

import pytest

from cli.commands import musat

DECK = Path(__file__).parents[2] / "fixtures" / "cayman" / "cayman_modified.crd"
TEXT = DECK.read_text()
FILES = {
    "utf16": (TEXT.encode("utf-16"), "text in UTF-16: save it as plain text"),
    "cloud": (b"LASF" + bytes(400), "a cloud of points (LAS)"),
    "office": (b"PK\x03\x04" + bytes(100), "an archive or an office document"),
    "zeros": (bytes(4096), "no text"),
    "record": (
        b'{"schema_version": "3.0", "program": {"name": "musatpy"}}',
        "a record (JSON), not the deck of its run",
    ),
    "listing": (b"1MUSATPY  MUSAT-IIA  ST THOMAS\n" * 20, "a listing, not the deck of its run"),
    "small": (TEXT.lower().encode(), "a deck in small letters: cards are in capitals"),
    "prose": (b"Dear colleague,\n" * 40, "no deck: none of its first 40 lines begins with a card"),
}


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("command", ["check", "run"])
def test_what_a_file_is_stands_in_one_message(tmp_path: Path, kind: str, command: str) -> None:
    data, message = FILES[kind]
    (tmp_path / "deck.crd").write_bytes(data)
    result = musat(command, tmp_path / "deck.crd", *(["-o", tmp_path] if command == "run" else []))
    lines = result.output.splitlines()
    assert result.exit_code == 1 and len(lines) == 2
    assert f"deck.crd: this is {message}" in lines[0] and "1 error" in lines[1]


def test_a_byte_order_mark_is_skipped_and_told(tmp_path: Path) -> None:
    (tmp_path / "deck.crd").write_bytes(codecs.BOM_UTF8 + DECK.read_bytes())
    result = musat("check", tmp_path / "deck.crd")
    assert result.exit_code == 0
    assert result.output.startswith(f"{tmp_path / 'deck.crd'}: warning: begins with a byte order mark, skipped")
