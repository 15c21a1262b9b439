"""From the record of a run, a compilation or a comparison with soundings, a file or in memory, to its page."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from musatpy.errors import Problem, RecordError
from musatpy.json_files import known_of, read_json_file
from musatpy.page.parts import Page
from musatpy.page.rendering import check_packages, html_of
from musatpy.plots.tables import Tables

_OF_COMPILATION, _OF_SOUNDINGS = "compilation_version", "soundings_version"
_RUN_NEEDS = {
    "options": ("program", "system", "refraction", "plate_sigma"),
    "solution": ("converged", "sigma0", "degrees_of_freedom"),
    "stations": ("photo", "camera", "position"),
    "points": ("point", "bathymetric", "status", "rays", "position"),
}
# Of the record of a run, what no page shows.
LEFT = frozenset({"station_pairs", "level_pairs", "fiducial_measurements", "cross_measurements"})
_COMPILATION_NEEDS = {
    "job": ("titles", "system", "index", "datum", "datum_height", "datum_sigma"),
    "models": ("model", "y_parallax"),
    "points": ("model", "point", "submerged", "datum_depth", "datum_depth_sigma", "covariance", "reason"),
}
_SOUNDINGS_NEED = {
    "matching": ("radius", "datum", "datum_sigma", "sigma", "plan_sigma", "steepest", "not_before"),
    "samples": ("sample", "size", "rms", "median", "spread"),
    "differences": ("sounding", "compiled", "sounded", "difference", "sigma", "blunder"),
    "left_out": ("sounding", "reason"),
}


def page_of_record(path: Path, inputs: Iterable[Path] = ()) -> str:
    """Return the page of the record of a run, a compilation or a comparison as HTML: also of an earlier version.

    It states the SHA-256 of the record, and of `inputs`, files that the run has read. Raises `RecordError` for a
    file that is no such record, `MusatError` where jinja2 or matplotlib is missing, and `OSError`.
    """
    check_packages()
    return page_of_tables(tables_of_record(path), [path, *inputs])


def page_of_tables(tables: Tables, files: Iterable[Path]) -> str:
    """Return the page of tables, in the shape of `musatpy.json_files.read_record`, with the SHA-256 of files.

    Raises `MusatError` where jinja2 or matplotlib is missing, and `OSError`.
    """
    return html_of(_page_of(tables)(tables, {file.name: _sha256(file) for file in files}))


def _page_of(tables: Tables) -> Callable[[Tables, Mapping[str, str]], Page]:
    """Return what makes the page of tables; what makes the others is not loaded."""
    if _OF_COMPILATION in tables:
        from musatpy.page.compilation_page import compilation_page as page
    elif _OF_SOUNDINGS in tables:
        from musatpy.page.soundings_page import soundings_page as page
    else:
        from musatpy.page.run_page import run_page as page
    return page


def tables_of_record(path: Path) -> dict[str, Any]:
    """Return what the record of a run or a compilation has; raises as `page_of_record`."""
    record = read_json_file(path)
    if isinstance(record, dict) and _OF_COMPILATION in record:
        from musatpy.reports import compilation

        return known_of(record, path, _COMPILATION_NEEDS, schema=compilation.DOCUMENT.schema())
    if isinstance(record, dict) and _OF_SOUNDINGS in record:
        from musatpy.reports import soundings

        return known_of(record, path, _SOUNDINGS_NEED, schema=soundings.DOCUMENT.schema())
    if not isinstance(record, dict) or "schema_version" not in record:
        message = "is not the record of a run, of a compilation or of a comparison with soundings"
        raise RecordError([Problem(file=str(path), message=message)])
    return known_of(record, path, _RUN_NEEDS, LEFT)


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
