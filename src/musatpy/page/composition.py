"""From the record of a run, a compilation or a comparison with soundings, a file or in memory, to its page."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import musatpy
from musatpy.errors import RecordError
from musatpy.page.rendering import Chapter, Fact, Facts, Page, PagePicture, check_packages, html_of
from musatpy.page.systems import system_facts
from musatpy.plots.compiled_pictures import SOUNDINGS
from musatpy.plots.gallery import KINDS, NO_RECORD, rendered
from musatpy.plots.picture import Picture
from musatpy.records.json_files import known_of, read_json_file
from musatpy.records.tables import Tables, part

_RUN = "schema"  # kind of the record of a run
_PAGES = {_RUN: "run_page", "compilation": "compilation_page", "soundings": "soundings_page"}
_BEFORE_PICTURES = "Accuracy"  # a chapter
# Of the record of a run, what no page shows.
LEFT = frozenset({"station_pairs", "level_pairs", "fiducial_measurements", "cross_measurements"})
# What a data URI within double quotes of HTML has to escape, in this order; quotes of SVG become single ones.
_ESCAPES = {"'": "&apos;", "%": "%25", "#": "%23", "<": "%3C", ">": "%3E", "&": "%26", '"': "'"}
_INDENT = re.compile(r"\s*\n\s*")
_PROLOG = re.compile(r"^.*?(?=<svg)", re.DOTALL)


def page_of_record(path: Path, inputs: Iterable[Path] = (), particulars: Mapping[str, str] | None = None) -> str:
    """Return the page of the record of a run, a compilation or a comparison as HTML.

    It states the SHA-256 of the record, and of `inputs`, files that the run has read; `particulars` are what
    stands at the top by its label, such as a date or a client. Raises `RecordError` for a file that is no such
    record, `MusatError` where jinja2 or matplotlib is missing, and `OSError`.
    """
    check_packages()
    return page_of_tables(_tables_of(path), [path, *inputs], particulars)


def page_of_tables(tables: Tables, files: Sequence[Path], particulars: Mapping[str, str] | None = None) -> str:
    """Return the page of tables, in the shape of `read_record`, with the SHA-256 of files and `particulars` on top.

    Raises `MusatError` where jinja2 or matplotlib is missing, and `OSError`.
    """
    kind = _kind_of(tables)
    maker = _PAGES[kind]  # what makes other pages is not loaded
    page: Page = getattr(import_module(f"musatpy.page.{maker}"), maker)(tables)
    shown = list(pictures(KINDS[kind.encode()].pictures, tables, files[0].stem if files else ""))
    chapters: list[Chapter] = []
    for chapter in page.chapters:
        chapters.append(chapter)
        if chapter.title == _BEFORE_PICTURES and shown[1:]:
            chapters.append(Chapter(title="Pictures", parts=shown[1:]))
    chapters.append(
        _provenance(tables, {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files})
    )
    closing = (
        f"Made by musatpy {musatpy.__version__} from the record, which has more digits and every row. Blank cells "
        "are numbers that do not exist."
    )
    job = [*system_facts(tables), *(Fact(label, text) for label, text in (particulars or {}).items())]
    return html_of(replace(page, job=job, map=shown[0] if shown else None, chapters=chapters, closing=closing))


def _kind_of(record: Any) -> str:
    """Return what a record is of, as its version says: `schema` of a run; empty of what is no record."""
    kinds = [name.decode() for name in KINDS]
    return next((name for name in kinds if isinstance(record, Mapping) and f"{name}_version" in record), "")


def _tables_of(path: Path) -> dict[str, Any]:
    """Return what a record has; raises as `page_of_record`."""
    record = read_json_file(path)
    if kind := _kind_of(record):
        return known_of(record, path, LEFT if kind == _RUN else (), schema=KINDS[kind.encode()].schema())
    raise RecordError.of(NO_RECORD, file=path)


def _provenance(tables: Tables, files: Mapping[str, str]) -> Chapter:
    """Return the chapter that says what a page was made of; `files` are names with the SHA-256 of each."""
    program = part(tables, "program")
    facts = [
        Fact("Program of the record", f"musatpy {program['version']}" if program else ""),
        Fact("Kernels", str(program.get("kernels") or "")),
        Fact("Schema of the record", str(tables[f"{_kind_of(tables)}_version"])),
        Fact("Program of the page", f"musatpy {musatpy.__version__}"),
        *(Fact(f"SHA-256 of {name}", digest) for name, digest in files.items()),
    ]
    return Chapter(title="Files And Program", parts=[Facts([fact for fact in facts if fact.value])])


def pictures(gallery: Iterable[Picture[Any]], tables: Tables, job: str) -> Iterator[PagePicture]:
    """Yield the pictures that a record has something for, the map first; `job` names one without a title."""
    for picture in gallery:
        if image := rendered(picture, tables, job):
            suffix, data, sentence = image
            yield PagePicture(
                title=picture.title,
                name=picture.name,
                sentence=sentence,
                is_wide=picture.name == SOUNDINGS.name,
                uri=_uri(suffix, data),
            )


def _uri(suffix: str, data: bytes) -> str:
    """Return a picture as a data URI. SVG stays text: in base 64 it would be longer by a third."""
    if suffix == "svg":
        text = _INDENT.sub(" ", _PROLOG.sub("", data.decode("utf-8"))).replace("> <", "><")
        for character, escape in _ESCAPES.items():
            text = text.replace(character, escape)
        return f"data:image/svg+xml,{text}"
    return f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"
