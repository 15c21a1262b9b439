"""The pictures of records: which there are of each kind, what they need of one, and how they become files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError, RecordError, numerics
from musatpy.figures import FORM, ImageForm, image_of
from musatpy.model import Solution
from musatpy.plots import compiled_pictures
from musatpy.plots.block_plan import PLAN
from musatpy.plots.depth_profile import PROFILE
from musatpy.plots.exposures import CORRELATIONS, GNSS, TIDES
from musatpy.plots.lens_distortion import LENS
from musatpy.plots.picture import Picture
from musatpy.plots.plate_residuals import MEANS, NORMALISED, PHOTOS
from musatpy.plots.point_quality import REDUNDANCY, SIGMAS
from musatpy.plots.submerged_points import CORRECTIONS
from musatpy.records.json_files import Schema, read_record
from musatpy.records.tables import Tables
from musatpy.reports.record import held_tables
from musatpy.statistics import Statistics

# Of a run, of a compilation, and of a comparison with soundings.
GALLERY: tuple[Picture[Any], ...] = (
    PLAN,
    PHOTOS,
    MEANS,
    SIGMAS,
    REDUNDANCY,
    NORMALISED,
    PROFILE,
    CORRECTIONS,
    TIDES,
    CORRELATIONS,
    GNSS,
    LENS,
)
COMPILED: tuple[Picture[Any], ...] = (
    compiled_pictures.DEPTHS,
    compiled_pictures.SIGMAS,
    compiled_pictures.PROFILE,
    compiled_pictures.CORRECTIONS,
    compiled_pictures.PARALLAXES,
)
SOUNDED: tuple[Picture[Any], ...] = (compiled_pictures.SOUNDINGS,)

NO_RECORD = "is not the record of a run, of a compilation or of a comparison with soundings"
MOST_MARKS = 2000  # of a picture that is SVG: 10,000 ellipses are 7.1 MB, and 0.5 MB as PNG
_VERSION = re.compile(rb'\s*\{\s*"(\w+)_version"')  # the first field of a record, of whichever kind
_RUN = ("options", "stations")
# What pictures take where it is there.
_OF_RUN = ("titles", "stated", "ellipsoid", "adjusted_water", "dependence")


@dataclass(frozen=True, eq=False)
class RecordKind:
    """What a record is of, and the pictures of it."""

    what: str
    pictures: tuple[Picture[Any], ...]
    required: tuple[str, ...]
    optional: tuple[str, ...] = ()
    report: str = ""  # the module that has its schema; of a run none

    def schema(self) -> Schema | None:
        """Return the schema of the record, None of a run."""
        return import_module(self.report).DOCUMENT.schema() if self.report else None


def needs_of(pictures: Iterable[Picture[Any]]) -> tuple[str, ...]:
    """Return the tables that pictures need."""
    return tuple(dict.fromkeys(table for picture in pictures for table in picture.needs))


KINDS = {
    b"schema": RecordKind("run", GALLERY, _RUN, (*needs_of(GALLERY), *_OF_RUN)),
    b"compilation": RecordKind("compilation", COMPILED, needs_of(COMPILED), report="musatpy.reports.compilation"),
    b"soundings": RecordKind("comparison", SOUNDED, needs_of(SOUNDED), report="musatpy.reports.soundings"),
}


def read_tables(path: Path) -> tuple[RecordKind, Tables]:
    """Return what a record is of, and the tables that its pictures need.

    Raises `RecordError` where it is none, or not as its schema says, and `OSError`.
    """
    with path.open("rb") as file:
        begin = _VERSION.match(file.read(200))
    kind = KINDS.get(begin[1]) if begin else None
    if kind is None:
        raise RecordError.of(NO_RECORD, file=path)
    return kind, read_record(path, kind.required, kind.optional, schema=kind.schema(), what=kind.what)


def rendered(
    picture: Picture[Any], tables: Tables, job: str = "", form: ImageForm = FORM
) -> tuple[str, bytes, str] | None:
    """Return suffix and bytes of a picture of a record, and its sentence; None where it has nothing to show.

    Where the form says no kind, SVG up to `MOST_MARKS` marks, PNG above; the same record gives the same bytes.
    `job` names one whose record has no title. Raises `MusatError` where matplotlib is missing.
    """
    drawn = picture.drawn(tables, job)
    if drawn is None:
        return None
    figure, sentence = drawn
    return *image_of(figure, form, "svg" if marks(figure) <= MOST_MARKS else "png"), sentence


def _png_of(figure: Any) -> bytes:
    return image_of(figure)[1]


def drawing_of(name: str) -> Callable[[Solution], Any]:
    """Return the function that draws a picture of the gallery of a solution."""
    picture = next(picture for picture in GALLERY if picture.name == name)
    kind = KINDS[b"schema"]

    def draw(solution: Solution) -> Any:
        with numerics(f"the picture {name}"):
            tables = held_tables(Statistics(solution), {*kind.required, *kind.optional})
            drawn = picture.drawn(tables)
        if drawn is None:
            raise MusatError(f"no {name}: {picture.sentence(tables)}")
        figure, _ = drawn
        figure._repr_png_ = partial(_png_of, figure)  # what a notebook shows, with pyplot or without
        return figure

    draw.__name__ = draw.__qualname__ = name
    draw.__doc__ = (
        f"Return a figure of matplotlib: {picture.title.lower()} of a solution.\n\n"
        "Raises `MusatError` without matplotlib, and where the solution has nothing of what is shown."
    )
    return draw


def marks(figure: Any) -> int:
    """Return how many markers, lines, arrows, ellipses and bars a figure has."""
    number = 0
    for axes in figure.axes:
        number += len(axes.patches) + len(axes.texts) + sum(len(line.get_xdata()) for line in axes.lines)
        number += sum(max(len(one.get_offsets()), len(one.get_paths())) for one in axes.collections)
    return number
