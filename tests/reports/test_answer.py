"""Page 1 and the index: what they say stands on the pages that they name, and they keep to their room."""

import dataclasses
import functools
import itertools
import json
import re
from string import ascii_lowercase

import numpy as np
import pytest

from altered import added, altered, with_options
from blocks import FIXTURES, simulation
from musatpy import adjust, read_deck
from musatpy.listings import compare_texts
from musatpy.listings.audit import audit
from musatpy.listings.audit import listing_of as read_text
from musatpy.model import Action, CauseKind, Concern, Editing, Finding, Grade, Reason, SystemSpec, Verdict
from musatpy.reports import answer
from musatpy.reports import listing as listing_module
from musatpy.reports.headline import content_of, headline
from musatpy.reports.listing import listing, uncut
from musatpy.reports.pages import BODY_LINES, PAGE_WIDTH
from musatpy.reports.record import dumps, record_of
from musatpy.reports.statistical_tests import HIDDEN
from musatpy.statistics import Statistics
from reports.test_listing import listing_of, pages_of, section
from sample_solutions import sample_solution

DECK = FIXTURES / "st_thomas" / "st_thomas.crd"
CONTROL = "Control Residuals: Adjusted Minus Given, With The Sigmas Given"
CHECKS = "Check Points: Adjusted Minus Given, With The Sigmas Of The Adjusted Position"
VERTICAL = 4  # row of the vertical control point of the deck


FOUND = Finding(kind=CauseKind.IMAGE, photo="837", test=9.0, size=(1.0,), action=Action.NONE)


def lifted(block, metres):
    """The deck with the height of a control point wrong."""
    return altered(block, control={"position": added((VERTICAL, 2), metres)})


@functools.cache
def run(grade):
    """The statistics of a run of each grade."""
    block = read_deck(DECK)
    made = {
        Grade.ACCEPTED: lambda: block,
        Grade.DOUBTFUL: lambda: lifted(block, 1.5),
        Grade.REJECTED: lambda: lifted(block, 50.0),
        Grade.FAILED: lambda: with_options(block, max_iterations=1, max_passes=1),
    }
    statistics = Statistics(adjust(made[grade]()))
    assert statistics.verdict.grade is grade
    return statistics


@pytest.mark.slow
@pytest.mark.parametrize("grade", Grade)
def test_every_page_of_a_run_that_is_not_accepted_says_so(grade):
    headers = [page[0] for page in pages_of(listing_of(run(grade)))]
    mark = {"ACCEPTED": "", "FAILED": "NOT CONVERGED"}.get(grade, str(grade))
    assert all(("***" in header) == bool(mark) and mark in header for header in headers)
    assert {len(header) for header in headers} == {PAGE_WIDTH}


@pytest.mark.parametrize("grade", Grade)
def test_page_1_has_the_verdict_and_every_reason_with_its_page(grade):
    statistics = run(grade)
    pages = pages_of(listing_of(statistics))
    lines = pages[0]
    assert lines[2:5] == ["Verdict", "", f"{grade}: {answer.USE[grade]}"]
    text = " ".join(" ".join(lines).split())
    for reason in statistics.verdict.reasons:
        place = text.index(reason.text) + len(reason.text)
        page = int(re.match(r" \(page (\d+)\)", text[place:])[1])
        assert any(line.startswith(reason.section) for line in pages[page - 1])


@pytest.mark.parametrize("grade", Grade)
def test_a_record_says_the_figures_of_its_run(grade):
    statistics = run(grade)
    figures = list(headline(content_of(statistics)))
    assert figures == list(headline(record_of(statistics)))
    assert {"Sigma0", "RMS of check points, East, North, Up", "Blunders"} <= {figure.label for figure in figures}


@pytest.mark.parametrize("brief", [False, True])
@pytest.mark.parametrize("grade", Grade)
def test_pages_that_are_named_show_what_is_meant(grade, brief):
    pages = pages_of(listing_of(run(grade), brief=brief))
    shown = {
        "Sigma0": "Statistics: Sigma0 And Variance Components",
        "RMS of plate residuals, x and y": "Plate Residuals Of The Job",
        "RMS of control residuals, East, North, Up": CONTROL,
        "RMS of check points, East, North, Up": CHECKS,
        "Check points, chi-square over components": "Statistics: Check Points Against Their Own Covariance",
        "Sigma of depths, median and largest": "Depths Of Bathymetric Points",
        "Points weakly checked": "Statistics: Points That Undetected Errors May Move",
    }
    for label, title in shown.items():
        (line,) = [line for line in pages[0] if line.startswith(f"{label} ..")]
        assert title in pages[int(re.search(r"\(page (\d+)\)$", line)[1]) - 1]
    rows = re.findall(r"^ *(\d+)  (\S.*)$", "\n".join(next(page for page in pages if answer.INDEX in page)), re.M)
    assert len(rows) > 20
    for page, title in rows:
        assert title in pages[int(page) - 1]
    titles = {title for _, title in rows}
    assert set(shown.values()) <= titles and ("Input: Camera (CAM)" in titles) is not brief


@pytest.mark.slow
@pytest.mark.parametrize("grade", Grade)
@pytest.mark.parametrize("brief", [False, True])
def test_audit_and_comparison_read_listings_of_every_grade(grade, brief):
    statistics = run(grade)
    text = listing_of(statistics, brief=brief)
    found = read_text(text, "x")
    assert found.repairs == () and found.unreadable == () and audit(found) == []
    assert sum(report.name.endswith("analysis") for report in found.reports) == 4
    record = dumps(record_of(statistics))
    difference = compare_texts(text, record, names=("a.lst", "a.json"))
    overflown = {one.kind for one in difference.findings} <= {"overflow"}
    assert difference.same or (grade is Grade.FAILED and overflown), difference.findings[:3]
    assert not {"Verdict", "Warnings In Short"} & set(difference.not_compared)
    assert compare_texts(text, text).same


def test_a_changed_reason_on_page_1_is_found():
    statistics = run(Grade.DOUBTFUL)
    text, record = listing_of(statistics), json.loads(dumps(record_of(statistics)))
    for change in ({"grade": "REJECTED"}, {"reasons": record["verdict"]["reasons"][1:]}, {"notes": ["another"]}):
        other = json.dumps({**record, "verdict": {**record["verdict"], **change}})
        difference = compare_texts(text, other, names=("a.lst", "a.json"))
        assert {one.section for one in difference.findings} == {"Verdict"}


def crowded(reasons, notes, blunders, warnings, stated_in=None):
    """A sample with so many of each, each longer than a line."""
    words = "photo 1 point 2 " * 12
    solution = altered(
        sample_solution(),
        warnings=tuple(f"{letter} {words}" for letter in ascii_lowercase[:warnings]),
        findings=tuple(dataclasses.replace(FOUND, point=str(number)) for number in range(blunders)),
        block={"options": {"editing": Editing.LIST}, "stated_in": stated_in},
        edited=sample_solution().block,
    )
    statistics = Statistics(solution)
    reason = Reason(grade=Grade.DOUBTFUL, concern=Concern.UNIT, text="", section="Warnings")
    told = tuple(dataclasses.replace(reason, text=f"{number} {words}") for number in range(reasons))
    statistics.__dict__["verdict"] = Verdict(reasons=told, notes=(words,) * notes)
    return statistics


LONG = "+proj=tmerc +lon_0=-81.0 +k=0.99960 +x_0=200000.000000 +ellps=clrk66 +units=us-ft +no_defs"
STATED = SystemSpec(kind="PROJ", definition=LONG, axes="GRID", sigmas="SYST")
CROWDS = [
    *itertools.product((0, 20), (0, 2), (0, 40), (0, 26)),
    (1, 0, 1, 1),
    (1, 1, 0, 26),
    (20, 2, 40, 26, STATED),
]


@pytest.mark.parametrize("crowd", CROWDS, ids=lambda crowd: str(crowd[:4]) + " stated" * (len(crowd) > 4))
def test_page_1_is_one_page_whatever_there_is_to_say(crowd):
    statistics = crowded(*crowd)
    pages = pages_of(listing_of(statistics))
    numbers = [index for index, page in enumerate(pages) if "Options" in page]
    assert numbers == [2] and pages[1][2] == answer.INDEX
    assert "Run" in pages[0] and len(pages[0]) <= BODY_LINES + 2
    for page_of in (lambda _: 1, lambda _: 99999):
        sections = answer.sections(statistics, page_of)
        assert [len(one.lines) for one in sections] == [
            len(one.lines) for one in answer.sections(statistics, lambda _: 12)
        ]
        assert max(len(line) for one in sections for line in one.lines) <= PAGE_WIDTH
    whole = answer.ALL_REASONS in "\n".join(pages[0] + pages[1])
    text = "\n".join(pages[0])
    reasons, notes = len(re.findall(r"^- \d+ photo", text, re.M)), len(re.findall(r"^Note: ", text, re.M))
    assert whole == ((reasons, notes) != crowd[:2])  # what is not on page 1 stands elsewhere
    assert whole or crowd[0] < 20


def test_what_page_1_has_no_room_for_is_counted_and_stands_elsewhere():
    pages = pages_of(listing_of(crowded(20, 0, 40, 26)))
    text = "\n".join(pages[0])
    counts = re.findall(r"^and (\d+) more \(page (\d+)\)$", text, re.M)
    assert len(counts) == 3
    shown = [int(count) for count, _ in counts]
    assert shown[0] + len(re.findall(r"^- \d+ photo", text, re.M)) == 20
    assert shown[1] + text.count("plate measurement") == 40
    assert shown[2] + len(re.findall(r"^- [a-z] photo", text, re.M)) == 26
    places = [pages[int(page) - 1] for _, page in counts]
    assert answer.ALL_REASONS in places[0] and "Blunders: Images" in places[1] and "Warnings" in places[2]
    assert len(re.findall(r"^- \d+ photo", "\n".join(places[0] + pages[pages.index(places[0]) + 1]), re.M)) == 20


def test_a_long_index_has_a_line_for_each_kind():
    titles = [f"Input: {number}" for number in range(60)] + ["Residuals"]
    titles += ["Statistics: A", "Statistics: B"]
    lines = answer.index(titles, range(3, 66), new_page=True).lines
    assert lines == ["     3  Input", "    63  Residuals", "    64  Statistics: A", "    65  Statistics: B"]
    assert len(answer.index(titles[:40], range(3, 43), new_page=True).lines) == 40
    many = answer.index([f"{number}" for number in range(99)], range(99), new_page=True)
    assert len(many.lines) == BODY_LINES - 2


def test_control_that_fails_its_test_has_a_star():
    text = listing_of(run(Grade.DOUBTFUL))
    rows = {line.split()[0]: line for line in section(text, CONTROL)[3:8]}
    ids = run(Grade.DOUBTFUL).block.points.ids[run(Grade.DOUBTFUL).block.control.point]
    assert rows[ids[VERTICAL]].endswith("*")
    tests = run(Grade.DOUBTFUL).control_tests
    assert {name for name, row in rows.items() if row.endswith("*")} == {
        name for name, test in zip(ids, tests, strict=True) if np.nanmax([0.0, *np.abs(test)]) > 3.29
    }
    assert not any(row.endswith("*") for row in section(listing_of(run(Grade.ACCEPTED)), CONTROL)[3:8])


def test_points_are_listed_by_the_errors_that_stay_hidden():
    statistics = run(Grade.ACCEPTED)
    lines = section(listing_of(statistics), HIDDEN)
    rows = [line.split() for line in lines[3 : lines.index("")]]
    hidden, ids = statistics.hidden, statistics.block.points.ids
    places = {name: row for row, name in enumerate(ids.tolist())}
    sizes = [float("inf") if row[-1] == "limit" else float(row[-1]) for row in rows]
    assert len(rows) == 20 and sizes == sorted(sizes, reverse=True) and np.isinf(sizes).any()
    for row, size in zip(rows, sizes, strict=True):
        assert hidden.sigmas[places[row[0]]] == pytest.approx(size, abs=0.05)
    assert np.isnan(hidden.sigmas[list(set(range(len(ids))) - set(hidden.worst_first.tolist()))]).all()


def test_the_worst_observations_are_those_with_the_largest_tests():
    statistics = run(Grade.DOUBTFUL)
    rows = statistics.worst_observations
    size = np.abs(statistics.normal_tests)
    assert size[rows[0]] == np.nanmax(size)
    assert (np.diff(np.round(size[rows], 2)) <= 0.0).all()  # as they are printed
    observed = statistics.observed
    np.testing.assert_allclose(
        statistics.estimated_error[rows], -observed.residual[rows] / observed.redundancy[rows]
    )
    lines = section(listing_of(statistics), "Worst Observations")
    assert [line.split()[0] for line in lines[2:]].count("control") >= 1 and len(lines) == 7


def test_a_brief_listing_keeps_the_worst_rows_and_says_how_many_there_are(monkeypatch):
    solution = sample_solution()
    whole = listing(solution, brief=True)
    assert "Only the worst" not in whole and "Residuals Of Plate Measurements" not in whole
    monkeypatch.setattr(listing_module, "MOST_PAGES", 3)
    monkeypatch.setattr(listing_module, "_STEPS", ((5, 5, 5),))
    text = listing(solution, brief=True)
    lines = section(text, "Adjusted Ground Points")
    sizes = np.linalg.norm(Statistics(solution).point_sigmas, axis=1)
    wanted = {str(name) for name in solution.block.points.ids[np.argsort(-np.nan_to_num(sizes))[:5]]}
    count = int(np.isfinite(sizes).sum())
    assert lines[-1] == f"Only the worst 5 of {count} rows are listed here."
    assert {line.split()[0] for line in lines[3:8]} == wanted
    found = read_text(text, "x")
    assert found.unreadable == () and audit(found) == []
    record = dumps(record_of(Statistics(solution)))
    assert compare_texts(text, record, names=("a.lst", "a.json")).same


@pytest.mark.parametrize("angles", ["", "OPK", "MATR"])
def test_what_may_be_cut_are_rows_each_of_them_once(angles):
    stated_in = SystemSpec(kind="GEOC", angles=angles) if angles else None
    for table in uncut(Statistics(altered(sample_solution(), block={"stated_in": stated_in}))):
        assert sorted(table.worst) == list(range(len(table.worst)))
        assert len(table.worst) <= len(table.lines) and "" not in table.lines[: len(table.worst)]


@pytest.mark.slow
def test_a_block_of_320_photos_is_brief_on_forty_pages():
    made = simulation(
        1,
        flight={"strips": 8, "photos": 40, "attitude_scatter": 1.0},
        water={},
        shoal=[{"share": 0.3, "depth": [0.5, 10.0]}],
        points={"extra": [{"number": 4000}]},
        control=[{"kind": "full", "number": 100, "sigma": 0.1, "error": 0.1}],
        stations={"position_error": 30.0, "attitude_error": 0.5},
    )
    statistics = Statistics(adjust(made.block))
    assert len(statistics.block.photos.ids) == 320 and len(statistics.block.points.ids) > 4000
    text = listing_of(statistics, brief=True)
    assert 20 < len(pages_of(text)) <= listing_module.MOST_PAGES
    assert "320 rows" not in text[text.index("\nAdjusted Exposure Stations: P") :]  # stations are all there
    found = read_text(text, "x")
    assert found.unreadable == () and audit(found) == []
    assert compare_texts(text, dumps(record_of(statistics)), names=("a.lst", "a.json")).same
