"""Pages, edit descriptors, and tables as CSV files."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.fortran import FieldError, parse_edit, write_number
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports import table
from musatpy.reports.editing import MANY, edited, field_width
from musatpy.reports.fields import unrecorded
from musatpy.reports.listing import sections_of
from musatpy.reports.pages import PAGE_LINES, Section, csv_files, paginate
from musatpy.reports.record import record_of
from musatpy.runs import run_deck
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND
from record_rows import read_rows
from sample_solutions import sample_solution


def numbered(count):
    return [f"row {number}" for number in range(count)]


@pytest.mark.parametrize("filled", range(40, 60))
def test_a_heading_is_never_left_alone_at_the_foot_of_a_page(filled):
    first, second = Section(title="A", lines=numbered(filled - 2)), Section(title="B", lines=numbered(30))
    pages = paginate([first, second])
    for page in pages:
        assert len(page) <= PAGE_LINES - 2
        if "B" in page:
            assert len(page) - page.index("B") >= 2 + 4


@pytest.mark.parametrize(
    "second",
    [Section(title="B", lines=numbered(20), together=True), Section(title="B", lines=["row"], new_page=True)],
    ids=["stays together", "starts a page"],
)
def test_a_section_that_stays_together_or_starts_a_page_moves_to_the_next_one(second):
    first = Section(title="A", lines=numbered(40), new_page=True)  # there is no page to be left
    assert [page[0] for page in paginate([first, second])] == ["A", "B"]


@given(st.floats(allow_nan=True, allow_infinity=True), st.integers(3, 20), st.integers(0, 8))
def test_fixed_is_fortran_without_the_zero_before_the_point(value, width, decimals):
    width = max(width, decimals + 2)
    plain = write_number(value, parse_edit(f"F{width}.{decimals}"))
    if decimals and plain.lstrip(" -").startswith("0."):
        plain = plain.strip().replace("0.", ".", 1).rjust(width)
    assert edited(f"F{width}.{decimals}", [value]) == [plain]


@pytest.mark.parametrize(
    ("edit", "value", "text"),
    [
        ("F8.2", -0.66, "    -.66"),  # Table 6-7
        ("F8.2", -0.004, "     .00"),
        ("F6.2", -100.0, "******"),
        ("F6.2", math.nan, "      "),
        ("F6.2", math.inf, "******"),
        ("I4", -12345, "****"),
        ("E10.3", 0.00015, "  .150E-03"),
        ("A4", "ABCDEF", "ABCD"),
        ("S14.3", -0.281 * ARC_SECOND, "  -0  0   .281"),  # Table 6-1
        ("S14.3", -4922.182 * ARC_SECOND, "  -1 22  2.182"),  # Table 6-2
        ("S14.3", -0.0004 * ARC_SECOND, "   0  0   .000"),  # no sign on what rounds to zero
        ("S14.3", 59.9996 * ARC_SECOND, "   0  1   .000"),  # the carry goes through
        ("S14.3", -3599.9999 * ARC_SECOND, "  -1  0   .000"),
        ("S14.3", math.nan, " " * 14),
        ("S14.3", 1e9, "*" * 14),
    ],
)
def test_one_field(edit, value, text):
    assert edited(edit, [value]) == [text]
    assert field_width(edit) == len(text)


NUMBERS = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-1e4, 1e4) | st.integers(-(10**6), 10**6)
SHORT = st.integers(-(10**7), 10**7).map(lambda number: number / 2**7)  # decimals that are ties
TIES = st.integers(-(10**6), 10**6).map(lambda number: (number + 0.5) / 1000.0)  # but for the last bit


@given(
    st.lists(NUMBERS.map(float) | SHORT | TIES, min_size=1, max_size=30),
    st.sampled_from(
        ["F8.2", "F10.4", "F12.3", "F6.3", "F5.2", "F4.0", "F20.15", "E11.3", "S14.3", "S11.3", "S9.2"]
    ),
)
def test_columns_are_edited_as_their_values_are(values, edit):
    column = np.array(values * MANY)
    if edit.startswith("S"):
        column = column * ARC_SECOND
    alone = [edited(edit, [value])[0] for value in column[: len(values)].tolist()]
    assert edited(edit, column) == alone * MANY


@given(
    st.lists(st.integers(-(10**7), 10**7), min_size=1, max_size=30),
    st.lists(st.text(st.characters(exclude_characters="\0"), max_size=12), min_size=1, max_size=30),
    st.integers(1, 9),
)
def test_columns_of_whole_numbers_and_of_texts_are_edited_as_their_values_are(numbers, texts, width):
    for values, edit in ((numbers, f"I{width}"), (texts, f"A{width}")):
        alone = [edited(edit, [value])[0] for value in values] * MANY
        assert edited(edit, np.array(values * MANY)) == edited(edit, values * MANY) == alone


def test_a_table_of_many_rows_is_that_of_its_rows(monkeypatch):
    """Columns that are wider than their fields, and more rows than are edited at a time."""
    monkeypatch.setattr(table, "_ROWS", 30)
    count = np.arange(100)
    columns = (
        unrecorded("A long heading", "A4", lambda rows: [f"p{row}" for row in rows.tolist()]),
        unrecorded("Count", "I3", lambda rows: rows),
        unrecorded("Number\nm", "F12.4", lambda rows: rows / 7.0 - 3.0),
        unrecorded("Some", "A4", lambda rows: np.where(rows % 3 == 0, "B", "")),
    )
    whole = table.Table(columns)
    assert whole.lines(count) == [line for row in count for line in whole.lines(count[row : row + 1])]


@pytest.mark.parametrize("edit", ["", "Q8", "F8", "S14", "F2.5"])
def test_what_is_no_descriptor(edit):
    with pytest.raises(FieldError):
        edited(edit, [1.0])


FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    run_deck(FIXTURES / "st_thomas" / "st_thomas.crd", folder, csv=True)
    return folder


def rows_of(folder, name):
    with (folder / "st_thomas_tables" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(
    ("name", "table", "columns"),
    [
        ("adjusted_ground_points", "points", {"Latitude (rad)": ("position", 0), "Sigma Up (m)": ("sigma", 2)}),
        ("adjusted_exposure_stations_attitudes", "stations", {"Heading (rad)": ("attitude", 2)}),
        ("input_plate_measurement_plt", "plates", {"x (mm)": ("xy", 0), "y (mm)": ("xy", 1)}),
        ("residuals_of_plate_measurements_adjusted_minus_measured", "plates", {"Resid. x (mm)": ("residual", 0)}),
    ],
)
def test_numbers_are_those_of_the_record(run, name, table, columns):
    recorded = read_rows(run / "st_thomas.json")[table]
    rows = rows_of(run, name)
    assert len(rows) == len(recorded)
    for head, (field, component) in columns.items():
        written = sorted(float(row[head]) for row in rows)
        expected = sorted(row[field][component] for row in recorded)
        np.testing.assert_allclose(written, expected, rtol=1e-11, atol=0.0)  # records have twelve digits


def test_all_that_is_printed_below_a_rule_is_there(run):
    """The answer has its tables in full on later pages."""
    text = (run / "st_thomas.lst").read_text().split("Index Of Pages")[1]
    titles = set(re.findall(r"\n\n(\S[^\n]*)\n\n(?:[^\n]+\n){1,3}-+(?:  -+)+\n", text))
    titles = {re.sub(r": \d+$", "", title) for title in titles if not title.endswith("(continued)")}
    names = {"_".join(re.findall(r"[a-z0-9.]+", title.lower())) for title in titles}
    assert len(names) > 20 and names <= {path.stem for path in (run / "st_thomas_tables").iterdir()}


def test_ids_stand_first_and_heads_are_different(run):
    heads = (run / "st_thomas_tables" / "iterations.csv").read_text().splitlines()[0]
    assert heads.startswith("Pass,Iteration,Largest rotation (rad),Photo,Largest translation (m),Photo 2,")
    for path in (run / "st_thomas_tables").iterdir():
        heads = path.read_text().splitlines()[0]
        assert len(set(next(csv.reader([heads])))) == len(next(csv.reader([heads]))), path
    heads = ["Group", "Point 1", "Point 2", "Point 3", "Sigma (m)"]
    assert list(rows_of(run, "input_equal_elevation_group_eql")[0]) == heads


@pytest.mark.parametrize("system", CoordinateSystem)
@pytest.mark.parametrize("refraction", [Refraction.NONE, Refraction.RIGOROUS])
def test_every_system_has_its_tables(system, refraction):
    statistics = Statistics(sample_solution(system, refraction))
    files = {path.name: data.decode() for path, data in csv_files(sections_of(statistics), Path("job.lst")).items()}
    card, head = "rectangular_ctx", "x (m)"
    if system is CoordinateSystem.GEOGRAPHIC:
        card, head = "geographic_ctg", "Latitude (rad)"
    rows = list(csv.reader(files[f"input_control_point_{card}.csv"].splitlines()))
    x = rows[0].index(head)
    recorded = [position[0] for position in record_of(statistics, {"control"})["control"]["given_position"]]
    np.testing.assert_array_equal([float(row[x] or "nan") for row in rows[1:]], np.array(recorded, dtype=float))


@pytest.mark.parametrize("name", ["=1+1", "+1+1", "-2+3", "@SUM", "\t=1", "-A", "+1e"])
def test_ids_that_a_spreadsheet_would_compute_stay_texts(name):
    """None of its four signs stands first, and who strips blanks reads the same id."""
    rows = [["Point", "X (m)"], [name, -1.25], ["-5", 3.0], ["P-1", np.inf]]
    (data,) = csv_files([Section(title="Points", values=lambda: rows)], Path("job.lst")).values()
    text = data.decode()
    _, first, second, third = csv.reader(text.splitlines())
    assert first[0][0] == " " and first[0].strip() == name.strip() and first[1] == "-1.25"
    assert second == ["-5", "3.0"] and third == ["P-1", ""]  # a number is one in any sheet
