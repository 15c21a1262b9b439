"""Whole decks: tables, every problem in one pass, line ends, and decks written."""

import math

import numpy as np
import pytest

from musatpy.errors import DeckError
from musatpy.formats.cards.deck import read_cards, write_cards
from musatpy.formats.cards.spec import card_formats_folder, load_family

TITLE = "TTL A SMALL DECK"
CAMERA = "CAM RC8       152.12300    0.00400   -0.01100   230.00   230.00"
TIDE = "TID 841         -0.4100   0.0500"
PLATES = [
    "PLT 841      1046      31.4160000 -87.2045130 0.010000.01000 B",
    "PLT 842      1046     -60.0120000 -86.9002010                 N",
    "PLT 841      1047      -0.0000010   0.0000000 0.01000*******",
]
DECK = [TITLE, CAMERA, TIDE, *PLATES, "END"]


@pytest.fixture(scope="module")
def family():
    return load_family(card_formats_folder() / "musat")


def numbered(lines: list[str], end: str = "\n") -> bytes:
    """A deck of full cards with sequence numbers."""
    return "".join(f"{line:72}{number:08d}{end}" for number, line in enumerate(lines, 1)).encode("ascii")


def bare(lines: list[str], end: str = "\n") -> bytes:
    """A deck of cards without trailing blanks."""
    return "".join(line + end for line in lines).encode("ascii")


def headlines(data: bytes, family) -> list[str]:
    return [problem.headline() for problem in read_cards(data, family, "deck.crd").problems]


def same_tables(one, other) -> bool:
    assert list(one.tables) == list(other.tables)
    for mnemonic, table in one.tables.items():
        for name, column in table.items():
            np.testing.assert_array_equal(column, other.tables[mnemonic][name])
        np.testing.assert_array_equal(one.lines[mnemonic], other.lines[mnemonic])
    return True


def test_a_deck_becomes_tables(family):
    deck = read_cards(numbered(DECK), family, "deck.crd")
    assert deck.problems == ()
    assert list(deck.tables) == list(deck.lines) == list(family.cards)
    assert [mnemonic for mnemonic, lines in deck.lines.items() if len(lines)] == ["TTL", "CAM", "TID", "PLT", "END"]
    assert all(len(column) == 0 for column in deck.tables["STA"].values())
    plates = deck.tables["PLT"]
    assert deck.lines["PLT"].tolist() == [4, 5, 6]
    assert plates["photo"].tolist() == ["841", "842", "841"]
    assert plates["x"].tolist() == [31.416, -60.012, -0.000001]
    np.testing.assert_array_equal(plates["sigma_y"], [0.01, math.nan, math.nan])
    assert plates["bathymetric"].tolist() == ["B", "", ""]
    assert plates["not_triangulated"].tolist() == ["", "N", ""]
    assert deck.tables["TTL"]["text"].tolist() == ["A SMALL DECK"]
    assert deck.images.text(2) == f"{CAMERA:72}00000002"
    with pytest.raises(IndexError):
        deck.images.text(8)


@pytest.mark.parametrize(
    "data",
    [
        numbered(DECK, "\r\n")[:-2],
        numbered(DECK)[:-1],
        bare(DECK, "\r\n"),
        bare([f"{line:90}" for line in DECK]),
        bare([f"{line:{75 + 3 * i}}" for i, line in enumerate(DECK)]),
        numbered(DECK[:3], "\r\n") + numbered(DECK[3:]),
        numbered(DECK, "\r\n") + b"\x1a",
    ],
    ids=["crlf, no last end", "no last end", "bare crlf", "90 columns", "growing", "mixed", "DOS"],
)  # fmt: skip
def test_line_ends_and_trailing_blanks_do_not_matter(family, data):
    deck = read_cards(data, family)
    assert deck.problems == ()
    assert same_tables(deck, read_cards(numbered(DECK), family))
    assert [deck.images.text(i + 1)[:72].rstrip() for i in range(len(DECK))] == DECK


@pytest.mark.parametrize("make", [numbered, bare])
def test_cards_of_all_kinds_may_be_interleaved(family, make):
    rng = np.random.default_rng(3)
    cards = [*(spec.sample[:72].rstrip() for spec in family.cards.values() if spec.repeat == "many")] * 20
    cards = [cards[i] for i in rng.permutation(len(cards))]
    deck = read_cards(make([CAMERA, *cards, "END"]), family)
    assert deck.problems == ()
    for mnemonic, lines in deck.lines.items():
        assert lines.tolist() == [i for i, card in enumerate([CAMERA, *cards, "END"], 1) if card[:3] == mnemonic]
    assert len(deck.lines["PLT"]) == 20
    assert set(deck.tables["PLT"]["y"]) == {-87.204513}


def test_every_bad_card_is_reported_in_one_pass(family):
    bad = [
        "XYZ 841",
        "plt 841      1046       31.416000  -87.204513",
        "PLT 841      1046       3l.416000  -87.2O4513 0.010000.01000 B",
        "PLT          1046      31.4160000             0.010000.01000 Q",
        "PLT 841     *1046      31.4160000 -87.2045130 0.010000.01000   X Y",
        "PLT 841\t1046       31.416000  -87.204513",
        "",
        "PLT 841      1046      31.4160000 -87.2045130 0.010000.01000 B          00000001 LONG",
    ]
    data = bare([TITLE, CAMERA, *PLATES, *bad, "END"]).replace(b"SMALL", b"SM\x84LL")
    known = ", ".join(family.cards)
    assert headlines(data, family) == [
        "deck.crd: warning: letters beyond ASCII are read as Latin-1: the file is not in UTF-8",
        "deck.crd:1 col 9: control character (byte 0x84)",
        f"deck.crd:6 cols 1-3: 'XYZ' is no card; expected one of {known}",
        "deck.crd:7 cols 1-3: 'plt' is no card; expected PLT",
        "deck.crd:8 cols 26-41 PLT: the card reads with the digits 0 and 1 in place of the letters O and l",
        "deck.crd:9 cols 5-12 PLT.photo: blank, expected A8",
        "deck.crd:9 cols 34-45 PLT.y: blank, expected F12.7",
        "deck.crd:9 col 62 PLT.bathymetric: 'Q' is not A1 (one of B, D)",
        "deck.crd:10 col 13 PLT: '*' stands in columns of no field",
        "deck.crd:10 cols 64-66 PLT: 'X Y' stands in columns of no field",
        "deck.crd:11 col 8: tab character",
        "deck.crd:12: warning: blank line, skipped",
        "deck.crd:13 cols 81-85: card of 85 columns, longer than 80",
    ]
    deck = read_cards(data, family)
    plates = deck.tables["PLT"]
    assert deck.lines["PLT"].tolist() == [3, 4, 5, 7, 8, 9, 10, 11, 13]
    np.testing.assert_array_equal(plates["y"][4:8], [-87.204513, math.nan, -87.204513, math.nan])
    assert plates["photo"][[5, 7]].tolist() == ["", ""] and plates["bathymetric"][5] == ""
    assert [problem.severity for problem in deck.problems].count("warning") == 2


WATER = "WTR 1.340000"


@pytest.mark.parametrize(
    ("lines", "problems"),
    [
        ([], ["deck.crd: the deck is empty"]),
        (["", "  ", ""], ["deck.crd: the deck is empty"]),
        ([CAMERA, *PLATES], ["deck.crd END: no END card (end of deck)"]),
        ([*PLATES, "END"], ["deck.crd CAM: no CAM card (camera)"]),
        (
            [CAMERA, *PLATES, "END", PLATES[0], "END", ""],
            [
                "deck.crd:6 cols 1-3: 2 cards after the END card of line 5",
                "deck.crd:8: warning: blank line, skipped",
            ],
        ),
        ([CAMERA, *PLATES, "END", TITLE], ["deck.crd:6 cols 1-3: a card after the END card of line 5"]),
        ([CAMERA, *PLATES, "ENDING"], ["deck.crd:5 cols 4-6 END: 'ING' stands in columns of no field"]),
        (
            [CAMERA, WATER, *PLATES, WATER, "END"],
            ["deck.crd:6 cols 1-3 WTR: a second WTR card; the first is on line 2"],
        ),
    ],
)
def test_cards_that_a_deck_has_once_at_least_or_at_most(family, lines, problems):
    assert headlines(bare(lines), family) == problems


@pytest.mark.parametrize(
    ("byte", "message"),
    [
        (b"\t", "tab character"),
        (b"\x00", "control character (byte 0x00)"),
        (b"\r", "control character (byte 0x0d)"),
    ],
)
@pytest.mark.parametrize("make", [numbered, bare])
def test_bad_characters_are_found_wherever_they_are(family, make, byte, message):
    data = bytearray(make([CAMERA, *PLATES, "END"]))
    second = data.index(b"\n") + 1
    for column in (1, 2, 25, 61):
        changed = data.copy()
        changed[second + column - 1 : second + column] = byte
        deck = read_cards(bytes(changed), family, "deck.crd")
        shown = deck.images.text(2)
        assert [problem.headline() for problem in deck.problems] == [f"deck.crd:2 col {column}: {message}"]
        assert shown[column - 1] == "?" and shown.isprintable()


def test_a_deck_of_many_chunks(family):
    # More cards than are decoded in one go, odd ones at the borders of the chunks.
    count = 40_000
    lines = [PLATES[0]] * count
    odd = [0, 4095, 4096, 16383, 16384, 32768, count - 1]
    for i in odd:
        lines[i] = PLATES[0].replace("31.4160000", " 3.1416E+1").replace(" 1046 ", f" {i:<5}")
    for data in (numbered([CAMERA, *lines, "END"]), bare([CAMERA, *lines, "END"])):
        deck = read_cards(data, family)
        assert deck.problems == ()
        plates = deck.tables["PLT"]
        assert deck.lines["PLT"].tolist() == list(range(2, count + 2))
        assert (plates["x"] == 31.416).all()
        changed = np.flatnonzero(plates["point"] != "1046")
        assert changed.tolist() == odd
        assert plates["point"][odd].tolist() == [str(i) for i in odd]


# --- writing ---


def test_values_that_cannot_be_written_are_all_named(family):
    columns = {
        "photo": np.array(["841", "LONGER THAN 8"]),
        "height": np.array([1e12, 0.5]),
        "sigma": np.array([math.nan, math.inf]),
        "group": np.array(["", "STRIP1"]),
        "day": np.array(["", ""]),
        "time": np.array([np.nan, 12.5]),
    }
    with pytest.raises(DeckError) as caught:
        write_cards([(family.cards["TTL"], {"text": np.array(["A", "B"])}), (family.cards["TID"], columns)])
    assert [(problem.card, problem.field, problem.message) for problem in caught.value.problems] == [
        ("TID", "photo", "card 4: 'LONGER THAN 8' is not A8 (up to 8 ASCII characters, no outer blanks)"),
        ("TID", "height", "card 3: '1000000000000.0' is not a number that fits F10.4"),
        ("TID", "sigma", "card 4: 'inf' is not a number that fits F8.4"),
    ]
