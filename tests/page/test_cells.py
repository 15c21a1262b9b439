"""Cells, tables of reports and the index of pages."""

import math
import shutil
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
import shapely

from campaign.batches import ST_THOMAS, here
from musatpy.campaign.batch_jobs import BatchJob, JobOutcome, JobState
from musatpy.campaign.batch_reports import index_page
from musatpy.page import compilation_page, run_page
from musatpy.page.page_tables import PageReport, cell_text
from musatpy.page.run_page import hull_area
from musatpy.reports import (
    compilation,
    compilation_bottom,
    compilation_points,
    echo,
    listing,
    reduction,
    residuals,
    stated,
)
from musatpy.reports.table import Report
from musatpy.units import DEGREE
from page.pages import ROOT, Reader


def test_the_area_of_points_is_that_of_their_hull():
    places = np.random.default_rng(4).normal(size=(200, 2)) * [300.0, 70.0] + [5e5, 2e6]
    places = np.concatenate([places, places[:50], [[5e5, 2e6]] * 3])
    assert hull_area(places) == pytest.approx(shapely.MultiPoint(places).convex_hull.area, rel=1e-9)
    assert hull_area(np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])) == pytest.approx(0.0, abs=1e-12)
    assert hull_area(np.array([[1.0, 1.0]])) == 0.0


@pytest.mark.parametrize(
    ("edit", "value", "text"),
    [
        ("F9.3", -0.0004, "0.000"),
        ("F9.3", 123456789.1234, "123456789.123"),  # no asterisks: a page has room
        ("F9.3", math.nan, ""),
        ("F9.3", 4.2e15, "4.200e+15"),
        ("E17.9", 1.5e-9, "1.500000000e-09"),
        ("A8", ["21", "102"], "21 102"),
        ("S16.5", -0.5 * DEGREE, "-0° 30′ 00.00000″"),
        ("S14.3", DEGREE - 1e-12, "1° 00′ 00.000″"),
    ],
)
def test_values_of_cells(edit, value, text):
    assert cell_text(edit, value) == text


LEFT_OUT = {
    # input: what was measured and given stands in the deck; cameras and tides are shown
    *(report.title for report in echo.STATED if report is not echo.SEA),
    # millions of rows; what of them counts is among the worst observations, by photo, and in pictures
    residuals.RESIDUALS.title,
    # nested twice: parameters of steps of raw plates
    reduction.PARAMETERS.title,
    # columns of the stations in the output system
    stated.MAP.title,
    # the five worst of those that are shown
    "Worst Observations",
}


def shown(module):
    values = [value for value in vars(module).values() if isinstance(value, tuple)]
    return {part.title for value in values for part in value if isinstance(part, PageReport)}


def test_tables_of_runs():
    titles = {
        report.title.removesuffix(": ")
        for page in listing.REPORTS
        for report in getattr(page, "STATED", ())
        if isinstance(report, Report) and report.layout in ("rows", "texts")
    }
    assert len(titles) > 35
    assert titles - LEFT_OUT <= shown(run_page)


def test_tables_of_compilations():
    pages = (compilation, compilation_bottom, compilation_points)
    titles = {report.title for page in pages for report in page.STATED if isinstance(report, Report)}
    assert len(titles) > 10
    others = (*compilation_points.ANSWER_TABLES, *compilation.SET_UP_TABLES, *compilation_bottom.COMPARED)
    assert titles - {report.title for report in others} <= shown(compilation_page)


HOSTILE = "<img src=x onerror=alert(1)>.crd"


def row(name, state, sigma0=1.0, **more):
    given = {"photos": 3, "points": 22, "check_points": 1, "check_rms": (0.1, 0.2, None)}
    return BatchJob(deck=Path(name)), JobOutcome(state=JobState(state), sigma0=sigma0, **(given | more))


def index_of(title, rows):
    return index_page(title, Path(), *zip(*rows, strict=True)).decode()


def test_what_needs_a_look_comes_first():
    jobs = [
        row("a", "accepted"), row("b", "accepted", 1.4), row("c", "accepted", 0.5), row("d", "doubtful"),
        row("e", "rejected", float("inf")),
        row("f", "unusable", None, photos=None, points=None, check_rms=None, check_points=None),
    ]  # fmt: skip
    reader = Reader(index_of("Campaign", jobs))
    rows = reader.tables["Jobs"][1:]
    assert [cells[0] for cells in rows] == ["f", "e", "d", "c", "b", "a"]
    assert rows[-1][2:] == ["3", "22", "1.0000", "1", "0.100, 0.200, -"]
    assert rows[0][2:] == [""] * 5
    assert "6 jobs: 1 unusable, 1 rejected, 1 doubtful, 3 accepted" in reader.text


def test_the_same_jobs_in_any_order_give_the_same_bytes():
    jobs = [row("a", "accepted"), row("b", "doubtful")]
    assert index_of("x", jobs) == index_of("x", jobs[::-1])


@pytest.mark.slow
def test_links_lead_to_what_jobs_left(tmp_path):
    decks = tmp_path / "decks"
    decks.mkdir()
    shutil.copy(ST_THOMAS, decks / HOSTILE)
    shutil.copy(ROOT / "fixtures" / "bad_decks" / "two_parts.crd", decks)
    ran = here("batch", "decks", "-o", "out", "--html", "-j", "2", cwd=tmp_path)
    assert ran.exit_code == 1 and ran.stdout.rstrip().endswith("index out/musat-batch.html")
    html = (tmp_path / "out" / "musat-batch.html").read_text()
    reader = Reader(html)
    assert not [tag for tag, _ in reader.tags if tag == "img"]
    assert HOSTILE in reader.text
    links = [link for link in reader.links if not link.startswith("#")]
    assert len(links) == 3
    assert all((tmp_path / "out" / unquote(link)).exists() for link in links)
    page = next(tmp_path / "out" / unquote(link) for link in links if link.endswith(".html"))
    written = page.stat().st_mtime_ns
    ran = here("batch", "decks", "-o", "out", "--html", cwd=tmp_path)
    assert "1 kept from an earlier run" in ran.stdout and page.stat().st_mtime_ns == written
    assert (tmp_path / "out" / "musat-batch.html").read_text() == html
