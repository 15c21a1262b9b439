"""One cause, one message: a file that is no deck, cards that are moved, plates in another unit."""

import codecs
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.job_tables import card_family

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


@pytest.mark.parametrize("by", [-1, 1, 2, 3])
def test_cards_that_are_moved_are_told_once_each(by: int) -> None:
    """With their numbers and without; what they say is as if they stood where they should."""
    right = read_cards(DECK, card_family())
    lines = TEXT.splitlines()
    for number, mnemonic in ((80, "ATT"), (72, "STA"), (80, "PLT")):
        for row in right.lines[mnemonic] - 1:
            body = lines[row][3:number].ljust(number - 3)
            lines[row] = mnemonic + (body[-by:] if by < 0 else " " * by + body)[: 80 - 3]
    deck = read_cards("\n".join(lines).encode(), card_family())
    moved = [problem for problem in deck.problems if "the card reads if it is moved" in problem.message]
    assert len(moved) == len({problem.line for problem in deck.problems})
    way = "right" if by < 0 else "left"
    assert all(f"moved {abs(by)} column" in one.message and one.message.endswith(way) for one in moved)
    for problem in moved:
        row = int(np.flatnonzero(deck.lines[problem.card] == problem.line)[0])
        for name, values in right.tables[problem.card].items():
            np.testing.assert_array_equal(deck.tables[problem.card][name][row], values[row])


def test_plates_in_micrometres_are_told_once(tmp_path: Path) -> None:
    lines = []
    for line in TEXT.splitlines():
        if line.startswith("PLT"):
            x, y = 1e3 * float(line[21:33]), 1e3 * float(line[33:45])
            line = f"{line[:21]}{x:12.4f}{y:12.4f}{line[45:]}"
        lines.append(line)
    (tmp_path / "deck.crd").write_text("\n".join(lines))
    result = musat("check", tmp_path / "deck.crd")
    assert "millimetres are needed, these look like micrometres" in result.output
    assert "deck.crd: 1 error, " in result.output
