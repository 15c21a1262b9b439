"""Letters beyond ASCII in titles and names of liquids: read, printed, recorded and written as they are."""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path

import pytest

from cli.commands import musat
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.job_tables import card_family
from musatpy.formats.musat import read_deck

DECK = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.crd"
TITLE = "K\u00fcste von St. Thomas, \u00c5ngstr\u00f6m"
WATER = "WTR 1.340000" + " " * 40 + "\u00d6l".ljust(12)


def deck_with(title: str, encoding: str) -> bytes:
    lines = DECK.read_text().splitlines()
    lines[0] = f"TTL {title}".ljust(72) + "00000001"
    return "".join(f"{line}\n" for line in lines).encode(encoding)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-8-sig", "decomposed"])
def test_titles_are_read_and_printed_as_they_are(tmp_path: Path, encoding: str) -> None:
    data = deck_with(TITLE, encoding if encoding != "decomposed" else "utf-8")
    if encoding == "decomposed":  # a letter and its marks apart, as file systems have them
        data = unicodedata.normalize("NFD", data.decode()).encode()
    (tmp_path / "job.crd").write_bytes(data)
    result = musat("run", tmp_path / "job.crd", "--punch", "restart", "--html", "-o", tmp_path)
    assert result.exit_code == 0
    told = "letters beyond ASCII are read as Latin-1: the file is not in UTF-8"
    assert (told in result.stderr) == (encoding == "latin-1")
    listing = (tmp_path / "job.lst").read_text(encoding="utf-8").splitlines()
    assert TITLE in listing[0] and listing[0].index("PAGE") == 121
    record = (tmp_path / "job.json").read_text(encoding="utf-8")
    assert TITLE in record and json.loads(record)["titles"] == [TITLE]
    assert TITLE in (tmp_path / "job.html").read_text(encoding="utf-8")
    assert read_deck(tmp_path / "job.pun").titles == (TITLE,)
    punched = (tmp_path / "job.pun").read_text(encoding="utf-8").splitlines()
    assert {len(line) for line in punched} == {80}  # characters
    assert musat("diff", tmp_path / "job.lst", tmp_path / "job.json").exit_code == 0


def test_columns_count_characters() -> None:
    deck = read_cards(f"{WATER}  X\nEND\n".encode(), card_family())
    assert deck.tables["WTR"]["liquid"].tolist() == ["\u00d6l"]
    (problem,) = [one for one in deck.problems if one.line == 1]
    assert problem.headline() == "deck:1 col 67 WTR: 'X' stands in columns of no field"
    assert problem.text == f"{WATER}  X"


@pytest.mark.parametrize("column", [1, 2, 14, 25, 61])
def test_names_and_numbers_have_ascii_letters_alone(column: int) -> None:
    lines = DECK.read_text().splitlines()
    lines[14] = lines[14][: column - 1] + "\u00e9" + lines[14][column:]
    deck = read_cards("\n".join(lines).encode(), card_family())
    (problem,) = deck.problems
    message = "'\u00e9' is not ASCII: only titles and the names of liquids may have such letters"
    assert problem.headline() == f"deck:15 col {column}: {message}"
    assert problem.text == lines[14]


def test_what_is_set_moves_no_letter(tmp_path: Path) -> None:
    (tmp_path / "job.crd").write_bytes(deck_with(TITLE, "latin-1"))
    result = musat("run", tmp_path / "job.crd", "--set", "OPT.plate_sigma=6", "-o", tmp_path)
    assert result.exit_code == 0 and TITLE in (tmp_path / "job.lst").read_text(encoding="utf-8")
    assert musat("card", "TTL", f"text={TITLE}").output == f"TTL {TITLE}\n"
