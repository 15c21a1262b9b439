"""Cards out of tables (`musat card CARD --csv`) and out of words (`musat tidy`)."""

from pathlib import Path

import pytest

from cli.commands import musat
from musatpy.formats.job_tables import card_family
from musatpy.keypunch.typed import tidied, tidy_card

FIXTURES = Path(__file__).parents[2] / "fixtures"
TYPED = """TTL A strip, typed
opt LOCL
CAM RMK 153.17
PLT 1 101 12.345 -56.789
PLT 1 102 12.345 -56.789 0.005 0.005 B
PLT 1 103 12.3 4.5 B
END
"""


def values(card: str) -> dict[str, float | str]:
    """Return what a card says, without its blank fields."""
    spec = card_family().cards[card[:3]]
    fields = {field.name: card.ljust(80)[field.first - 1 : field.last] for field in spec.fields}
    return {field.name: field.decode(fields[field.name]) for field in spec.fields if fields[field.name].strip()}


def test_words_go_to_the_fields_in_their_order(tmp_path: Path) -> None:
    (tmp_path / "typed.crd").write_text(TYPED)
    result = musat("tidy", tmp_path / "typed.crd", "-o", tmp_path / "tidy.crd")
    assert result.exit_code == 0, result.output
    cards = (tmp_path / "tidy.crd").read_text().splitlines()
    assert cards[0] == "TTL A strip, typed" and cards[-1] == "END"  # which read well as they were
    assert values(cards[1]) == {"system": "LOCL"}  # the only field that takes this word
    assert values(cards[2]) == {"camera": "RMK", "focal_length": 153.17}
    assert values(cards[3]) == {"photo": "1", "point": "101", "x": 12.345, "y": -56.789}
    named = {"photo": "1", "point": "102", "x": 12.345, "y": -56.789, "sigma_x": 0.005, "sigma_y": 0.005}
    assert values(cards[4]) == named | {"bathymetric": "B"}
    assert values(cards[5]) == {"photo": "1", "point": "103", "x": 12.3, "y": 4.5, "bathymetric": "B"}
    assert (
        musat("tidy", tmp_path / "tidy.crd", "-o", "-", "-q").stdout_bytes == (tmp_path / "tidy.crd").read_bytes()
    )


@pytest.mark.slow
def test_a_deck_in_small_letters_is_that_in_capitals() -> None:
    path = FIXTURES / "cayman" / "cayman_modified.crd"
    assert tidied(path.read_bytes().lower(), card_family()).data == path.read_bytes().upper()


@pytest.mark.parametrize("path", sorted((FIXTURES / "cayman").glob("*.crd")), ids=lambda path: path.stem)
def test_decks_that_read_well_stay_byte_by_byte(path: Path) -> None:
    assert tidied(path.read_bytes(), card_family()).data == path.read_bytes()


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("PLT 1 103 12.345", "no word for y"),
        ("PLT 1 103 12.345 x", "PLT.y: 'x' is not a number"),
        ("PLT 1 103 1 2 3 4 5 6 7 8 9 10", "12 words for the"),
        ("PLTE 1 103 12.3 4.5", "'PLTE' is no card; did you mean PLT?"),
        ("CAM TOOLONG 153.17", "CAM.camera: 'TOOLONG' is not A4"),
        ("PLT 1 103 12.345678912 4.5", "PLT.x: '12.345678912' does not fit F12.7"),
        (
            "OPT IIA 5 0.1",
            "in more than one way a card OPT: program=IIA max_iterations=5 rotation_limit=0.100, or ",
        ),
    ],
)
def test_what_cannot_be_placed_is_told_and_stays(tmp_path: Path, card: str, message: str) -> None:
    assert message in tidy_card(card, card_family())[1]
    (tmp_path / "typed.crd").write_text(f"{card}\nEND\n")
    result = musat("tidy", tmp_path / "typed.crd", "-o", tmp_path / "tidy.crd")
    assert result.exit_code == 1 and "typed.crd:1: " in result.stderr and message in result.stderr
    assert (tmp_path / "tidy.crd").read_text() == f"{card}\nEND\n"


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_table_makes_a_card_of_each_row(tmp_path: Path, separator: str) -> None:
    """Numbers with decimal commas where semicolons part them; the cards of words and of names and values."""
    point = "." if separator == "," else ","
    rows = ["Photo,point,x,y,bathymetric", "1,101,12.345,-56.789,", "1,102,8.5,4.25,B"]
    lines = [rows[0].replace(",", separator)]
    lines += [separator.join(cell.replace(".", point) for cell in row.split(",")) for row in rows[1:]]
    (tmp_path / "plates.csv").write_text("\n".join(lines))
    made = musat("card", "PLT", "--csv", tmp_path / "plates.csv").stdout.splitlines()
    by_names = ["photo=1 point=101 x=12.345 y=-56.789", "photo=1 point=102 x=8.5 y=4.25 bathymetric=B"]
    assert made == [musat("card", "plt", *names.split()).stdout.rstrip() for names in by_names]
    (tmp_path / "tilts.csv").write_text("photo,x_tilt,y_tilt,heading\n21,-0 30 45.2,1 20 9.2,0 23 41.9\n")
    tilts = musat("card", "att", "--csv", tmp_path / "tilts.csv").stdout
    assert (
        tilts
        == musat("card", "ATT", "photo=21", "x_tilt=-0 30 45.2", "y_tilt=1 20 9.2", "heading=0 23 41.9").stdout
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("photo,point,x\n1,101,2.0\n", "table.csv:1: no column y"),
        ("photo,point,x,y,colour\n1,101,2.0,3.0,red\n", "table.csv:1: unknown column colour"),
        ("photo,point,x,y\n1,101,2.0,abc\n", "table.csv:2 cols 11-13 y: PLT.y: 'abc' is not a number"),
        (
            "photo,point,x,y,bathymetric\n1,101,2,3,Q\n",
            "table.csv:2 col 11 bathymetric: PLT.bathymetric: 'Q' is not A1",
        ),
        ("photo,point,x,y\n", "table.csv: no rows"),
    ],
)
def test_rows_that_make_no_card_are_told_by_line_and_column(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "table.csv").write_text(text)
    result = musat("card", "PLT", "--csv", tmp_path / "table.csv")
    assert result.exit_code == 1 and not result.stdout
    assert message in result.stderr
