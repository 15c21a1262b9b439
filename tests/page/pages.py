"""Pages of fixtures without their pictures, and what stands on a page, read by a parser of its own."""

import json
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from musatpy.as11_comparisons import compare_soundings
from musatpy.as11_runs import compile_deck
from musatpy.compilation.other_bottoms import Matching
from musatpy.page.composition import page_of_record
from musatpy.records.json_files import with_images
from musatpy.runs import run_deck

ROOT = Path(__file__).parents[2]
ST_THOMAS = ROOT / "fixtures" / "st_thomas" / "st_thomas.crd"
COMPILATION = ROOT / "fixtures" / "st_thomas_as11" / "st_thomas_as11.crd"
SOUNDINGS = COMPILATION.with_name("soundings.csv")
_VOID = {"br", "img", "link", "meta"}  # tags that have no end


@cache
def record_text(deck: Path = ST_THOMAS, old: str = "", new: str = "") -> str:
    """Return the record of a run of a deck, in which a text stands for another."""
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "deck.crd"
        text = deck.read_text()
        assert old in text
        copy.write_text(text.replace(old, new))
        result = run_deck(copy)
        assert result.record, result.problems
        return result.record.read_text()


@cache
def compiled_text() -> str:
    """Return the record of the compilation of St. Thomas."""
    with TemporaryDirectory() as folder:
        result = compile_deck(written(Path(folder)), COMPILATION, folder)
        (record,) = (path for path in result.files if path.suffix == ".json")
        return record.read_text()


@cache
def sounded_text() -> str:
    """Return the record of soundings beside that compilation."""
    with TemporaryDirectory() as folder:
        outputs = Path(folder) / "S.lst", Path(folder) / "S.json"
        how = Matching(datum=-0.15, sigma=0.2)
        compare_soundings(written(Path(folder)), COMPILATION, SOUNDINGS, outputs, how)
        return outputs[1].read_text()


def written(folder: Path, text: str | None = None) -> Path:
    """Return a record that was written into a folder: that of the strip at St. Thomas where no other is given."""
    path = folder / "job.json"
    path.write_text(record_text() if text is None else text)
    return path


def record() -> dict[str, Any]:
    return with_images(json.loads(record_text()))


class Reader(HTMLParser):
    """Tables by their titles, with heads and rows; links, ids and texts; every tag ends where it must."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.links: list[str] = []
        self.ids: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._titles: dict[str, str] = {}
        self._title = self._cell = ""
        self._inside: list[str] = []
        self.feed(html)
        self.close()
        assert not self._inside

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append((tag, given))
        self.ids += [given["id"]] if given.get("id") else []
        self.links += [given["href"]] if tag == "a" and given.get("href") else []
        if tag in ("h2", "h3"):
            self._title = ""
        if tag == "table":
            self._rows = self.tables.setdefault(self._title, [])
        if tag == "tr":
            self._rows.append([])
        if tag in ("td", "th"):
            self._cell = ""
        if tag not in _VOID:
            self._inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th"):
            self._rows[-1].append(" ".join(self._cell.split()))
        assert self._inside.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "title"} & set(self._inside):
            self.text += data
        self._cell += data
        if {"h2", "h3"} & set(self._inside):
            self._title += data

    def rows(self, title: str) -> list[dict[str, str]]:
        """Return the rows of a table by its heads."""
        heads, *rows = self.tables[title]
        return [dict(zip(heads, row, strict=True)) for row in rows]

    def fact(self, label: str) -> str:
        """Return what stands below a label."""
        return self.text.partition(label)[2].split("\n")[0].strip()


def read(path: Path) -> Reader:
    return Reader(page_of_record(path))
