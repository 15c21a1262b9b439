"""The formats of files of records: what TOML may say, fields, lines, and files that are wrong."""

import math
import re
import shutil
from pathlib import Path

import pytest

from musatpy.errors import CardFormatError, DeckError
from musatpy.formats.cards.spec import card_formats_folder
from musatpy.formats.families import RecordSet, agencies, families
from musatpy.formats.records.fields import RecordField
from musatpy.formats.records.files import read_records, write_records
from musatpy.formats.records.layout import load_files, record_line, record_values
from musatpy.fortran import FieldError, parse_edit
from musatpy.units import ARC_SECOND, DEGREE

OWN = (card_formats_folder() / "bingo" / "image.toml").read_text()


@pytest.fixture
def own(tmp_path):
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "images.toml").write_text(OWN)
    return folder


@pytest.mark.parametrize("name", agencies())
def test_samples_of_every_agency_are_lines_of_their_records(name):
    for file in agencies()[name].files:
        assert file.source.count(".") >= 2 and file.doc
        for record in file.records:
            assert record_line(record, record_values(record, record.sample), file.free) == record.sample
            assert all(field.doc for field in record.fields)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('layout = "free"', 'layout = "loose"', "layout: 'loose' is not one of fixed, free"),
        ('layout = "free"', 'layout = "fixed"', r"columns: not \[first, last\]"),
        ('follows = ["start", "end"]', 'follows = ["start", "photo"]', "follows: no record photo"),
        ("last = true", "", "last: the file may end after no record"),
        ('name = "header"', 'name = "header"\njoins = "header"', "joins: no record before it"),
        ('edit = "F12.6"', 'edit = "F12.12"', "edit: 'F12.12' is not a descriptor wide enough"),
        ('unit = "mm"', 'unit = "inch"', "unit: 'inch' is not one of m, mm"),
        ('unit = "mm"\ntarget = "plates.xy[1]"', 'unit = "m"\ntarget = "control.sigma[0]"', "cannot say both"),
        ('target = "plates.photo"', 'target = "plates.foto"', "'plates.foto' is not in the model"),
        ("101    83.845000", "101   83.845000", "does not encode to itself"),
        ('edit = "A16"', 'edit = "A16"\nnone = 3.0', "a text has no such key"),
        ("last = true", 'last = true\nconstants = { "control.kind" = "Q" }', "no letter of a deck"),
        ('name = "y"', 'name = "x"', "field: two have the same name"),
    ],
)  # fmt: skip
def test_a_wrong_format_is_refused_with_its_key(own, old, new, expected):
    assert old in OWN
    (own / "images.toml").write_text(OWN.replace(old, new, 1))
    with pytest.raises(CardFormatError, match=expected):
        RecordSet(own).files  # noqa: B018


def test_own_families_come_first_and_may_be_cards(own, tmp_path):
    assert list(families(own))[:2] == ["own", "musat"]
    assert families(card_formats_folder() / "musat")["musat"].patterns == ("*.crd",)
    (tmp_path / "empty").mkdir()
    with pytest.raises(CardFormatError, match="no formats"):
        load_files(tmp_path / "empty")


# --- fields ---


def field(edit, **keys):
    return RecordField(name="one", columns=(1, parse_edit(edit).width), edit=parse_edit(edit), **keys)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("-811836.0000", -(81 + 18 / 60 + 36 / 3600)),
        ("     -0.5000", -0.5 / 3600),
        ("1795959.9999", 180 - 1e-4 / 3600),
        ("  10000.0000", 1.0 - 1e-6 / 3600),  # seconds carry
        ("-1233000.000", -123.5),  # and lose decimals where there is no room
    ],
)
def test_packed_angles(text, degrees):
    packed = field("F12.4", unit="dms")
    assert packed.encode(degrees * DEGREE) == text
    assert packed.decode(text) == pytest.approx(
        degrees * DEGREE, abs=0.51e-4 * ARC_SECOND
    )  # half of the last digit
    for beyond in ("     6100.00", "       60.00"):
        with pytest.raises(FieldError, match="DDDMMSS"):
            packed.decode(beyond)


def test_numbers_and_texts_that_stand_for_something_else():
    none = field("F12.4", unit="m", none=900000.0)
    assert math.isnan(none.decode(" 900000.0000")) and none.encode(math.nan) == " 900000.0000"
    kind = field("A1", codes=(("0", "F"), ("3", "H")))
    assert kind.decode("3") == "H" and kind.encode("F") == "0"
    for bad in (lambda: kind.decode("1"), lambda: kind.encode("C"), lambda: kind.decode(" ")):
        with pytest.raises(FieldError):
            bad()
    assert field("A6", justify="right").encode("12") == "    12"
    assert field("I8").encode(-105.6) == "    -106"


def test_words_of_a_free_layout_may_have_any_width():
    free = field("F6.2", free=True)
    assert free.decode("1234567.125") == 1234567.125
    assert free.decode("15") == 15.0  # no implied point
    for bad in ("1l.5", "9" * 400, "inf", "1_0"):
        with pytest.raises(FieldError, match="a number"):
            free.decode(bad)


# --- files ---


def problems(data, spec):
    return [problem.headline() for problem in read_records(data, spec, "f").problems]


def test_every_bad_record_is_reported_with_its_place(own):
    (spec,) = RecordSet(own).files
    data = b"841\n1103 1.0 2.0\n1104 l.0 2,0\n\n1105\n1106 1.0 2.0 3.0\n11\xb05 1.0 2.0\n-99\n"
    assert problems(data, spec) == [
        "f:3 cols 6-8 point.x: 'l.0' is not a number",
        "f:3 cols 10-12 point.y: '2,0' is not a number",
        "f:5 col 5 point.x: blank, expected F12.6",
        "f:5 col 5 point.y: blank, expected F12.6",
        "f:6 cols 14-16 point: '3.0' is a word too many",
        "f:7 col 3: a character that is not printable ASCII",
    ]


IMAGE, CONTROL, FRAME = agencies()["patb"].files[0], agencies()["giant"].files[1], agencies()["giant"].files[2]
KNOWN, (FIRST, SECOND) = CONTROL.records[0].sample, [record.sample for record in FRAME.records]


@pytest.mark.parametrize(
    ("spec", "text", "found"),
    [
        (IMAGE, "-99\n", "f:1 cols 1-3: '-99' is no record that may stand here; expected header"),
        (IMAGE, "841\n1103 1 2\n", "f:2: the file ends after point; expected point or -99"),
        (
            IMAGE,
            "841\n-99\n842\n1 2 3\n-99\n",
            "f:1 header: warning: nothing belongs to this record: it is left out",
        ),
        (IMAGE, "", "f: the file has no records"),
        (CONTROL, f"{KNOWN[:75]}x{KNOWN[76:]}\n", "f:1 col 76 control: 'x' stands in columns of no field"),
        (CONTROL, f"{KNOWN[:79]}1\n", "f:1 col 80 control.type: '1' is not A1 (one of 0, 3, 4)"),
        (
            FRAME,
            f"{FIRST}\n842{SECOND[3:]}\n",
            "f:2 cols 1-8 deviations.frame_again: '842' is not '841', the frame of the record before",
        ),
        (
            agencies()["bingo"].files[1],
            "C a comment\n* another\nCONT 1 10. 20. 30.\nCAPA 1 0 152.0\nCAPA 2 0 153.0\nCHCK 2 1 2 3\n",
            "f: warning: 2 records 'CAPA' left out: no format says what it holds",
        ),
    ],
)
def test_records_stand_where_they_may_and_say_what_their_format_allows(spec, text, found):
    assert problems(text.encode(), spec)[-1] == found


def read(family, tmp_path, **texts):
    for name, text in texts.items():
        (tmp_path / name.replace("_", ".")).write_text(text)
    return agencies()[family].read(tmp_path, {})


def test_what_is_given_twice_and_what_is_no_rotation_is_found(tmp_path):
    station, first, second = (record.sample for record in agencies()["patb"].files[2].records)
    good = f"{station}\n{first}\n{second}\n"
    with pytest.raises(DeckError) as caught:
        read("patb", tmp_path, job_ori=f"{good}{good}")
    assert "job.ori:6: stations: 841 is given twice" in str(caught.value)
    assert "attitudes: 841 is given twice" in str(caught.value)
    with pytest.raises(DeckError, match="ori:3: the nine elements are no rotation"):
        read("patb", tmp_path, job_ori=good.replace("0.600000000000\n", "0.500000000000\n"))
    with pytest.raises(DeckError, match="no rotation"):
        read("patb", tmp_path, job_ori=good.replace("  1.000000000000\n", " -1.000000000000\n"))


def test_files_of_several_sets_are_not_mixed(tmp_path):
    orientation = "\n".join(record.sample for record in agencies()["patb"].files[2].records) + "\n"
    with pytest.raises(DeckError, match=r"files of several sets \(a, b\)"):
        read("patb", tmp_path, a_ori=orientation, b_ori=orientation)
    found, _ = agencies()["patb"].read(tmp_path / "a.ori", {})
    assert found["stations"]["photos.ids"].tolist() == ["841"]


def test_line_ends_of_other_systems_are_read(own):
    (spec,) = RecordSet(own).files
    tables = read_records(b"841\r\n1103 1.0 2.0\r\n-99\r\n\x1a", spec, "f").tables
    assert tables["point"]["point"].tolist() == ["1103"]

    assert write_records(spec, tables, "f").split() == [b"841", b"1103", b"1.000000", b"2.000000", b"-99"]


@pytest.mark.parametrize(
    "name", ["/tmp/elsewhere.txt", "../*.img", "..", ".", "", "a/*.img", r"a\\*.img", "C:x.img", r"*\u001b.img"]
)
def test_files_of_a_family_stay_in_the_folder_of_results(tmp_path, name):
    folder = Path(shutil.copytree(card_formats_folder() / "giant", tmp_path / "own"))
    path = folder / "img.toml"
    path.write_text(path.read_text().replace('file = "*.img"', f'file = "{name}"'))
    with pytest.raises(CardFormatError, match=rf"{re.escape(str(path))}: file: "):
        _ = RecordSet(folder).files
