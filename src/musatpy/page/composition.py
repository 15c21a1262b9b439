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

import pyproj

import musatpy
from musatpy.errors import RecordError
from musatpy.geometry.projected import crs_of
from musatpy.model import CoordinateSystem
from musatpy.page.rendering import Chapter, Fact, Facts, Page, PagePicture, check_packages, html_of
from musatpy.plots.compiled_pictures import SOUNDINGS
from musatpy.plots.gallery import KINDS, NO_RECORD, rendered
from musatpy.plots.picture import Picture
from musatpy.records.json_files import known_of, read_json_file
from musatpy.records.tables import Tables, part
from musatpy.reports.titles import SYSTEMS

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
    record = read_json_file(path, LEFT)
    kind = _kind_of(record)
    if not kind:
        raise RecordError.of(NO_RECORD, file=path)
    tables = known_of(record, path, LEFT if kind == _RUN else (), schema=KINDS[kind.encode()].schema())
    return page_of_tables(tables, [path, *inputs], particulars)


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
    job = [*_system_facts(tables), *(Fact(label, text) for label, text in (particulars or {}).items())]
    return html_of(replace(page, job=job, map=shown[0] if shown else None, chapters=chapters, closing=closing))


def _kind_of(record: Any) -> str:
    """Return what a record is of, as its version says: `schema` of a run; empty of what is no record."""
    kinds = [name.decode() for name in KINDS]
    return next((name for name in kinds if isinstance(record, Mapping) and f"{name}_version" in record), "")


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


def _system_facts(tables: Tables) -> Iterator[Fact]:
    """Yield coordinate system, datum and reference of heights of the answer of a run or of a compilation."""
    job = part(tables, "job") or part(tables, "options")
    if not job:
        return
    system = CoordinateSystem(job["system"])
    answer = part(tables, "stated").get("answer") or {}
    crs = crs_of(answer["definition"]) if answer.get("definition") else None
    text = str(answer.get("text") or SYSTEMS[system]).partition(";")[0]  # without attitudes and sigmas
    yield Fact("Coordinate system", text[:1].upper() + text[1:])
    if system == CoordinateSystem.LOCAL:
        yield Fact("Datum", "none: a local system")
        yield Fact("Heights", "Z of the job")
        return
    datum = crs.geodetic_crs.datum.name if crs and crs.geodetic_crs and crs.geodetic_crs.datum else ""
    yield Fact("Datum", datum or f"not named; ellipsoid {_ellipsoid(tables)}")
    geoid = answer.get("geoid")
    yield Fact("Heights", f"above the geoid of {geoid}" if geoid else "above the ellipsoid")


def _ellipsoid(tables: Tables) -> str:
    """Return the name of the ellipsoid of a job in full, or its axis and flattening."""
    stated = part(tables, "ellipsoid") or part(tables, "job").get("ellipsoid") or {}
    name = stated.get("name") or f"{stated.get('semi_major_axis')} m, 1 : {stated.get('inverse_flattening')}"
    return str(pyproj.get_ellps_map().get(name, {}).get("description", name))


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
