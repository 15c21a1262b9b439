"""Two listings: what differs, what does not, and what each kind of rule lets pass."""

from decimal import Decimal
from pathlib import Path

import pytest

from asa_printer import played
from listings.runs import ST_THOMAS, run_of
from musatpy import listing
from musatpy.listings import compare_files, compare_texts, parse_rules

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "fixtures" / "st_thomas" / "st_thomas.lst"
TEXT = GOLDEN.read_text(encoding="utf-8")
PAGE = TEXT[: TEXT.index("-5.134        .168")].count("\f") + 1  # of the point whose elevation is changed
STATION = "21          -0 38 11.342     1 15 59.610    -0 30 41.059      34.84      29.77      13.37"


def compared(b, rules="", a=TEXT):
    return compare_texts(a, b, parse_rules(rules))


def changed(old, new, text=TEXT):
    assert text.count(old) == 1
    return text.replace(old, new)


def shown(difference):
    return [(one.kind, one.row, one.column, one.a, one.b) for one in difference.findings]


def test_one_digit_is_found_with_its_place():
    found = compared(changed("-5.134        .168", "-5.136        .168"))
    (one,) = found.findings
    assert (one.kind, one.section, one.row, one.column) == ("number", "Adjusted Ground Points", "203", "Elevation")
    assert (one.a, one.b, one.difference, one.unit) == ("-5.134", "-5.136", Decimal("-0.002"), "m")
    assert (one.last_digits, one.rule) == (-2, "exact")
    number = next(n for n, line in enumerate(TEXT.split("\n"), 1) if "-5.134        .168" in line)
    assert (one.place_a.page, one.place_a.line, one.place_b.line) == (PAGE, number, number)


def test_an_angle_is_one_number_with_the_sign_of_its_degrees():
    found = compared(changed(STATION, STATION.replace("-0 38 11.342", " 0 38 11.342")))
    (one,) = found.findings
    assert (one.kind, one.row, one.column, one.unit) == ("angle", "21", "X-Tilt", "arc sec")
    assert one.difference == Decimal("4582.684")


def test_an_angle_that_carries_into_its_minutes_differs_by_little():
    other = STATION.replace("15 59.610", "16   .002")
    found = compared(changed(STATION, other), "[[rule]]\nsection = 'Attitudes'\narcsec = 0.392\n")
    assert found.same and found.rules[0].passed == 1
    assert not compared(changed(STATION, other), "[[rule]]\narcsec = 0.391\n").same


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("x -0.00 1", "x 0.00 1"),
        ("x 1.5D+03", "x 1500."),
        ("x .50", "x 0.5"),
        ("x   1.234-5.678", "x 1.234  -5.678"),
        ("x ****", "x ****"),
        ("x 12 ", "\n\nx    12\n\n"),
        ("x 1\n-----\n", "x 1\n==========\n"),
        ("1TITLE 1\n+TITLE\n 2.5 3", "TITLE 1\n2.5 3"),
    ],
)
def test_the_same_number_in_another_dress(a, b):
    assert compare_texts(f"{a}\n", f"{b}\n").same
    assert compare_texts(f"{a}\n", f"{b}\n".replace("\n", "\r\n") + "\x1a").same  # line ends of other systems


@pytest.mark.parametrize(
    ("a", "b", "kind"),
    [
        ("x ****", "x 9.99", "overflow"),
        ("x ****", "x *****", "overflow"),
        ("photo RC8 1", "photo RC9 1", "text"),
        ("x 1 2", "x 1", "text"),
        ("x 123456789012345678", "x 123456789012345679", "number"),
    ],
)
def test_what_differs_is_found(a, b, kind):
    found = compare_texts(f"{a}\n", f"{b}\n")
    assert [one.kind for one in found.findings] in ([kind], ["only in A", "only in B"][: 2 * (kind == "text")])


def test_one_row_more_leaves_the_others_alone():
    line = "21        202            10.5410000        1.8520000\n"
    found = compared(changed(line, line + line.replace("202", "777")))
    assert [(one.kind, one.row) for one in found.findings] == [("only in B", "21 777")]
    found = compared(changed(line, ""))
    assert [(one.kind, one.row) for one in found.findings] == [("only in A", "21 202")]


def test_a_moved_row_is_said_to_stand_elsewhere():
    line = "203            .208       .136      38.7       .492\n"
    last = "208            .106       .096      79.8       .151\n"
    moved = changed(last, last + line, changed(line, ""))
    assert [(one.kind, one.row) for one in compared(moved).findings] == [("order", "203")]
    assert compared(moved, "[[rule]]\nsection = 'Ellipses'\norder = 'any'\n").same


def test_rows_without_names_find_each_other_between_rows_that_are_the_same():
    a = ["1.5 2.5", "3.5 4.5", "5.5 6.5", "7.5 8.5", "9.5 1.5"]
    b = ["1.5 2.5", "3.6 4.5", "5.5 6.5", "0.1 0.2", "7.5 8.5", "9.5 1.6"]
    found = compare_texts("\n".join(a), "\n".join(b))
    assert [(one.kind, one.a, one.place_b.line) for one in found.findings] == [
        ("number", "3.5", 2), ("only in B", None, 4), ("number", "1.5", 6)
    ]  # fmt: skip
    found = compare_texts("\n".join(a), "\n".join(["0.1 0.2", "3.6 4.5", *b[2:]]))
    assert [one.kind for one in found.findings] == ["number", "number", "number", "only in B", "number"]


@pytest.mark.slow
def test_rows_of_which_every_second_one_differs_are_aligned_in_no_time():
    """As `difflib` does it, in the square of the rows: minutes."""
    a, b = ([text for n in range(20_000) for text in (f"point {n}", f"{n + step:.1f}")] for step in (0.1, 0.2))
    found = compare_texts("\n".join(a), "\n".join(b))
    assert {one.kind for one in found.findings} == {"number"} and len(found.findings) == 20_000


def test_pages_may_break_elsewhere():
    solution, text, _ = run_of(ST_THOMAS)
    with_control = listing(solution, carriage_control=True)
    assert played(with_control)  # it is one that a printer obeys
    assert compare_texts(text, with_control).same and compare_texts(with_control, text).same


def test_headings_on_continued_pages_do_not_count(monkeypatch):
    from musatpy.reports import pages

    solution, text, _ = run_of(ST_THOMAS)
    monkeypatch.setattr(pages, "BODY_LINES", 33)
    short = listing(solution)
    assert short.count("\f") > text.count("\f") + 5 and short.count("(continued)") >= 5
    assert compare_texts(text, short).same
    monkeypatch.setattr(pages, "BODY_LINES", 10**6)
    assert compare_texts(short, listing(solution)).same


def test_references_to_pages_and_an_index_do_not_count():
    rows = "Sigma0 ..... 1.25 (page 9)\nPhotos ..... 12 (page 10)\n- a reason of two lines,\n  its end (page 3)\n"
    index = "\n\nIndex Of Pages\n\n     3  Options\n    12  Points\n"
    text = f"Quality\n\n{rows}{index}\n\nPoints\n\nNumber ..... 7\n"
    other = text
    for page, moved in (("(page 9)", "(page 11)"), ("12  Points", "14  Points"), ("(page 3)", "(page 4)")):
        other = changed(page, moved, other)
    assert compare_texts(text, other).same
    (one,) = compare_texts(text, other.replace("1.25", "1.26")).findings
    assert (one.section, one.a, one.b) == ("Quality", "1.25", "1.26")
    assert not compare_texts("Quality\n\npage 9 of it 1.5\n", "Quality\n\npage 8 of it 1.5\n").same


def test_headings_that_a_page_repeats_without_saying_so_do_not_count():
    head = "Photo          x\n-----  ---------\n"
    rows = [f"{n:<5}  {n * 1.5:9.3f}\n" for n in range(1, 41)]
    whole = f"RESIDUALS\n\n{head}{''.join(rows)}"
    broken = f"JOB  PAGE 1\n\nRESIDUALS\n\n{head}{''.join(rows[:17])}\fJOB  PAGE 2\n\n{head}{''.join(rows[17:])}"
    again = f"RESIDUALS\n\n{head}{''.join(rows[:9])}\fRESIDUALS\n\n{head}{''.join(rows[9:])}"
    found = compare_texts(whole, broken, parse_rules("[[rule]]\nsection = 'Page headers'\nonly = 'either'\n"))
    assert found.same, found.findings
    assert compare_texts(whole, again).same


def test_carriage_control_can_be_declared():
    text, plain = "1X 1\n 2.5 3\n", "X 1\n2.5 3\n"
    assert compare_texts(text, plain, parse_rules("[layout]\ncarriage_control = true\n")).same is False
    assert compare_texts(text, " X 1\n 2.5 3\n", parse_rules("[layout]\ncarriage_control = true\n")).same
    assert not compare_texts("1 1.5\n0 2.5\n", "1.5\n2.5\n").same  # numbers, not control


RULES = {
    "absolute = 0.002": True,
    "absolute = 0.001": False,
    "relative = 0.0004": True,
    "relative = 0.0003": False,
    "last_digits = 2": True,
    "last_digits = 1": False,
    "skip = true": True,
    "exact = true": False,
    "arcsec = 5": False,
    "sigmas = 5": False,
    "section = 'Adjusted Ground'\nabsolute = 1": True,
    "section = 'Stations'\nabsolute = 1": False,
    f"page = {PAGE}\nabsolute = 1": True,
    f"page = [1, {PAGE - 1}]\nabsolute = 1": False,
    "row = '^203 .*triangulated'\nabsolute = 1": True,
    "row = '^206'\nabsolute = 1": False,
    "column = 'Elev'\nabsolute = 1": True,
    "column = 'Latitude'\nabsolute = 1": False,
    "column = 7\nabsolute = 1": True,
    "column = 8\nabsolute = 1": False,
    "at = [75, 84]\nabsolute = 1": True,
    "at = [1, 60]\nabsolute = 1": False,
    "id = '203'\nabsolute = 1": True,
    "id = '20'\nabsolute = 1": False,
    "point = ['101', 203]\nabsolute = 1": True,
    "point = '20'\nabsolute = 1": False,
    "photo = '203'\nabsolute = 1": False,
}


@pytest.mark.parametrize("rule", RULES)
def test_every_kind_of_rule(rule):
    found = compared(changed("-5.134        .168", "-5.136        .168"), f"[[rule]]\n{rule}\n")
    assert found.same is RULES[rule], shown(found)


def test_a_difference_of_exactly_the_limit_passes():
    a, b = ("\n".join(f"x{n} {(n + step) / 1000:.3f}" for n in range(1, 400)) for step in (0, 1))
    assert compare_texts(a, b, parse_rules("[[rule]]\nabsolute = 0.001\n")).same


def test_the_last_rule_that_matches_wins():
    other = changed("-5.134        .168", "-5.136        .168")
    loose = "[[rule]]\nname = 'loose'\nabsolute = 1\n"
    strict = "[[rule]]\nname = 'strict'\npoint = '203'\nrelative = 0\n"
    assert [one.rule for one in compared(other, loose + strict).findings] == ["strict"]
    won = compared(other, strict + loose)
    assert won.same
    uses = [(rule.name, rule.matched, rule.applied) for rule in won.rules]
    assert uses == [("strict", True, False), ("loose", True, True)]


def test_a_rule_that_never_matched_is_reported():
    text = "[[rule]]\nname = 'typo'\nsection = 'Adjusted Gruond'\nskip = true\n"
    text += "[[rule]]\ncolumn = 'Sigma'\nskip = true\n"
    text += "[[rule]]\nname = 'no such point'\npoint = '999'\nabsolute = 1\n"
    assert compared(TEXT, text).unused_rules == ("typo", "no such point")


@pytest.mark.parametrize(("column", "matched"), [(1, False), (2, True), (3, True), (4, False)])
def test_a_rule_that_counts_fields_matches_rows_that_do_not_differ(column, matched):
    rules = parse_rules(f"[[rule]]\ncolumn = {column}\nabsolute = 1\n")
    (rule,) = compare_texts("x 1.5 2.5\n", "x 1.5 2.5\n", rules).rules
    assert (rule.matched, rule.applied) == (matched, matched)


def test_photos_are_those_of_their_columns():
    line = next(line for line in TEXT.split("\n") if line.startswith("22        ROCK ") and ".56" in line)
    other = changed(line, line.replace(".56", ".57"))
    assert compared(other, "[[rule]]\nphoto = '22'\nlast_digits = 1\n").same
    assert compared(other, "[[rule]]\npoint = 'ROCK'\nlast_digits = 1\n").same
    assert not compared(other, "[[rule]]\npoint = '22'\nlast_digits = 1\n").same
    # frames across: the heading of a column is the photo
    line = next(line for line in TEXT.split("\n") if line.startswith("RMS of Trig. Points - y"))
    other = changed(line, line[:-1] + "9")
    assert compared(other, "[[rule]]\nphoto = '23'\nlast_digits = 9\n").same
    assert not compared(other, "[[rule]]\nphoto = '22'\nlast_digits = 9\n").same


def test_the_rows_of_a_point_belong_to_it():
    line = "203            Y"
    start = TEXT.index(line)
    below = TEXT.index("Z", start)
    place = TEXT.index(".", below)
    other = TEXT[: place + 1] + ("1" if TEXT[place + 1] != "1" else "2") + TEXT[place + 2 :]
    found = compared(other)
    assert [one.row for one in found.findings] == ["203 Z"]
    assert compared(other, "[[rule]]\npoint = '203'\nabsolute = 1\n").same


@pytest.mark.parametrize(("only", "allowed"), [("B", True), ("either", True), ("A", False)])
def test_rows_in_one_only_can_be_allowed(only, allowed):
    line = "203            .208       .136      38.7       .492\n"
    other = changed(line, line + line.replace("203", "777"))
    for order in ("", "order = 'any'\n"):
        rule = f"[[rule]]\nsection = 'Ground Points, The'\nonly = '{only}'\n{order}"
        assert compared(other, rule).same is allowed


def test_a_section_in_one_only_is_one_finding():
    title = "Statistics: Error Ellipses Of Stations"
    other = TEXT[: TEXT.index(f"\n{title}")] + TEXT[TEXT.index("\nStatistics: Error Ellipses Of Ground") :]
    assert [(one.kind, one.section) for one in compared(other).findings] == [("section", title)]
    assert compared(other, "[[rule]]\nsection = 'Ellipses Of St'\nonly = 'A'\n").same
    for row in ("row = '.'", "id = '21'", "photo = '21'", "point = '21'", "column = 1"):  # rules about rows
        only = "" if "column" in row else "only = 'either'\n"
        assert not compared(other, f"[[rule]]\n{row}\n{only}skip = true\n").same


def test_a_column_in_one_only_is_one_finding():
    a = "T\n\nPoint          x\n-----  ---------\n1          1.500\n2          2.500\n"
    b = "T\n\nPoint          x      y\n-----  ---------  -----\n1          1.500    7.0\n2          2.500    8.0\n"
    found = compare_texts(a, b)
    assert [(one.kind, one.column, one.a, one.b) for one in found.findings] == [("column", "y", None, "only in B")]
    assert compare_texts(a, b, parse_rules("[[rule]]\ncolumn = 'y'\nskip = true\n")).same


def test_sections_and_headers_can_be_declared():
    a = "@ ONE\n1 1.5\n@ TWO\n1 2.5\n"
    b = "@ ONE\n1 1.5\n@ TWO\n1 2.6\n"
    rules = parse_rules("[layout]\nsection = '^@'\n[[rule]]\nsection = 'ONE'\nskip = true\n")
    assert [one.section for one in compare_texts(a, b, rules).findings] == ["@ TWO"]
    rules = parse_rules("[layout]\nheader = '^RUN OF'\n")
    assert compare_texts("RUN OF 1 MAY\n1 2.5\n", "RUN OF 2 JUNE\n1 2.5\n", rules).same


def test_the_largest_differences_are_summed_up():
    other = changed("-5.134        .168", "-5.136        .168")
    other = changed("-6.360        .115", "-6.350        .116", other)
    found = compared(other, "[[rule]]\nabsolute = 0.005\n")
    (section,) = [one for one in found.sections if one.different or one.passed]
    assert (section.different, section.passed) == (1, 2)
    assert [(one.row, one.difference, one.unit) for one in section.largest] == [("206", Decimal("0.010"), "m")]


def test_latin_text_is_read(tmp_path):
    path = tmp_path / "old.lst"
    path.write_bytes("Höhe 1.5\n".encode("latin-1"))
    (tmp_path / "new.lst").write_text("Höhe 1.5\n", encoding="utf-8")
    assert compare_files(path, tmp_path / "new.lst").same


def test_the_sign_of_zero_degrees_is_no_difference_of_nothing():
    (one,) = compare_texts("angle -0 30 45.2\n", "angle 0 30 45.2\n").findings
    assert (one.kind, one.a, one.b, one.difference) == ("text", "-0", "0", None)


def test_asterisks_in_both_are_said_to_tell_nothing():
    table = "T\n\nPoint          x      y\n-----  ---------  -----\n"
    table += "1      *********    7.0\n2          2.500  *****\n"
    found = compare_texts(table, table.replace("7.0", "7.1"))
    assert found.not_compared == ("T: 2 fields of asterisks in both, whose numbers are not known",)
    assert len(found.findings) == 1
    assert compare_texts("sum .... ******\n", "sum .... ******\n").not_compared
    assert not compare_texts("*** DONE ***\nx 1 *\n", "*** DONE ***\nx 1 *\n").not_compared
    assert not compare_texts(TEXT, TEXT).not_compared  # frames are marked by asterisks there


def test_what_stands_before_the_first_title_has_a_name():
    (one,) = compare_texts("x 1\n\n\nTITLE\n\ny 2\n", "TITLE\n\ny 2\n").findings
    assert (one.kind, one.section, one.a) == ("section", "(before the first title)", "1 row")


# --- photos across the page, three to a table ---


PHOTOS = [f"{n}" for n in range(21, 29)]


def across_page(photos, values=None, across=3, title="Plate Residuals"):
    """Return tables with the values of each photo, .021 and .121 of photo 21."""
    lines = []
    for first in range(0, len(photos), across):
        here = photos[first : first + across]
        rule = "=" * (12 + 8 * across)
        lines += ["", "", title, "(MM)", "", rule]
        lines += ["Frame       " + "".join(f"{photo:>8}" for photo in here), "-" * len(rule)]
        for n, label in enumerate(("RMS x", "RMS y")):
            texts = [(values or {}).get((label, photo), f".{n}{photo}") for photo in here]
            lines.append(f"{label:<12}" + "".join(f"{text:>8}" for text in texts))
        lines.append(rule)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("gone", PHOTOS[6:])
def test_a_photo_less_in_the_last_table_is_one_finding(gone):
    rest = [photo for photo in PHOTOS if photo != gone]
    assert shown(compare_texts(across_page(PHOTOS), across_page(rest))) == [
        ("column", "(headings)", gone, "only in A", None)
    ]
    assert shown(compare_texts(across_page(rest), across_page(PHOTOS))) == [
        ("column", "(headings)", gone, None, "only in B")
    ]


def test_photos_that_stand_in_another_table_are_found():
    found = compare_texts(across_page(PHOTOS), across_page(PHOTOS[1:]))
    assert {one.kind for one in found.findings} == {"column"}
    assert {one.column for one in found.findings} == {"21", "24", "27"}


def test_a_mark_below_another_photo_is_found():
    a, b = (f"{across_page(PHOTOS[:2])}Largest     {stars}\n" for stars in ("    ****", "            ****"))
    assert [(one.row, one.column) for one in compare_texts(a, b).findings] == [("Largest", "21"), ("Largest", "22")]
