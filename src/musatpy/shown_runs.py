"""What a run can leave besides listing and record for people to look at: pictures, a page, and layers of a map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from musatpy.errors import numerics
from musatpy.figures import FORM, ImageForm, check_matplotlib
from musatpy.files import write_files
from musatpy.reports.record import held_tables
from musatpy.reports.values import number
from musatpy.runs import RunResult
from musatpy.statistics import Statistics

if TYPE_CHECKING:
    from musatpy.plots.files import Drawn


_SHOWN = "the pictures, the page and the layers of the solution"  # from numbers worked out as they are looked at


@dataclass(frozen=True, kw_only=True)
class Shown:
    """Which of these are wanted, the form of pictures, and the system of layers: the job's where it is empty."""

    plots: bool = False
    html: bool = False
    gis: bool = False
    crs: str = ""
    form: ImageForm = FORM
    particulars: Mapping[str, str] = field(default_factory=dict)  # at the top of the page, by label

    @property
    def anything(self) -> bool:
        """True where something is wanted."""
        return self.plots or self.html or self.gis


@dataclass(frozen=True, kw_only=True)
class ShownFiles:
    """What was written of a kind (`pictures`, `page`, `layers`), and why some of it was not."""

    kind: str
    files: Sequence[Path] = ()
    reasons: Sequence[str] = ()


def show_run(result: RunResult, wanted: Shown) -> Iterator[ShownFiles]:
    """Write what is wanted of a run beside its listing, and yield each kind as it is there; raises as below."""
    from musatpy.plots.picture import NothingToShowError

    if wanted.plots:
        drawn = draw_run(result, wanted.form)
        reasons = [f"no {picture}: {why}" for picture, why in drawn.reasons.items()]
        yield ShownFiles(kind="pictures", files=drawn.files, reasons=reasons)
    if wanted.html:
        yield ShownFiles(kind="page", files=[write_page(result, wanted.particulars)])
    if wanted.gis:
        try:
            files, refused = write_layers(result, wanted.crs)
        except NothingToShowError as error:
            yield ShownFiles(kind="layers", reasons=[f"no layers: {error}"])
        else:
            yield ShownFiles(kind="layers", files=files, reasons=refused)


def check_packages(wanted: Shown) -> None:
    """Raise `MusatError` where a package is missing, or PROJ does not know the system."""
    if wanted.plots:
        check_matplotlib()
    if wanted.html:
        from musatpy.page.rendering import check_packages as check_page_packages

        check_page_packages()
    if wanted.gis:
        from musatpy.geometry.projected import crs_of
        from musatpy.interchange.layers import package

        package("pyogrio", "GeoPackages need")
        package("shapely", "GeoPackages need")
        if wanted.crs:
            crs_of(wanted.crs)


def draw_run(result: RunResult, form: ImageForm = FORM) -> Drawn:
    """Draw the pictures of a run beside its listing. Raises `MusatError` without matplotlib, and `OSError`."""
    from musatpy.plots.files import draw
    from musatpy.plots.gallery import GALLERY, KINDS

    kind = KINDS[b"schema"]
    stem, tables = _stem(result), _tables(result, {*kind.required, *kind.optional})
    with numerics(_SHOWN):
        return draw(tables, GALLERY, stem, form)


def write_page(result: RunResult, particulars: Mapping[str, str] | None = None) -> Path:
    """Write the page of a run beside its listing, and return where it is: that of its record, with its deck.

    `particulars` stand at its top, by label.

    Raises `MusatError` without jinja2 or matplotlib, and `OSError`.
    """
    from musatpy.page.composition import LEFT, page_of_tables
    from musatpy.reports.record import document

    stem = _stem(result)
    names = {node.name for node in document().whole} - LEFT
    place = stem.with_name(f"{stem.name}.html")
    files = [file for file in (result.record, result.deck) if file is not None and file.is_file()]
    with numerics(_SHOWN):
        page = page_of_tables(_tables(result, names), files, particulars)
    write_files({place: page.encode()})
    return place


def check_point_rms(result: RunResult) -> tuple[int, tuple[float | None, ...] | None]:
    """Return the check points of a run, as many as the component with most has, and their RMS (m) by component.

    None of a component that none has; without any, None in place of them.
    """
    assert result.solution is not None
    components = Statistics(result.solution).check_points.statistics
    count = max(component.size for component in components)
    return count, tuple(number(component.rms) for component in components) if count else None


def write_layers(result: RunResult, crs: str = "") -> tuple[list[Path], list[str]]:
    """Write the layers of a run beside its listing, and return their files, and why some are not there.

    They are a GeoPackage, and GeoJSON where PROJ knows the way from the datum of the system to WGS 84. Raises
    `ProblemsError` for a system that the job is not in, and without the extra `gis`; `OSError`.
    """
    from musatpy.gis.run_layers import NEEDS, layers_of
    from musatpy.interchange import geojson, geopackage

    stem, tables = _stem(result), _tables(result, set(NEEDS))
    with numerics(_SHOWN):
        layers = layers_of(tables, crs)
    package = stem.with_name(f"{stem.name}.gpkg")
    geopackage.write(package, layers)
    written, refused = geojson.write_each(layers, stem)
    return [package, *written], refused[:1] if not written else refused


def _stem(result: RunResult) -> Path:
    assert result.listing is not None  # of a run that has left something
    return result.listing.with_suffix("")


def _tables(result: RunResult, names: set[str]) -> dict[str, Any]:
    """Return tables of the record of a run, whether it was written or not."""
    assert result.solution is not None
    return held_tables(Statistics(result.solution), names)
