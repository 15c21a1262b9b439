"""The index page of a batch: what comes first, links that lead to files, names that are escaped."""

from __future__ import annotations

import os
import shutil
from urllib.parse import unquote

import pytest

from campaign.batches import ST_THOMAS, musat
from musatpy.page.index_page import JobRow, index_html
from page.pages import ROOT, Reader

HOSTILE = "<img src=x onerror=alert(1)>.crd"


def row(name, state, sigma0=1.0, **more):
    given = {
        "photos": 3,
        "points": 22,
        "check_points": 1,
        "check_rms": (0.1, 0.2, None),
        "message": "",
        "links": (),
    }
    return JobRow(name=name, state=state, sigma0=sigma0, **(given | more))


def test_what_needs_a_look_comes_first():
    jobs = [
        row("a", "accepted"), row("b", "accepted", 1.4), row("c", "accepted", 0.5), row("d", "doubtful"),
        row("e", "rejected", float("inf")),
        row("f", "unusable", None, photos=None, points=None, check_rms=None, check_points=None),
    ]  # fmt: skip
    reader = Reader(index_html("Campaign", jobs))
    rows = reader.tables["Jobs"][1:]
    assert [cells[0] for cells in rows] == ["f", "e", "d", "c", "b", "a"]
    assert rows[-1][2:] == ["3", "22", "1.0000", "1", "0.100, 0.200, -"]
    assert rows[0][2:] == [""] * 5
    assert "6 jobs: 1 unusable, 1 rejected, 1 doubtful, 3 accepted" in reader.text


def test_the_same_jobs_in_any_order_give_the_same_bytes():
    jobs = [row("a", "accepted"), row("b", "doubtful")]
    assert index_html("x", jobs) == index_html("x", jobs[::-1])


@pytest.mark.slow
def test_links_lead_to_what_jobs_left(tmp_path):
    decks = tmp_path / "decks"
    decks.mkdir()
    shutil.copy(ST_THOMAS, decks / HOSTILE)
    shutil.copy(ROOT / "fixtures" / "bad_decks" / "two_parts.crd", decks)
    ran = musat("batch", "decks", "-o", "out", "--html", "-j", "2", cwd=tmp_path)
    assert ran.returncode == 1 and ran.stdout.rstrip().endswith("index out/musat-batch.html")
    html = (tmp_path / "out" / "musat-batch.html").read_text()
    reader = Reader(html)
    assert not [tag for tag, _ in reader.tags if tag == "img"]
    assert HOSTILE in reader.text
    links = [link for link in reader.links if not link.startswith("#")]
    assert len(links) == 3
    assert all((tmp_path / "out" / unquote(link)).exists() for link in links)
    page = next(tmp_path / "out" / unquote(link) for link in links if link.endswith(".html"))
    written = page.stat().st_mtime_ns
    ran = musat("batch", "decks", "-o", "out", "--html", cwd=tmp_path)
    assert "1 kept from an earlier run" in ran.stdout and page.stat().st_mtime_ns == written
    assert (tmp_path / "out" / "musat-batch.html").read_text() == html
    os.unlink(page)  # a page that is gone is made again
    musat("batch", "decks", "-o", "out", "--html", cwd=tmp_path)
    assert page.exists()
