"""The JSON record of a job: the numbers of the listing with more digits, in metres, radians and plate millimetres.

Its fields are those of the tables named here, in their order, and of the pages that have tables of their own.
Numbers that do not exist (NaN) are null; columns of tables stand one on a line.
"""

from __future__ import annotations

import json
from collections.abc import Container, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np

import musatpy
from musatpy.model import RecordContent, Solution
from musatpy.records.json_files import quick_json
from musatpy.reports import (
    adjusted_water,
    analyses,
    bathymetric,
    blunders,
    control,
    echo,
    headline,
    iterations,
    job_record,
    listing,
    positions,
    reduction,
    residuals,
    stated,
    statistical_tests,
)
from musatpy.reports.fields import Document, Field, FieldGroup, Node, Rows, without_images
from musatpy.reports.values import Json, plain, rounded
from musatpy.statistics import Statistics

SCHEMA_VERSION = "3.0"
_ABOUT = (
    "The numbers of one job. A table has a list for each of its fields, with one entry per row; its numbers have "
    "as many significant digits as the field says, else all. Positions are in the system of the job: latitude, "
    "longitude, ellipsoidal height (GEOG) or X, Y, Z. Sigmas and differences in metres are along east, north, up "
    "(X, Y, Z in LOCL jobs). Attitudes are X-tilt, Y-tilt, heading. A number that does not exist is null."
)


_HEAD: tuple[Node[Statistics], ...] = (
    FieldGroup[Statistics, Statistics](
        "program", "what made the record", (
            Field("name", "const", "name of the program", lambda s: "musatpy", choices=("musatpy",)),
            Field("version", "string", "version of the program", lambda s: musatpy.__version__),
            Field("kernels", "string", "that did the work point after point; no difference to `diff`",
                  "solution.kernels"),
        ),
    ),
    FieldGroup[Statistics, Statistics](
        "units", "units of all fields that name no other", (
            Field("length", "const", "of positions, differences, depths", lambda s: "m", choices=("m",)),
            Field("angle", "const", "of all angles", lambda s: "rad", choices=("rad",)),
            Field("plate", "const", "of plate coordinates and their residuals", lambda s: "mm", choices=("mm",)),
        ),
    ),
    Field("titles", "* string", "title cards", "block.titles"),
    Field("settings", "* string", "what was set for the run: `OP2.water_level=ONE` of its cards, `causes=all`",
          "block.settings", seldom=True),
)  # fmt: skip
_RESULTS: tuple[Node[Statistics], ...] = (
    echo.WAVES,
    echo.WAVE_ORIGIN,
    headline.VERDICT,
    headline.SOLUTION,
    iterations.ITERATIONS,
    iterations.PASSES,
    analyses.ANALYSES,
    analyses.PLATE_STATISTICS,
    positions.STATIONS,
    positions.PAIRS,
    positions.LEVEL_PAIRS,
    positions.POINTS,
    stated.STATED,
    bathymetric.BATHYMETRIC,
    control.CONTROL,
    control.EQUAL_ELEVATIONS,
    control.AIR_BASES,
    control.DISTANCES,
    control.HEIGHT_DIFFERENCES,
    adjusted_water.ADJUSTED_WATER,
    adjusted_water.WATER_PRECISION,
    statistical_tests.TESTS,
    residuals.BESIDES_IMAGES,
    statistical_tests.DEPENDENCE,
    blunders.FINDINGS,
    blunders.CAUSES,
    blunders.UNEDITED,
    residuals.TESTED_PLATES,
    reduction.REDUCTION,
)  # fmt: skip


# What readers have: all observations in one table, those of images too.
_AS_READ: dict[Node[Statistics], Node[Statistics]] = {
    residuals.BESIDES_IMAGES: residuals.OBSERVATIONS,
    residuals.TESTED_PLATES: residuals.PLATES,
}


@cache
def document(content: RecordContent = RecordContent.FULL, *, as_read: bool = False) -> Document[Statistics]:
    """Return the record as it is written, or as it is read: what the cards say alone, results, tables of pages."""
    results = [*_RESULTS, *(node for page in listing.REPORTS for node in getattr(page, "RECORD", ()))]
    nodes = [*_HEAD, *job_record.input_tables([node.name for node in results]), *results]
    contents = Field[Statistics](
        "content", "string", "full, or tables: those of images are left out", lambda _: content,
        choices=(RecordContent.FULL, RecordContent.TABLES),
    )  # fmt: skip
    nodes = [contents, *(job_record.with_cards(_AS_READ.get(node, node) if as_read else node) for node in nodes)]
    return Document(
        name="schema_version",
        version=SCHEMA_VERSION,
        about_version="version of this schema; the first number changes when a field changes its meaning or goes",
        title="musatpy record",
        about=_ABOUT,
        nodes=nodes if content is RecordContent.FULL else list(without_images(nodes)),
        definitions=(statistical_tests.FACTOR_DEFINITION, analyses.ANALYSIS),
    )


def record(solution: Solution) -> dict[str, Json]:
    """Return the record of a solution as it is written: dictionaries, lists, texts and numbers."""
    return document().record(Statistics(solution))


def record_of(statistics: Statistics, names: Container[str] | None = None) -> dict[str, Json]:
    """Return the record of a solution as it is read; only what is named, where `names` are given.

    It has the shape of `musatpy.records.json_files.read_record`.
    """
    present = document(as_read=True).present(statistics)
    return {table.name: table.json(statistics) for table in present if names is None or table.name in names}


def held_tables(statistics: Statistics, names: Container[str]) -> dict[str, Json]:
    """Return what is named of `record_of`; the columns of its tables are worked out where they are looked at."""
    present = document(as_read=True).present(statistics)
    return {node.name: node.held(statistics) for node in present if node.name in names}


def dumps(record: dict[str, Json]) -> str:
    """Return a record as JSON text, one column of a table on a line."""
    return laid_out(record, "\n") + "\n"


def texts_of(statistics: Statistics, content: RecordContent = RecordContent.FULL) -> Iterator[str]:
    """Yield the text of `record` piece by piece."""
    yield from object_texts(document(content).present(statistics), statistics, "\n")
    yield "\n"


_ROWS = 20_000  # at a time
_MANY = 500  # entries of a column, from which on a package is worth its loading
# One encoder for all: json.dumps would make another for every row.
encoded = json.JSONEncoder(allow_nan=False, ensure_ascii=False).encode
_compact = json.JSONEncoder(allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode


def object_texts(nodes: Sequence[Node[Any]], source: Any, margin: str) -> Iterator[str]:
    """Yield the text of an object of these fields and tables, piece by piece, on lines that begin with `margin`."""
    inner = margin + "  "
    for number, node in enumerate(nodes):
        yield f"{',' if number else '{'}{inner}{encoded(node.name)}: "
        if isinstance(node, Rows):
            yield from _table(node, source, inner)
        elif isinstance(node, FieldGroup) and any(isinstance(field, Rows | FieldGroup) for field in node.fields):
            item = node.of(source)
            yield from ["null"] if item is None else object_texts(node.fields, item, inner)
        else:
            yield laid_out(node.json(source), inner)
    yield margin + "}"


def laid_out(value: Json, margin: str) -> str:
    """Spread tables, and what contains them, over lines that begin with `margin`."""
    inner = margin + "  "
    if _is_list_of_objects(value):
        return "[" + ",".join(inner + encoded(row) for row in value) + margin + "]"
    if isinstance(value, dict) and value and all(isinstance(entry, list) for entry in value.values()):
        columns = (f"{inner}{encoded(name)}: {_compact(column)}" for name, column in value.items())
        return "{" + ",".join(columns) + margin + "}"
    if isinstance(value, dict) and any(
        isinstance(entry, dict) or _is_list_of_objects(entry) for entry in value.values()
    ):
        entries = (f"{inner}{encoded(key)}: {laid_out(entry, inner)}" for key, entry in value.items())
        return "{" + ",".join(entries) + margin + "}"
    return encoded(value)


def _is_list_of_objects(value: Json) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _table(node: Rows[Any, Any], source: Any, margin: str) -> Iterator[str]:
    """Yield the text of a table."""
    for number, (field, values) in enumerate(node.columns(source)):
        yield f"{',' if number else '{'}{margin}  {encoded(field.name)}: ["
        for start in range(0, len(values), _ROWS):
            yield ("," if start else "") + _entries(values[start : start + _ROWS], field.digits)
        yield "]"
    yield margin + "}"


def _entries(values: Any, digits: int | None) -> str:
    """Return the entries of a part of a column, with commas between them."""
    entries = rounded(values, digits)
    is_array = isinstance(entries, np.ndarray)
    if (orjson := quick_json() if len(entries) > _MANY else None) is not None:
        plain_types = not is_array or entries.dtype.kind in "fiub"
        whole = (np.ascontiguousarray(entries) if is_array else list(entries)) if plain_types else entries.tolist()
        return str(orjson.dumps(whole, option=orjson.OPT_SERIALIZE_NUMPY), "utf-8")[1:-1]
    if not is_array or entries.dtype.kind != "f":
        return _compact(plain(entries) if is_array else list(entries))[1:-1]
    entry = "%r"
    for size in reversed(entries.shape[1:]):
        entry = f"[{','.join([entry] * size)}]"
    known = np.where(np.isfinite(entries), entries, np.nan).ravel().tolist()
    return (",".join([entry] * len(entries)) % tuple(known)).replace("nan", "null")
