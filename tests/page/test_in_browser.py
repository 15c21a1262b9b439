"""Pages with their pictures in a browser without a network: requests, console, axe, keyboard, widths, paper.

They need Chromium, and axe-core by the variable AXE_CORE, a path of axe.min.js; .ci/run sees to both.
"""

import base64
import contextlib
import json
import os
import re
import subprocess
import sys
import zlib
from io import BytesIO
from pathlib import Path

import pytest
from matplotlib.image import imread

from cli.commands import musat
from musatpy.campaign.batch_jobs import BatchJob, JobOutcome, JobState
from musatpy.campaign.batch_reports import index_page
from musatpy.page.composition import page_of_record
from page.browser import browser, chromium
from page.pages import ST_THOMAS, compiled_text, record_text, sounded_text

AXE = os.environ.get("AXE_CORE", "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium() is None, reason="no Chromium here"),
]
NAMES = ("job", "compilation", "comparison", "rejected", "index")
_RUN = (
    "axe.run(document, {resultTypes: ['violations'], ...%s}).then(found => JSON.stringify(found.violations.map("
    "one => [one.id, one.impact, one.nodes.map(node => node.html.slice(0, 200))])))"
)
_EVERYTHING, _CONTRAST = "{}", "{runOnly: ['color-contrast']}"
_NO_CONTRAST = "{rules: {'color-contrast': {enabled: false}}}"
_OPEN_ALL = "document.querySelectorAll('details').forEach(one => one.open = true)"
_NO_SHADES = (  # on which axe could not tell the contrast of tables
    "document.head.insertAdjacentHTML('beforeend', '<style>.scroll { background-image: none !important }</style>')"
)
_WIDTH = "document.documentElement.scrollWidth"
_FOCUSED = (
    "(() => { const one = document.activeElement, box = one.closest('.scroll');"
    " return [one.tagName, one.parentElement && one.parentElement.open === false,"
    " box === one ? (box.getAttribute('aria-labelledby') || '') : '']})()"
)


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Pages of a run, a compilation, a comparison with soundings, a rejected run, and the index of a batch."""
    folder = tmp_path_factory.mktemp("pages")
    content = json.loads(record_text())
    reason = {"grade": "REJECTED", "concern": "sigma0", "text": "sigma0 is 9", "section": "Statistics: Sigma0"}
    content["verdict"] |= {"grade": "REJECTED", "reasons": [reason]}
    texts = {"job": record_text(), "compilation": compiled_text(), "comparison": sounded_text()}
    for name, text in (texts | {"rejected": json.dumps(content)}).items():
        (folder / f"{name}.json").write_text(text)
    jobs = [BatchJob(deck=Path(f"decks/{state.replace(' ', '-')}.crd")) for state in JobState]
    outcomes = [
        JobOutcome(
            state=state, photos=3, points=22, sigma0=1.0, check_points=2, check_rms=(0.1, 0.2, 0.3),
            message="why " * 30, outputs={f"{job.deck.stem}{suffix}": "" for suffix in (".html", ".lst")},
        )
        for job, state in zip(jobs, JobState, strict=True)
    ]  # fmt: skip
    (folder / "index.html").write_bytes(index_page("Campaign", folder, jobs, outcomes))
    for name in NAMES[:-1]:
        (folder / f"{name}.html").write_text(page_of_record(folder / f"{name}.json"))
    return {name: folder / f"{name}.html" for name in NAMES}


@pytest.fixture(scope="module")
def tab():
    with browser() as tab:
        yield tab


@pytest.mark.parametrize("name", NAMES)
def test_no_request_and_no_word_on_the_console(tab, places, name):
    tab.open(places[name].as_uri())
    tab.evaluate(_OPEN_ALL)
    assert tab.said() == []


def test_the_browser_would_tell(tab, tmp_path):
    """A page that asks for something, and says something, is noticed: the test before this can fail."""
    page = tmp_path / "asks.html"
    page.write_text("<img src='http://127.0.0.1:9/x.png'><script>console.log('here')</script>")
    tab.open(page.as_uri())
    assert {"Network.requestWillBeSent", "Runtime.consoleAPICalled"} <= {event["method"] for event in tab.said()}


@pytest.mark.skipif(not AXE, reason="AXE_CORE names no axe.min.js")
@pytest.mark.parametrize(("width", "dark"), [(1400, False), (320, False), (1400, True)])
@pytest.mark.parametrize("name", NAMES)
def test_axe_finds_nothing(tab, places, name, width, dark):
    """In the dark colours alone are others, on a small screen all but colours.

    Those of what is folded are there when all is open; in a rejected run that is the tables of the job.
    """
    rules = _CONTRAST if dark else _EVERYTHING if width == 1400 else _NO_CONTRAST
    tab.dark(dark)
    tab.open(places[name].as_uri(), width)
    tab.evaluate(f"{Path(AXE).read_text()}; 0")
    tab.evaluate(_NO_SHADES)
    if not dark or name == "rejected":
        assert json.loads(tab.evaluate(_RUN % rules)) == []
    if name != "rejected":
        tab.evaluate(_OPEN_ALL)
        assert json.loads(tab.evaluate(_RUN % rules)) == []
    tab.dark(False)


@pytest.mark.skipif(not AXE, reason="AXE_CORE names no axe.min.js")
def test_axe_would_find_a_table_without_heads(tab, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text("<html><body><img src='data:,'><p style='color: #aaa'>pale</p></body></html>")
    tab.open(page.as_uri())
    tab.evaluate(f"{Path(AXE).read_text()}; 0")
    found = json.loads(tab.evaluate(_RUN % _EVERYTHING))
    assert {"image-alt", "color-contrast", "html-has-lang"} <= {one[0] for one in found}
    assert [one[0] for one in json.loads(tab.evaluate(_RUN % _CONTRAST))] == ["color-contrast"]


@pytest.mark.parametrize("name", NAMES)
def test_tab_and_enter_reach_every_table(tab, places, name):
    tab.open(places[name].as_uri())
    wanted = set(
        tab.evaluate("[...document.querySelectorAll('.scroll')].map(x => x.getAttribute('aria-labelledby'))")
    )
    reached = set()
    for _ in range(400):
        tab.press("Tab")
        tag, is_closed, region = tab.evaluate(_FOCUSED)
        if tag == "BODY":
            break
        if tag == "SUMMARY" and is_closed:
            tab.press("Enter")
        reached |= {region} - {""}
    assert wanted and reached == wanted


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_wider_than_a_small_screen(tab, places, name):
    tab.open(places[name].as_uri(), 320)
    tab.evaluate(_OPEN_ALL)
    assert tab.evaluate(_WIDTH) == 320


@pytest.mark.parametrize("name", NAMES[:-1])
def test_a_map_is_in_view_when_a_page_opens(tab, places, name):
    tab.open(places[name].as_uri())
    top, bottom = tab.evaluate(
        "(box => [box.top, box.bottom])(document.querySelector('.top figure img').getBoundingClientRect())"
    )
    assert 0.0 < top and bottom <= 900.0


def test_a_shade_says_that_a_table_runs_on_until_its_end_is_in_view(tab, places):
    tab.open(places["job"].as_uri(), 320)
    box = "const box = [...document.querySelectorAll('.scroll')].find(b => b.scrollWidth > b.clientWidth + 20); "
    tab.evaluate(f"{{ {box} box.scrollIntoView() }}")
    darkest = []
    for end in ("0", "1e6"):
        place = "const at = box.getBoundingClientRect(); [at.right, at.top + scrollY]"
        x, y = tab.evaluate(f"{{ {box} box.scrollLeft = {end}; {place} }}")
        clip = {"x": x - 2.0, "y": y + 4.0, "width": 2.0, "height": 8.0, "scale": 1.0}
        image = base64.b64decode(tab.send("Page.captureScreenshot", format="png", clip=clip)["data"])
        darkest.append(imread(BytesIO(image))[..., :3].min())
    assert darkest[0] < 0.7 < 0.95 < darkest[1]


def test_pictures_are_on_white_in_the_dark(tab, places):
    tab.dark()
    tab.open(places["job"].as_uri())
    colours = tab.evaluate(
        "[...document.querySelectorAll('figure img')].map(one => getComputedStyle(one).backgroundColor)"
    )
    assert len(colours) > 8 and set(colours) == {"rgb(255, 255, 255)"}
    tab.dark(False)


def test_pages_of_paper_are_numbered(tab, places):
    tab.open(places["job"].as_uri())
    numbered = tab.pdf()
    tab.evaluate(
        "document.querySelector('style').append('@media print { @page { @bottom-right { content: none } } }')"
    )
    pages = len(re.findall(rb"/Type /Page\b", numbered))
    assert pages > 5 and _words_of(numbered) - _words_of(tab.pdf()) >= pages


def _words_of(pdf):
    """Return how many pieces of text the pages of a PDF show."""
    streams = re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL)
    count = 0
    for stream in streams:
        with contextlib.suppress(zlib.error):
            count += len(re.findall(rb"\bT[jJ]\b", zlib.decompress(stream)))
    return count


@pytest.mark.parametrize("name", NAMES)
def test_paper_shows_folded_tables_and_cuts_none(tab, places, name):
    tab.send("Emulation.setEmulatedMedia", media="print")
    tab.open(places[name].as_uri(), 703)  # A4 less its margins, in pixels of 1/96 inch
    tables = tab.evaluate(
        "[...document.querySelectorAll('table')].map(one => [one.caption || one.getAttribute('aria-labelledby'),"
        " one.getBoundingClientRect().right, one.getBoundingClientRect().height])"
    )
    tab.send("Emulation.setEmulatedMedia", media="")
    assert tables
    for title, right, height in tables:
        assert height > 10.0, f"{title} is folded"
        assert right <= 703.5, f"{title} is cut"
    assert tab.pdf()[:5] == b"%PDF-"


def test_the_same_record_gives_the_same_bytes_and_not_many(places, tmp_path):
    """In a process of its own, with other hashes of texts; 0.4 MB at most."""
    command = [sys.executable, "-c", "from musatpy.cli.main import main; main()", "report", "-q"]
    command += [str(places["job"].with_suffix(".json")), "-o", str(out := tmp_path / "job.html")]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONHASHSEED": "1"})
    page = out.read_bytes()
    assert page == places["job"].read_bytes()
    assert len(page) <= 400_000
    assert page.count(b"<figure ") >= 8


def test_a_run_makes_the_same_page_in_one_go(tmp_path):
    assert musat("run", ST_THOMAS, "-o", tmp_path, "--html", "-q").exit_code == 0
    page = tmp_path / "st_thomas.html"
    first = page.read_bytes()
    assert musat("report", "-q", page.with_suffix(".json"), "--input", ST_THOMAS).exit_code == 0
    assert page.read_bytes() == first
