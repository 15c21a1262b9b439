"""Tables and pages: alignment, page breaks, carriage control."""

from __future__ import annotations

import pytest

from asa_printer import played
from musatpy.reports.pages import PAGE_LINES, Section, paginate, print_pages
from musatpy.reports.table import Column, Table


def numbered(count, prefix="row"):
    return [f"{prefix} {number}" for number in range(count)]


def header(page):
    return f"PAGE {page}"


def test_a_table_aligns_headings_with_its_values():
    table = Table(
        (
            Column("Name", "A6", lambda rows: [row[0] for row in rows]),
            Column("Length\nm", "F8.2", lambda rows: [row[1] for row in rows]),
            Column("A long heading", "I4", lambda rows: [row[2] for row in rows]),
            Column("Flag", "A1", lambda rows: [row[3] for row in rows]),
        )
    )
    rows = [("AB", 1.5, 12, "X"), ("CDEFGHIJ", -0.25, 3, "")]
    assert list(table.head()) == [
        "          Length",
        "Name           m  A long heading  Flag",
        "------  --------  --------------  ----",
    ]
    assert table.lines(rows) == [
        "AB          1.50              12  X",
        "CDEFGH      -.25               3",
    ]


def test_sections_share_a_page_while_they_fit():
    pages = paginate([Section(title="A", lines=numbered(3)), Section(title="B", lines=numbered(2))])
    assert pages == [["A", "", "row 0", "row 1", "row 2", "", "", "B", "", "row 0", "row 1"]]


def test_a_long_section_repeats_its_title_and_headings():
    head = ["Name", "----"]
    pages = paginate([Section(title="A\nsecond line", head=head, lines=numbered(150))])
    assert [len(page) for page in pages] == [58, 58, 150 - 2 * 53 + 5]
    assert pages[0][:6] == ["A", "second line", "", "Name", "----", "row 0"]
    assert pages[1][:6] == ["A (continued)", "second line", "", "Name", "----", "row 53"]
    assert [line for page in pages for line in page if line.startswith("row")] == numbered(150)


@pytest.mark.parametrize("filled", range(40, 60))
def test_a_heading_is_never_left_alone_at_the_foot_of_a_page(filled):
    first, second = Section(title="A", lines=numbered(filled - 2)), Section(title="B", lines=numbered(30))
    pages = paginate([first, second])
    for page in pages:
        assert len(page) <= PAGE_LINES - 2
        if "B" in page:
            assert len(page) - page.index("B") >= 2 + 4


def test_a_section_that_stays_together_moves_to_the_next_page():
    sections = [Section(title="A", lines=numbered(40)), Section(title="B", lines=numbered(20), together=True)]
    assert [page[0] for page in paginate(sections)] == ["A", "B"]


def test_a_section_that_starts_a_page_does_so_once():
    sections = [
        Section(title="A", lines=numbered(1), new_page=True),
        Section(title="B", lines=numbered(1), new_page=True),
    ]
    assert [page[0] for page in paginate(sections)] == ["A", "B"]


def test_pages_are_parted_by_form_feeds():
    text = print_pages([["A", "", "x"], ["B"]], header, carriage_control=False)
    assert text == "PAGE 1\n\nA\n\nx\n\fPAGE 2\n\nB\n"


def test_carriage_control_spaces_as_an_impact_printer_did():
    text = print_pages([["A", "", "x", "", "", "y", "", "", "", "z"], ["B"]], header, carriage_control=True)
    assert text.splitlines() == ["1PAGE 1", "0A", "0x", "-y", "-", " z", "1PAGE 2", "0B"]


def test_carriage_control_prints_the_same_pages():
    body = ["A", "", "", "", "x", "", "", "", "", "", "y"]
    text = print_pages([body, body[:5]], header, carriage_control=True)
    assert played(text) == [["PAGE 1", "", *body], ["PAGE 2", "", *body[:5]]]
