"""Card formats: what loads, what is refused, and where they are found."""

from __future__ import annotations

import math
import re

import pytest

from musatpy.errors import CardFormatError
from musatpy.formats.cards import FieldSpec, card_formats_folder, load_family
from musatpy.fortran import FieldError, parse_edit

CARD = """
mnemonic = "TID"
title = "Tide"
doc = "The height of the water surface at an exposure."
order = 10
repeat = "many"
required = false
sample = "TID 841          -0.4100  0.0500                                        00000001"

[[field]]
name = "photo"
columns = [5, 12]
edit = "A8"
target = "photos.ids"
doc = "Photo."

[[field]]
name = "height"
columns = [14, 24]
edit = "F11.4"
unit = "m"
target = "photos.tide"
doc = "Height."

[[field]]
name = "sigma"
columns = [25, 32]
edit = "F8.4"
unit = "m"
target = "photos.tide_sigma[0]:deg"
blank = "missing"
asterisks = true
doc = "Its standard deviation."
"""


def write_family(folder, *cards):
    for i, card in enumerate(cards):
        (folder / f"card{i}.toml").write_text(card, encoding="utf-8")
    return folder


def test_a_family_is_loaded(tmp_path):
    family = load_family(write_family(tmp_path, CARD))
    assert family.name == tmp_path.name
    assert list(family.cards) == ["TID"]
    tide = family.cards["TID"]
    assert [field.name for field in tide.fields] == ["photo", "height", "sigma"]
    sigma = tide.field("sigma")
    assert (sigma.first, sigma.last, str(sigma.edit)) == (25, 32, "F8.4")
    assert (sigma.blank, sigma.asterisks, sigma.unit) == ("missing", True, "m")
    assert tide.field("photo").blank == "error"
    with pytest.raises(KeyError, match=r"TID\.camera"):
        tide.field("camera")


def test_cards_are_in_canonical_order(tmp_path):
    water = CARD.replace("TID", "WTR").replace("order = 10", "order = 5")
    assert list(load_family(write_family(tmp_path, CARD, water)).cards) == ["WTR", "TID"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('mnemonic = "TID"', 'mnemonic = "Tide"', "mnemonic: 'Tide' is not three capitals"),
        ('title = "Tide"', 'titel = "Tide"', "titel: unknown key"),
        ('title = "Tide"\n', "", "title: key is missing"),
        ("order = 10", 'order = "10"', "order: '10' is not a int"),
        ("required = false", "required = 0", "required: 0 is not a bool"),
        ('repeat = "many"', 'repeat = "any"', "repeat: not one or many"),
        ("order = 10", "order = ", "Invalid value"),
        ('name = "sigma"', 'name = "height"', "field height: a second field"),
        ('name = "sigma"', 'name = "Sigma"', "'Sigma' is not a lower case identifier"),
        ("columns = [25, 32]", "columns = [24, 31]", "field sigma: columns: overlap those of height"),
        ("columns = [25, 32]", "columns = [67, 74]", "columns: 67-74 is not within 4-72"),
        ("columns = [5, 12]", "columns = [3, 10]", "columns: 3-10 is not within 4-72"),
        ("columns = [25, 32]", "columns = [25, 33]", "columns: 25-33 is 9 wide, F8.4 is 8"),
        ("columns = [25, 32]", "columns = [32, 25]", "columns: 32-25 is not within"),
        ("columns = [25, 32]", "columns = [25]", "columns: not [first, last]"),
        ("columns = [25, 32]", "column = [25, 32]", "column: unknown key"),
        ('edit = "F8.4"', 'edit = "F8"', "edit: 'F8' is not an edit descriptor"),
        ('edit = "F8.4"', 'edit = "8X"', "edit: columns to skip need no field"),
        ('unit = "m"\ntarget = "photos.tide_', 'unit = "feet"\ntarget = "photos.tide_', "unit: not one of"),
        ("photos.tide_sigma[0]:deg", "photos..tide", "target: not a dotted attribute"),
        ("photos.tide_sigma[0]:deg", "photos.tide:rad", "target: not a dotted attribute"),
        ('blank = "missing"', 'blank = "null"', "blank: not one of ('error', 'missing', 'zero')"),
        ("asterisks = true", 'asterisks = "yes"', "asterisks: 'yes' is not a bool"),
        ("asterisks = true", 'allowed = ["1"]', "allowed: only for texts"),
        ('edit = "A8"', 'edit = "A8"\nallowed = ["LONGER THAN 8"]', "allowed: values that do not fit A8"),
        ('edit = "A8"', 'edit = "A8"\nallowed = [1]', "allowed: not a list of strings"),
        ('edit = "A8"', 'edit = "A8"\nasterisks = true', "asterisks: only for numbers"),
        ('edit = "A8"', 'edit = "A8"\nblank = "zero"', "blank: not one of ('error', 'missing')"),
        ('edit = "A8"', 'edit = "A8"\nallowed = ["842"]', "sample: '841' is not A8 (one of 842)"),
        ("-0.4100", "-0.41OO", "sample: '    -0.41OO' is not F11.4"),
        ("-0.4100", "-0.4100"[:-1] + " ", "sample: does not encode to itself"),
        ('00000001"', '00000002"', "sample: does not encode to itself"),
        ("0.0500    ", "0.0500   X", "sample: does not encode to itself"),
    ],
)
def test_what_is_wrong_in_a_format_is_named(tmp_path, old, new, message):
    assert CARD.count(old) >= 1
    folder = write_family(tmp_path, CARD.replace(old, new, 1))
    with pytest.raises(CardFormatError, match=re.escape(message)) as caught:
        load_family(folder)
    assert "card0.toml" in str(caught.value)


def test_a_mnemonic_stands_in_one_file(tmp_path):
    with pytest.raises(CardFormatError, match=r"card1\.toml: mnemonic: TID is already"):
        load_family(write_family(tmp_path, CARD, CARD))


def test_fields_are_tables_and_the_file_is_text(tmp_path):
    header = CARD[: CARD.index("[[field]]")]
    with pytest.raises(CardFormatError, match="field 1: not a table"):
        load_family(write_family(tmp_path, header + 'field = ["photo"]\n'))
    (tmp_path / "card0.toml").write_bytes(b'title = "\xe9"')
    with pytest.raises(CardFormatError, match=r"card0\.toml"):
        load_family(tmp_path)


def test_a_folder_without_formats_is_refused(tmp_path):
    with pytest.raises(CardFormatError, match="no card formats"):
        load_family(tmp_path)


def test_the_native_family_loads():
    family = load_family(card_formats_folder() / "musat")
    assert list(family.cards) == [
        "TTL", "OPT", "OP2", "RED", "CMP", "ORI", "ELL", "SYS", "SYT", "SYO", "SYF", "WTR", "WTC", "WAV", "WVS",
        "WOG", "WOD", "WOX", "CAM", "DST", "LNS", "FID", "FDS", "RSC", "STA", "STD", "STX", "ATT", "ATD", "MAT",
        "TID", "FMS", "RSM", "PLT", "CTG", "CTD",
        "CTX", "EQL", "BAS", "DIS", "HDF", "END",
    ]  # fmt: skip


# --- fields ---

TEXT = FieldSpec(name="id", columns=(5, 8), edit=parse_edit("A4"))
CHOICE = FieldSpec(name="kind", columns=(5, 8), edit=parse_edit("A4"), blank="missing", allowed=("GEOG", "F"))
NUMBER = FieldSpec(name="x", columns=(5, 11), edit=parse_edit("F7.5"))
MISSING = FieldSpec(name="x", columns=(5, 11), edit=parse_edit("F7.5"), blank="missing", asterisks=True)
ZERO = FieldSpec(name="x", columns=(5, 11), edit=parse_edit("F7.5"), blank="zero")


def test_fields_decode():
    assert TEXT.decode(" P 1") == "P 1"  # embedded blanks are part of a text
    assert TEXT.decode("P1") == "P1"
    assert CHOICE.decode("F   ") == "F"
    assert CHOICE.decode("    ") == ""
    assert NUMBER.decode("1.5    ") == 1.5
    assert math.isnan(MISSING.decode(" " * 7))
    assert math.isnan(MISSING.decode("*" * 7))
    assert ZERO.decode(" " * 7) == 0.0


@pytest.mark.parametrize(
    ("field", "text", "message"),
    [
        (TEXT, "    ", "A4"),
        (CHOICE, "geog", "A4 (one of GEOG, F)"),
        (NUMBER, "       ", "F7.5"),
        (NUMBER, "*******", "F7.5"),
        (NUMBER, "1.2.3  ", "F7.5"),
    ],
)
def test_fields_refuse_text(field, text, message):
    with pytest.raises(FieldError, match=re.escape(message)):
        field.decode(text)


def test_fields_encode():
    assert TEXT.encode("P1") == "P1  "
    assert CHOICE.encode("") == "    "
    assert NUMBER.encode(0.01) == "0.01000"
    assert NUMBER.encode(123.456789) == "123.457"
    assert MISSING.encode(math.nan) == " " * 7


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        (TEXT, "", "A4"),
        (TEXT, "PHOTO", "up to 4 ASCII"),
        (TEXT, "é", "up to 4 ASCII"),
        (TEXT, " P", "no outer blanks"),
        (TEXT, "P\t1", "up to 4 ASCII"),
        (CHOICE, "LOCL", "one of GEOG, F"),
        (NUMBER, math.nan, "'nan' is not a value of F7.5"),
        (ZERO, math.nan, "'nan' is not a value of F7.5"),
        (NUMBER, 1e8, "a number that fits F7.5"),
    ],
)
def test_fields_refuse_values(field, value, message):
    with pytest.raises(FieldError, match=re.escape(message)):
        field.encode(value)
