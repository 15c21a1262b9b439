"""The page of a compilation (`musat as11 compile`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

import numpy as np

from musatpy.model import Grade
from musatpy.model.findings import GRADES
from musatpy.page.accuracy import Depths
from musatpy.page.analysis_tables import ORDERS, analysis_table, orders_table
from musatpy.page.cells import count_of, number_text
from musatpy.page.parts import Chapter, Fact, Facts, Page, Part, Reason, Texts
from musatpy.page.pictures import pictures_chapter
from musatpy.page.provenance import closing, provenance
from musatpy.page.stated import Shown, anchor_of, in_columns, rows_at, tables_of
from musatpy.page.stated_answer import stated_tables
from musatpy.page.summary import anchor_at, anchors
from musatpy.plots.gallery import COMPILED as PICTURES
from musatpy.plots.tables import Tables, flags, numbers, part, texts
from musatpy.reports import (
    compilation,
    compilation_bottom,
    compilation_points,
    compilation_profiles,
    reduction,
    run_comparison,
)
from musatpy.reports.answer import USE
from musatpy.reports.table import Report

_POINTS = 200  # rows
_AGAINST = "Comparison With The Run: In Numbers"
_LEFT_OUT: Report[Any] = Report(
    title="Points Without Coordinates",
    table=compilation_points.POINTS,
    which=lambda t: np.flatnonzero([reason is not None for reason in t["reason"]]),
    columns=("model", "point", compilation_points.POINTS.column("reason", "Reason", "A80")),
)
_LEFT = (Shown(report=_LEFT_OUT, folded=False),)
_MODELS = (
    *(
        Shown(report=report, folded=False)
        for report in (compilation.MODEL_TABLE, compilation.RECOVERED_TABLE, compilation.MOVED_TABLE)
    ),
    Shown(report=compilation.SHORE_TABLE),
    *(
        Shown(report=report)
        for report in (reduction.PLATES, reduction.MARKS, reduction.DISTANCES, reduction.SPREADS)
    ),
)
_BOTTOM = tuple(
    Shown(report=report, folded=False) for report in (*compilation_profiles.STATED, *compilation_bottom.STATED)
)
_OF_POINTS = (
    Shown(report=compilation_points.POINT_TABLE, listed=_POINTS),
    Shown(report=compilation_points.RAY_TABLE, listed=_POINTS),
    Shown(report=compilation_points.APPARENT_TABLE, listed=_POINTS),
    Shown(report=run_comparison.RUN_TABLE, listed=_POINTS),
)


def compilation_page(tables: Tables, files: Mapping[str, str]) -> Page:
    """Return the page of the record of a compilation; `files` as `run_page` has them."""
    pictures, tables = pictures_chapter(PICTURES, tables), in_columns(tables)
    depths = _depths(tables)
    contents = [
        ("Data", _data(tables)),
        (_LEFT_OUT.title, tables_of(_LEFT, tables)),
        ("Accuracy", _accuracy(tables, depths)),
        ("Models", tables_of(_MODELS, tables)),
        ("The Bottom", tables_of(_BOTTOM, tables)),
        ("Points", chain(stated_tables(tables, _POINTS), tables_of(_OF_POINTS, tables))),
    ]
    chapters = [Chapter(title=title, anchor=anchor_of(title), parts=list(parts)) for title, parts in contents]
    chapters.insert(3, pictures)
    job, reasons = part(tables, "job"), list(_reasons(tables, anchors(chapters)))
    titles = [" ".join(title.split()) for title in job.get("titles") or ()]
    grade = max((Grade(reason.grade) for reason in reasons), key=GRADES.index, default=Grade.ACCEPTED)
    return Page(
        title=titles[0] if titles else "Compilation",
        lines=[*titles[1:], f"Points compiled in {count_of(len(part(tables, 'models')['model']), 'stereomodel')}."],
        grade=grade,
        use=USE[grade],
        reasons=reasons,
        causes=(),
        notes=[*part(tables, "verdict").get("notes", ()), *(tables.get("warnings") or ())],
        figures=Facts(facts=list(_figures(tables, depths)), large=True),
        chapters=[*(chapter for chapter in chapters if chapter.parts), provenance(tables, files)],
        closing=closing(),
    )


def _reasons(tables: Tables, places: Mapping[str, str]) -> Iterator[Reason]:
    """Yield why a compilation is not accepted: the reasons of its verdict, and what records without one say."""
    verdict = part(tables, "verdict")
    reasons = verdict.get("reasons") or {}
    rows = list(rows_at(reasons, range(len(reasons.get("text", ())))))
    for row in rows:
        yield Reason(grade=row["grade"], text=row["text"], link=anchor_at(places, str(row["section"])))
    said = [*(row["text"] for row in rows), *verdict.get("notes", ())]
    caution = str(part(tables, "job").get("caution") or "")
    if caution and not any(text.startswith(caution) for text in said):
        yield Reason(grade=Grade.DOUBTFUL, text=caution)
    recovered = part(tables, "recovered")
    for model, fine in zip(recovered.get("model", ()), recovered.get("recovered", ()), strict=True):
        if fine is False and not any(text.startswith(f"model {model} is not recovered") for text in said):
            text = f"model {model}: points read again are off by more than the limit"
            yield Reason(grade=Grade.DOUBTFUL, text=text, link=anchor_of(compilation.RECOVERED_TABLE.title))


def _depths(tables: Tables) -> Depths:
    """Return the compiled points that have a depth, below the sounding datum."""
    points = part(tables, "points")
    depth = numbers(points, "datum_depth")
    known = np.isfinite(depth)
    nothing = np.full(int(known.sum()), np.nan)
    return Depths(
        ids=texts(points, "point")[known],
        depth=depth[known],
        sigma=numbers(points, "datum_depth_sigma")[known],
        straight=nothing,
        moved=nothing,
        covariance=numbers(points, "covariance", 3, 3)[known],
    )


def _figures(tables: Tables, depths: Depths) -> Iterator[Fact]:
    models, points = part(tables, "models"), part(tables, "points")
    count, missing = len(points["point"]), sum(reason is not None for reason in points["reason"])
    yield Fact(label="Points with coordinates", value=f"{count - missing:,} of {count:,}")
    parallax = numbers(models, "y_parallax")
    if np.isfinite(parallax).any():
        values = ", ".join(number_text(1000.0 * value, 1) for value in parallax)
        yield Fact(label="RMS of y-parallaxes, by model", value=f"{values} µm")
    for component, rms in zip(
        *(part(tables, "analysis").get(name, ()) for name in ("component", "rms")), strict=True
    ):
        yield Fact(
            label=f"RMS against the run, {component}", value=f"{number_text(rms, 3)} m", link=anchor_of(_AGAINST)
        )
    sigma = depths.sigma[np.isfinite(depths.sigma)]
    if len(sigma):
        span = f"{depths.depth.min():.2f} to {depths.depth.max():.2f} m below the datum"
        yield Fact(label="Sigma of depths, median", value=f"{np.median(sigma):.3f} m", detail=span)
    orders = orders_table(depths)
    if orders is not None:
        order, met, share = orders.rows[0]
        yield Fact(label=f"Meet S-44 {order}", value=f"{share} %", detail=f"{met} points", link=anchor_of(ORDERS))


def _data(tables: Tables) -> Iterator[Part]:
    job, points = part(tables, "job"), part(tables, "points")
    datum = "" if job["datum"] is None else f"{job['datum']}, "
    sigma = number_text(job["datum_sigma"], 3)
    wet = int(flags(points, "submerged", 1).sum())
    yield Facts(
        facts=[
            Fact(label="Stereomodels", value=f"{len(part(tables, 'models')['model']):,}"),
            Fact(label="Readings", value=f"{len(points['point']):,}", detail=f"{wet:,} flagged as submerged"),
            Fact(label="Coordinate system", value=str(job["system"])),
            Fact(label="Refractive index", value=number_text(job["index"], 6) or "none: straight rays"),
            Fact(
                label="Sounding datum",
                value=f"{datum}{number_text(job['datum_height'], 3)} m",
                detail=f"sigma {sigma} m",
            ),
        ]
    )


def _accuracy(tables: Tables, depths: Depths) -> Iterator[Part]:
    against = analysis_table(tables, "analysis", _AGAINST, "Point", folded=False)
    orders = orders_table(depths)
    yield from (table for table in (against, orders) if table is not None)
    if against is None and orders is None:
        yield Texts(texts=["No point of the run was read again, and no depth has a sigma."])
