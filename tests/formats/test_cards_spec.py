"""Card formats: loading, what is wrong in one, their manual, and that they fill the model."""

import math
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from formats.deck_edits import deck
from musatpy.errors import CardFormatError
from musatpy.formats import musat
from musatpy.formats.cards.manual import card_manual
from musatpy.formats.cards.spec import CardSpec, FieldSpec, card_formats_folder, load_family
from musatpy.formats.compilation_deck import compilation_family
from musatpy.formats.job_tables import card_family
from musatpy.fortran import FieldError, parse_edit
from musatpy.specs import keys

CARD = (card_formats_folder() / "musat" / "tid.toml").read_text(encoding="utf-8")


def write_family(folder, *cards):
    for i, card in enumerate(cards):
        (folder / f"card{i}.toml").write_text(card, encoding="utf-8")
    return folder


def test_a_family_is_loaded_in_canonical_order(tmp_path):
    water = CARD.replace("TID", "WTR").replace("order = 110", "order = 5")
    family = load_family(write_family(tmp_path, CARD, water))
    assert family.name == tmp_path.name
    assert list(family.cards) == ["WTR", "TID"]
    tide = family.cards["TID"]
    assert [field.name for field in tide.fields] == ["photo", "height", "sigma", "group", "day", "time"]
    sigma = tide.field("sigma")
    assert (sigma.first, sigma.last, str(sigma.edit)) == (25, 32, "F8.4")
    assert (sigma.blank, sigma.asterisks, sigma.unit) == ("missing", True, "m")
    assert tide.field("photo").blank == "error"
    with pytest.raises(KeyError, match=r"TID\.camera"):
        tide.field("camera")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('mnemonic = "TID"', 'mnemonic = "Tide"', "mnemonic: 'Tide' is not three capitals"),
        ('title = "Tide"', 'titel = "Tide"', "titel: is no key here; there are mnemonic, title,"),
        ('title = "Tide"\n', "", "title: is missing: what the card is called"),
        ("order = 110", 'order = "110"', "order: a whole number is expected, not '110'"),
        ("order = 110", "order = ", "Invalid value"),
        ('name = "sigma"', 'name = "height"', "field height: a second field"),
        ('name = "sigma"', 'name = "Sigma"', "'Sigma' is not a lower case identifier"),
        ("columns = [25, 32]", "columns = [23, 30]", "field sigma: columns: overlap those of height"),
        ("columns = [5, 12]", "columns = [3, 10]", "columns: 3-10 is not within 4-72"),
        ("columns = [25, 32]", "columns = [25, 33]", "columns: 25-33 is 9 wide, F8.4 is 8"),
        ('edit = "F8.4"', 'edit = "8X"', "edit: '8X' is not an edit descriptor"),
        ('unit = "m"\ntarget = "photos.tide_', 'unit = "feet"\ntarget = "photos.tide_', "unit: 'feet' is not one"),
        ('blank = "missing"', 'blank = "null"', "blank: not one of ('error', 'missing', 'zero')"),
        ("asterisks = true", 'allowed = ["1"]', "allowed: only for texts"),
        ('edit = "A8"', 'edit = "A8"\nallowed = ["LONGER THAN 8"]', "allowed: values that do not fit A8"),
        ('edit = "A8"', 'edit = "A8"\nasterisks = true', "asterisks: only for numbers"),
        ('edit = "A8"', 'edit = "A8"\nallowed = ["842"]', "sample: '841' is not A8 (one of 842)"),
        ("0.0500 STRIP2", "0.0500XSTRIP2", "sample: does not encode to itself"),
    ],
)
def test_what_is_wrong_in_a_format_is_named(tmp_path, old, new, message):
    assert CARD.count(old) >= 1
    folder = write_family(tmp_path, CARD.replace(old, new, 1))
    with pytest.raises(CardFormatError, match=re.escape(message)) as caught:
        load_family(folder)
    assert "card0.toml" in str(caught.value)


def test_a_folder_has_formats_of_which_each_is_text_and_of_another_card(tmp_path):
    with pytest.raises(CardFormatError, match="no card formats"):
        load_family(tmp_path)
    with pytest.raises(CardFormatError, match=r"card1\.toml: mnemonic: TID is already"):
        load_family(write_family(tmp_path, CARD, CARD))
    header = CARD[: CARD.index("[[field]]")]
    with pytest.raises(CardFormatError, match="field 1: a table is expected, not 'photo'"):
        load_family(write_family(tmp_path, header + 'field = ["photo"]\n'))
    (tmp_path / "card0.toml").write_bytes(b'title = "\xe9"')
    with pytest.raises(CardFormatError, match=r"card0\.toml"):
        load_family(tmp_path)


# --- fields ---

TEXT = FieldSpec(name="id", columns=(5, 8), edit=parse_edit("A4"))
CHOICE = FieldSpec(name="kind", columns=(5, 8), edit=parse_edit("A4"), blank="missing", allowed=("GEOG", "F"))
NUMBER = FieldSpec(name="x", columns=(5, 11), edit=parse_edit("F7.5"))
MISSING = FieldSpec(name="x", columns=(5, 11), edit=parse_edit("F7.5"), blank="missing", asterisks=True)
ZERO = FieldSpec(name="x", columns=(5, 11), edit=parse_edit("F7.5"), blank="zero")


@pytest.mark.parametrize(
    ("field", "text", "value"),
    [
        (TEXT, " P 1", "P 1"),  # embedded blanks are part of a text
        (CHOICE, "F   ", "F"),
        (CHOICE, "    ", ""),
        (NUMBER, "123.457", 123.457),
        (MISSING, " " * 7, math.nan),
        (MISSING, "*" * 7, math.nan),
        (ZERO, " " * 7, 0.0),
    ],
)
def test_fields_are_read(field, text, value):
    assert field.decode(text) == pytest.approx(value, nan_ok=True)
    assert field.decode(field.encode(value)) == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize(
    ("field", "text", "message"),
    [
        (TEXT, "    ", "A4"),
        (CHOICE, "geog", "A4 (one of GEOG, F)"),
        (NUMBER, " " * 7, "F7.5"),
        (NUMBER, "*******", "F7.5"),
    ],
)
def test_fields_refuse_text(field, text, message):
    with pytest.raises(FieldError, match=re.escape(message)):
        field.decode(text)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        (TEXT, "", "A4"),
        (TEXT, "PHOTO", "up to 4 ASCII"),
        (TEXT, "é", "up to 4 ASCII"),
        (TEXT, " P", "no outer blanks"),
        (CHOICE, "LOCL", "one of GEOG, F"),
        (ZERO, math.nan, "'nan' is not a value of F7.5"),
        (NUMBER, 1e8, "a number that fits F7.5"),
    ],
)
def test_fields_refuse_values(field, value, message):
    with pytest.raises(FieldError, match=re.escape(message)):
        field.encode(value)


@pytest.fixture(scope="module")
def family():
    return load_family(card_formats_folder() / "musat")


def test_every_key_is_explained(family):
    manual = card_manual(family)
    assert all(f"| `{key}` |" in manual for key in [*keys(CardSpec), *keys(FieldSpec)])


def test_the_readme_of_the_card_formats_is_current():
    command = [sys.executable, "-m", "musatpy.formats.cards.manual"]
    manual = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    readme = (card_formats_folder() / "README.md").read_text(encoding="utf-8")
    assert readme == manual, (
        "card_formats/README.md is stale; regenerate it with "
        "`python -m musatpy.formats.cards.manual > card_formats/README.md`"
    )


FAMILY = card_family()


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A folder with a copy of the native cards."""
    return Path(shutil.copytree(card_formats_folder() / "musat", tmp_path / "mine"))


def changed(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("card", "old", "new", "message"),
    [
        ("plt", '"plates.xy[0]"', '"plates.uv[0]"', "PLT.x: target: 'plates.uv[0]' is not in the model; expected"),
        ("plt", '"plates.xy[0]"', '"plates.xy[1]"', "PLT.y: target: 'plates.xy[1]' is another field's"),
        ("plt", '"plates.xy[0]"', '"plates.xy[2]"', "components [2, 1] do not count from 0"),
        ("att", '"photos.attitude[2]:min"', '"photos.attitude[2]"', "degrees, minutes and seconds go together"),
        ("stx", '"photos.camera"', '"photos.tide"', "STX has no target photos.camera"),
        ("red", '"reduction.side"', '"reduction.side"\nunit = "um"', "RED.side: unit: 'um', of a field of letters"),
        ("tid", '"photos.time"', '"photos.position"', "target photos.position: 1 components, expected 3"),
        ("plt", '"plates.photo"', '"plates.photo plates.triangulated"', "'plates.photo' has no letters to share"),
    ],
)
def test_formats_that_fill_no_block_are_refused(mine: Path, card: str, old: str, new: str, message: str) -> None:
    changed(mine / f"{card}.toml", old, new)
    with pytest.raises(CardFormatError, match=re.escape(message)):
        card_family(mine)


def test_what_the_model_does_not_take_from_a_card_is_refused(mine: Path) -> None:
    file = mine / "tid.toml"
    kind = '[[field]]\nname = "camera"\ncolumns = [63, 70]\nedit = "A8"\ntarget = "photos.camera"\n'
    file.write_text(f"{file.read_text(encoding='utf-8')}\n{kind}blank = 'missing'\ndoc = ''\n", encoding="utf-8")
    expected = r"tid\.toml: field camera: target: 'photos\.camera' is nowhere .* one of photos\.ids, photos\.tide,"
    with pytest.raises(CardFormatError, match=expected):
        card_family(mine)


def test_a_card_by_which_nothing_is_known_is_refused(mine: Path) -> None:
    text = (mine / "tid.toml").read_text(encoding="utf-8").replace("TID", "TIM")
    head, photo, *_, time = text.split("[[field]]")
    head = head.replace(text.split('sample = "')[1][16:50], " " * 34)
    (mine / "tim.toml").write_text(f"{head}[[field]]{photo}[[field]]{time}", encoding="utf-8")
    with pytest.raises(CardFormatError, match=r"tim\.toml: field photo: target: 'photos\.ids' is nowhere"):
        card_family(mine)


def test_a_family_without_tides_fills_no_block(mine: Path) -> None:
    (mine / "tid.toml").unlink()
    with pytest.raises(CardFormatError, match=r"no card has the target photos\.tide"):
        card_family(mine)


def test_another_layout_of_the_same_cards_reads_and_writes_decks(mine: Path) -> None:
    file = mine / "tid.toml"
    moved = file.read_text(encoding="utf-8")
    for columns, others in (
        ("[52, 61]", "[61, 70]"),
        ("[25, 32]", "[34, 41]"),  # the sigma nine columns on, the others out of its way
        ('[34, 41]\nedit = "A8"', '[52, 59]\nedit = "A8"'),
    ):
        moved = moved.replace(columns, others)
    tide = FAMILY.cards["TID"].sample
    sample = f"{tide[:24]}{'':9}{tide[24:32]} {tide[42:50]} {tide[33:41]} {tide[51:61]}".ljust(72) + tide[72:]
    file.write_text(moved.replace(tide, sample), encoding="utf-8")
    family = card_family(mine)
    old = b"TID 841          0.2000   0.0500".ljust(80)
    new = b"TID 841          0.2000            0.0500".ljust(80)
    block = musat.read_deck(deck(lambda lines: [line if line[:7] != "TID 841" else old.decode() for line in lines]))
    data = musat.deck_bytes(block, family)
    assert new[:72] in data
    assert musat.deck_bytes(musat.read_deck(data, family)) == musat.deck_bytes(block)


@pytest.mark.parametrize(
    ("card", "old", "new", "message"),
    [
        ("stg", '"stages.xy[0]"', '"stages.yx[0]"',
         "'stages.yx[0]' is not in the model; expected one of stages.model, stages.ids"),
        ("stg", 'unit = "mm"\ntarget = "stages.xy[1]"', 'unit = "deg"\ntarget = "stages.xy[1]"',
         "STG.y_left: unit: 'deg', expected mm or um"),
        ("ptm", '"profile_times.time[4]"', '"profile_times.time[5]"',
         "target profile_times.time: components [0, 1, 2, 3, 5] do not count from 0"),
    ],
)  # fmt: skip
def test_a_target_or_unit_that_is_not_of_a_compilation_is_refused(
    tmp_path: Path, card: str, old: str, new: str, message: str
) -> None:
    folder = Path(shutil.copytree(card_formats_folder() / "as11", tmp_path / "as11"))
    changed(file := folder / f"{card}.toml", old, new)
    with pytest.raises(CardFormatError, match=re.escape(message)) as caught:
        compilation_family(folder)
    assert str(caught.value).startswith(str(file))
