"""Mistakes that people make with decks: each is told as one kind of message, whatever follows from it."""

import codecs
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from cli.commands import musat
from musatpy.errors import of_each_kind
from musatpy.formats.musat import check_deck

DECK = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.crd"
TEXT = DECK.read_text()
LINES = TEXT.splitlines()


def changed(cards: str, change: Callable[[str], str]) -> str:
    """Return the deck with some kinds of cards changed."""
    return "".join(f"{change(line) if line[:3] in cards.split() else line}\n" for line in LINES)


def without(card: str) -> str:
    return "".join(f"{line}\n" for line in LINES if not line.startswith(card))


def scaled(line: str, factor: float, shift: float = 0.0, y: float = 1.0) -> str:
    values = (factor * float(line[21:33]) + shift, y * factor * float(line[33:45]) + shift)
    return line[:21] + "".join(f"{value:12.3f}" for value in values) + line[45:]


def decimal(line: str) -> str:
    """Return a station card with decimal degrees in the columns of degrees, minutes and seconds."""
    out = line[:16]
    for first, parts in ((16, (3, 3, 9)), (31, (4, 3, 9))):
        words = [line[first + sum(parts[:n]) : first + sum(parts[: n + 1])] for n in range(3)]
        size = abs(int(words[0])) + int(words[1]) / 60.0 + float(words[2]) / 3600.0
        out += f" {'-' if '-' in words[0] else ''}{size:.8f}".ljust(sum(parts))
    return out + line[47:]


def exchanged(line: str) -> str:
    """Return a control card with the longitude in the columns of the latitude, and the other way round."""
    return line if not line[16:31].strip() else f"{line[:16]}{line[32:47]} {line[16:31]}{line[47:]}"


def east(line: str) -> str:
    return line.replace("-64", " 64")


STATION, CONTROL, PLATE = (next(line for line in LINES if line.startswith(card)) for card in ("STA", "CTG", "PLT"))
MIRROR = "the images are mirror images of the control"
MISTAKES = {  # what was done: the deck, how many problems, what is said of it
    "columns moved to the right": (
        changed("PLT", lambda s: f"{s[:4]} {s[4:79]}"),
        48,
        "reads if it is moved 1 column to the left",
    ),
    "columns moved by five": (
        changed("PLT", lambda s: f"{s[:4]}     {s[4:75]}"),
        48,
        "reads if it is moved 5 columns to the left",
    ),
    "columns moved to the left": (
        changed("ATT", lambda s: s[:3] + s[4:]),
        3,
        "reads if it is moved 1 column to the right",
    ),
    "all in small letters": (TEXT.lower(), 1, "a deck in small letters: cards are in capitals"),
    "some in small letters": (changed("PLT", lambda s: f"plt{s[3:]}"), 48, "'plt' is no card; expected PLT"),
    "tabs": (changed("PLT", lambda s: "\t".join(s[:72].split())), 48, "tab character"),
    "commas for points": (
        changed("PLT", lambda s: s.replace(".", ",")),
        48,
        "reads with points in place of its commas",
    ),
    "letters for digits": (
        changed("STA", lambda s: s[:20] + s[20:57].replace("0", "O").replace("1", "l") + s[57:]),
        3,
        "the digits 0 and 1 in place of the letters O and l",
    ),
    "one letter for a digit": (
        TEXT.replace("87.2600000  79", "87.26O0000  79"),
        1,
        "the digits 0 and 1 in place of the letters O and l",
    ),
    "degrees for degrees, minutes, seconds": (
        changed("STA", decimal),
        3,
        "decimal degrees stand in the columns of degrees, minutes and seconds",
    ),
    "x and y of images exchanged": (changed("PLT", lambda s: s[:21] + s[33:45] + s[21:33] + s[45:]), 1, MIRROR),
    "y of images downwards": (changed("PLT", lambda s: scaled(s, 1.0, y=-1.0)), 1, MIRROR),
    "latitude and longitude exchanged": (changed("CTG", exchanged), 5, "km with latitude and longitude exchanged"),
    "longitudes of the wrong sign": (changed("STA CTG", east), 1, MIRROR),
    "longitudes of the stations of the wrong sign": (
        changed("STA", east),
        5,
        "km with the other sign of the longitude",
    ),
    "longitude of one station of the wrong sign": (
        TEXT.replace(STATION, east(STATION)),
        1,
        "the station of photo 21 lies",
    ),
    "longitude of one point of the wrong sign": (TEXT.replace(CONTROL, east(CONTROL)), 1, "control point 101 lies"),
    "heights of stations in feet": (
        changed("STA", lambda s: f"{s[:47]}{float(s[47:57]) / 0.3048:10.3f}{s[57:]}"),
        1,
        "as if stations were in feet and control in metres",
    ),
    "images in micrometres": (changed("PLT", lambda s: scaled(s, 1000.0)), 1, "these look like micrometres"),
    "images in pixels": (changed("PLT", lambda s: scaled(s, 40.0, 5000.0, -1.0)), 1, "these look like pixels"),
    "images from a corner": (
        changed("PLT", lambda s: scaled(s, 1.0, 114.3)),
        1,
        "to one side of its principal point in x, and in y: if they count from a corner",
    ),
    "focal length in metres": (
        changed("CAM", lambda s: f"{s[:12]}    0.15225{s[23:]}"),
        1,
        "a focal length of 0.15225 mm is out of the ordinary",
    ),
    "no END": (without("END"), 1, "no END card (end of deck)"),
    "END first": (f"{LINES[-1]}\n{without('END')}", 1, "69 cards after the END card of line 1"),
    "two decks in one file": (TEXT + TEXT, 1, "70 cards after the END card of line 70"),
    "no camera": (without("CAM"), 1, "no CAM card (camera)"),
    "another camera": (
        changed("CAM", lambda s: s.replace("RC8", "RC9")),
        1,
        "camera RC8 has no CAM card (2 more cards name it)",
    ),
    "no station": (without(STATION), 1, "photo 21 has no station card (STA or STX) (14 more cards name it)"),
    "a photo twice": (
        TEXT.replace(STATION, f"{STATION}\n{STATION}"),
        1,
        "the station of photo 21 is already given on line 6",
    ),
    "an image twice": (
        TEXT.replace(PLATE, f"{PLATE}\n{PLATE}"),
        1,
        "point 102 is already measured on photo 21 on line 15",
    ),
    "no tides": (without("TID"), 3, "has submerged points but no TID card"),
    "control without sigmas": (
        changed("CTG", lambda s: s[:57] if s[12] == "F" else s),
        4,
        "the east, north, up components are known and not fixed",
    ),
    "one rule broken 48 times": (changed("PLT", lambda s: f"{s[:61]}Q{s[62:]}"), 48, "'Q' is not A1 (one of B, D)"),
    "a comment": (f"# of the harbour\n{TEXT}", 1, "'# o' is no card; expected one of TTL, OPT,"),
    "longer than a card": (changed("PLT", lambda s: f"{s}  1"), 48, "card of 83 columns, longer than 80"),
    "text in UTF-16": (TEXT.encode("utf-16"), 1, "text in UTF-16: save it as plain text"),
    "CR alone": (TEXT.replace("\n", "\r"), 1, "text whose lines end with CR alone"),
    "a byte order mark, CR LF": (
        codecs.BOM_UTF8 + TEXT.replace("\n", "\r\n").encode(),
        1,
        "begins with a byte order mark, skipped",
    ),
    "a minus of print": (changed("STA", lambda s: s.replace("-64", "\u221264")), 3, "'\u2212' is not ASCII"),
    "rows of a table": (
        "photo,point,x,y\n" + "21,102,4.001,85.028\n" * 30,
        1,
        "none of its first 31 lines begins with a card",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_told_once(mistake: str) -> None:
    text, count, message = MISTAKES[mistake]
    _, problems = check_deck(text if isinstance(text, bytes) else text.encode())
    assert [problem.headline() for problem in problems if message not in problem.headline()] == []
    assert len(problems) == count
    assert len(list(of_each_kind(problems))) <= 4  # three places, and how many more


def test_what_is_printed_of_many(tmp_path: Path) -> None:
    (tmp_path / "job.crd").write_text(MISTAKES["commas for points"][0])
    result = musat("check", tmp_path / "job.crd")
    lines = [line for line in result.output.splitlines() if "job.crd" in line]
    assert result.exit_code == 1 and len(lines) == 5
    assert lines[0].endswith("job.crd:15 cols 26-38 PLT: the card reads with points in place of its commas")
    assert lines[3].endswith("... and 45 more of this kind, on lines 18-62")
    assert lines[4].endswith("48 errors, 0 warnings")


@pytest.mark.parametrize(
    ("card", "wrong"),
    [
        (r"^PLT 21       205", "PLT 21       2O5"),  # names have any letter
        (r"^(PLT .{18})  4.0010000", r"\1  4.0,10000"),  # two points in one number
        (r"^(STA .{12}) 18 20", r"\1 18 61"),
    ],
)
def test_what_no_slip_explains_is_told_as_it_stands(card: str, wrong: str) -> None:
    _, problems = check_deck(re.sub(card, wrong, TEXT, count=1, flags=re.M).encode())
    assert problems and not any("reads" in problem.message for problem in problems)
