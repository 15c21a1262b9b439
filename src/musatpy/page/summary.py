"""The top of the page of a run: the verdict with its reasons and likely causes, and the numbers that count most."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from musatpy.model import Cause, CauseKind, Grade, Refraction
from musatpy.page.accuracy import ORDERS, Depths, depths_of
from musatpy.page.cells import cell_text, count_of
from musatpy.page.page_tables import place_of, places_of, reasons_of
from musatpy.page.rendering import Chapter, Fact, Facts, Page
from musatpy.plots.tables import Tables, part
from musatpy.reports.answer import USE
from musatpy.reports.headline import headline
from musatpy.reports.titles import REFRACTION
from musatpy.soundings.s44 import NO_ORDER

_CAUSES = 5
_ENOUGH = 0.95  # share of the points that meet an order, from which on it is that of the run


def top_of(tables: Tables, chapters: Sequence[Chapter]) -> Page:
    """Return the page of a run with these chapters, in which its reasons find what they are about."""
    verdict, places = tables["verdict"], places_of(chapters)
    titles = [" ".join(title.split()) for title in tables["titles"]]
    return Page(
        title=titles[0] if titles else "Aerotriangulation",
        lines=[*titles[1:], f"MUSAT-{tables['options']['program']} aerotriangulation. {_what(tables)}"],
        grade=verdict["grade"],
        use=USE[Grade(verdict["grade"])],
        reasons=reasons_of(tables, places),
        causes=_causes(tables["causes"][:_CAUSES]) if verdict["reasons"] else (),
        notes=verdict["notes"],
        figures=Facts(facts=list(_figures(tables, places)), large=True),
        chapters=chapters,
    )


def _what(tables: Tables) -> str:
    points, wet, photos = (
        tables["points"]["point"],
        sum(tables["points"]["bathymetric"]),
        tables["stations"]["photo"],
    )
    images = part(tables, "plates").get("photo")  # a record may be without them
    count = tables["plate_statistics"]["total_count"][-1] if images is None else len(images)
    refraction = REFRACTION[Refraction(tables["options"]["refraction"])]
    return (
        f"{count_of(len(photos), 'photo')}, {count_of(len(points), 'ground point')} ({wet:,} submerged), "
        f"{count_of(count, 'image')}. Refraction: {refraction}."
    )


def _causes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return likely causes in words; of one group those after the first begin with `or`."""
    sentences, groups = [], set()
    for row in rows:
        lead = "or: " if row["group"] in groups else ""
        groups.add(row["group"])
        cause = Cause(
            kind=CauseKind(row["cause"]),
            cards=tuple(row["cards"]),
            photos=tuple(row["photos"]),
            points=tuple(row["points"]),
            component=row["component"],
            size=tuple(math.nan if value is None else value for value in row["size"]),
            unit=row["unit"],
            advice=row["advice"],
        )
        sentences.append(f"{lead}{cause}")
    return sentences


def _figures(tables: Tables, places: Mapping[str, str]) -> Iterator[Fact]:
    """Yield the figures of page 1 of the listing, and those of the depths."""
    for figure in headline(tables, cell_text):
        value, detail = figure.value.replace(" um", " µm"), figure.detail.lstrip(",: ")
        yield Fact(label=figure.label, value=value, detail=detail, link=place_of(places, figure.section))
    depths = depths_of(tables)
    yield from _depths(depths, places)
    yield from _s44(depths, places)


def _depths(depths: Depths, places: Mapping[str, str]) -> Iterator[Fact]:
    sigma, depth = depths.sigma[np.isfinite(depths.sigma)], depths.depth[np.isfinite(depths.depth)]
    if len(sigma) and len(depth):
        yield Fact(
            label="Sigma of depths, median",
            value=f"{np.median(sigma):.3f} m",
            detail=f"{count_of(len(depth), 'point')}, {depth.min():.2f} to {depth.max():.2f} m deep",
            link=place_of(places, "Depths Of Bathymetric Points"),
        )


def _s44(depths: Depths, places: Mapping[str, str]) -> Iterator[Fact]:
    count, shares = int(depths.ranked.sum()), depths.shares()
    if count:
        yield Fact(
            label="Order of S-44 that 95 % of the depths meet",
            value=next((order for order, met in shares if met >= _ENOUGH * count), NO_ORDER),
            detail=f"{shares[0][0]}: {shares[0][1]:,} of {count:,} points",
            link=place_of(places, ORDERS),
        )
