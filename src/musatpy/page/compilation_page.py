"""The page of a compilation (`musat as11 compile`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from musatpy.page.accuracy import DepthFigures, analysis_table, order_facts, orders_table
from musatpy.page.page_tables import PageReport, chapters_of, number_text, page_of, place_of, places_of, tables_of
from musatpy.page.rendering import Fact, Facts, Page, Part, Sentences, anchor_of
from musatpy.plots.picture import counted
from musatpy.records.tables import Tables, flags, numbers, part, texts
from musatpy.reports import compilation, compilation_bottom, compilation_points
from musatpy.reports.stated import answered
from musatpy.reports.table import Report

_POINTS = 200  # rows
_AGAINST = "Comparison With The Run: In Numbers"
_LEFT_OUT = Report(
    "Points Without Coordinates",
    compilation_points.POINTS,
    ("model point", compilation_points.POINTS.column("reason", "Reason", "A80")),
    which=lambda t: np.flatnonzero([reason is not None for reason in t["reason"]]),
)
_open = partial(PageReport, folded=False)
_MODELS = (
    *map(_open, (compilation.MODEL_TABLE, compilation.RECOVERED_TABLE)),
    PageReport(compilation.SHORE_TABLE),
)
_BOTTOM = tuple(map(_open, (*compilation_points.OF_PROFILES, *compilation_bottom.BOTTOM_TABLES)))
_OF_POINTS = tuple(
    PageReport(report, _POINTS)
    for report in (
        compilation_points.POINT_TABLE,
        compilation_points.RAY_TABLE,
        compilation_points.APPARENT_TABLE,
        compilation.RUN_TABLE,
    )
)


def compilation_page(tables: Tables) -> Page:
    """Return the page of the record of a compilation."""
    depths, job = _depths(tables), tables["job"]
    contents = {
        "Data": _data(tables),
        _LEFT_OUT.title: tables_of([_open(_LEFT_OUT)], tables),
        "Accuracy": _accuracy(tables, depths),
        "Models": tables_of(_MODELS, tables),
        "The Bottom": tables_of(_BOTTOM, tables),
        "Points": [*_stated(tables), *tables_of(_OF_POINTS, tables)],
    }
    chapters = chapters_of(contents)
    what = f"Points compiled in {counted(len(tables['models']), 'stereomodel')}."
    figures = _figures(tables, depths, places_of(chapters))
    page = page_of(tables, job["titles"] or ["Compilation"], what, figures, chapters)
    return replace(page, notes=[*page.notes, *tables["warnings"]])


def _depths(tables: Tables) -> DepthFigures:
    """Return the compiled points that have a depth, below the sounding datum."""
    points = part(tables, "points")
    depth = numbers(points, "datum_depth")
    known = np.isfinite(depth)
    return DepthFigures(
        ids=texts(points, "point")[known],
        depth=depth[known],
        sigma=numbers(points, "datum_depth_sigma")[known],
        covariance=numbers(points, "covariance", 3, 3)[known],
    )


def _figures(tables: Tables, depths: DepthFigures, places: Mapping[str, str]) -> Iterator[Fact]:
    points, parallaxes = tables["points"], [model["y_parallax"] for model in tables["models"]]
    count, missing = len(points["point"]), sum(reason is not None for reason in points["reason"])
    yield Fact("Points with coordinates", f"{count - missing:,} of {count:,}")
    if any(value is not None for value in parallaxes):
        values = ", ".join("" if value is None else number_text(1000.0 * value, 1) for value in parallaxes)
        yield Fact("RMS of y-parallaxes, by model", f"{values} µm")
    for row in tables["analysis"]:
        value = f"{number_text(row['rms'], 3)} m"
        yield Fact(f"RMS against the run, {row['component']}", value, link=anchor_of(_AGAINST))
    sigma, depth = depths.sigma[np.isfinite(depths.sigma)], depths.depth[np.isfinite(depths.depth)]
    if len(sigma) and len(depth):
        yield Fact(
            "Sigma of depths, median and largest",
            f"{np.median(sigma):.3f} and {sigma.max():.3f} m",
            detail=f"{counted(len(depth), 'point')}, {depth.min():z.2f} to {depth.max():z.2f} m below the datum",
            link=place_of(places, "Depths Of Bathymetric Points"),
        )
    yield from order_facts(depths, places)


def _data(tables: Tables) -> Iterator[Part]:
    job, points = part(tables, "job"), part(tables, "points")
    datum = "" if job["datum"] is None else f"{job['datum']}, "
    sigma = number_text(job["datum_sigma"], 3)
    wet = int(flags(points, "submerged", 1).sum())
    yield Facts(
        [
            Fact("Stereomodels", f"{len(tables['models']):,}"),
            Fact("Readings", f"{len(points['point']):,}", detail=f"{wet:,} flagged as submerged"),
            Fact("Coordinate system", str(job["system"])),
            Fact("Refractive index", number_text(job["index"], 6) or "none: straight rays"),
            Fact("Sounding datum", f"{datum}{number_text(job['datum_height'], 3)} m", detail=f"sigma {sigma} m"),
        ]
    )


def _stated(tables: Tables) -> Iterator[Part]:
    """Yield the points in the output coordinate system, where the run asks for one."""
    if stated := tables["stated"]:
        shown = partial(PageReport, listed=_POINTS, note=f"{stated['answer']['text']}.")
        yield from tables_of(map(shown, compilation_points.in_words(stated["answer"])), answered(tables, "points"))


def _accuracy(tables: Tables, depths: DepthFigures) -> Sequence[Part]:
    against = tables["analysis"]
    shown = [analysis_table(against, _AGAINST, "Point with Max. Difference", folded=False)] if against else []
    nothing = Sentences(texts=["No point of the run was read again, and no depth has a sigma."])
    return [*shown, *orders_table(depths)] or [nothing]
