"""The top of the page of a run: the verdict with its reasons and likely causes, and the numbers that count most."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from musatpy.model import Cause, CauseKind, Grade, Refraction
from musatpy.page.accuracy import CHECKS, CONTROL, ORDERS, SAMPLES, Depths, Samples, depths_of, samples
from musatpy.page.cells import count_of, number_text
from musatpy.page.page_tables import place_of, places_of, reasons_of
from musatpy.page.rendering import Chapter, Fact, Facts, Page
from musatpy.plots.tables import Tables, flags, part, texts
from musatpy.reports.answer import USE
from musatpy.reports.titles import REFRACTION
from musatpy.soundings.s44 import NO_ORDER
from musatpy.statistics.quality import FAR
from musatpy.units import MICROMETRE

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
        figures=Facts(facts=_figures(tables, places), large=True),
        chapters=chapters,
    )


def _what(tables: Tables) -> str:
    points = part(tables, "points")
    wet = int(flags(points, "bathymetric", 1).sum())
    photos = len(texts(part(tables, "stations"), "photo"))
    refraction = REFRACTION[Refraction(part(tables, "options")["refraction"])]
    return (
        f"{count_of(photos, 'photo')}, {count_of(len(points.get('point', ())), 'ground point')} "
        f"({wet:,} submerged), {count_of(_images(tables), 'image')}. Refraction: {refraction}."
    )


def _images(tables: Tables) -> int:
    """Return the number of plate measurements; of a record without them that of those with a residual."""
    plates = part(tables, "plates")
    if plates:
        return len(plates["photo"])
    return int(part(tables, "plate_statistics").get("total_count", [0])[-1])


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


def _figures(tables: Tables, places: Mapping[str, str]) -> list[Fact]:
    every, depths = samples(tables), depths_of(tables)
    facts = [_sigma0(tables, places), *_plates(tables, places)]
    facts += [_rms(every, what, places) for what in (CONTROL, CHECKS)]
    facts += [_depths(depths, places), *_s44(depths, places), *_hidden(tables, places), _blunders(tables, places)]
    return [fact for fact in facts if fact.value]


def _sigma0(tables: Tables, places: Mapping[str, str]) -> Fact:
    solution, test = part(tables, "solution"), part(tables, "tests").get("sigma0")
    detail = f"{solution.get('degrees_of_freedom', 0):,} degrees of freedom"
    if test and test["low"] is not None and part(tables, "options").get("plate_sigma_is") != "GUESS":
        low, high = (number_text(math.sqrt(test[name]), 3) for name in ("low", "high"))
        detail = f"by chance {low} to {high} (95 %)" + ("" if test["accepted"] else ": outside")
    value = number_text(solution.get("sigma0"), 4) or "not finite"
    return Fact(label="Sigma0", value=value, detail=detail, link=place_of(places, "Statistics: Sigma0"))


def _plates(tables: Tables, places: Mapping[str, str]) -> list[Fact]:
    statistics = part(tables, "plate_statistics")
    count, rms = (statistics.get(name, [0])[0] for name in ("total_count", "total_rms"))
    if not count:
        return []
    value = " and ".join(number_text(axis / MICROMETRE, 2) for axis in rms)
    detail = f"{count:,} images that took part"
    link = place_of(places, "Plate Residuals Of The Job")
    return [Fact(label="RMS of plate residuals, x and y", value=f"{value} µm", detail=detail, link=link)]


def _rms(every: Samples, what: str, places: Mapping[str, str]) -> Fact:
    statistics = {component: of for (points, component), of in every.items() if points == what}
    names = list(statistics)
    value = ", ".join(number_text(statistics[name].rms, 3) for name in names)
    sizes = sorted({statistics[name].size for name in names})
    least = f"{sizes[0]:,} to " if len(sizes) > 1 else ""
    return Fact(
        label=f"RMS of {'control residuals' if what == CONTROL else 'check points'}, {', '.join(names)}",
        value=f"{value} m" if value else "",
        detail=f"{least}{count_of(sizes[-1], 'point')} in each component" if sizes else "",
        link=place_of(places, SAMPLES),
    )


def _depths(depths: Depths, places: Mapping[str, str]) -> Fact:
    sigma, depth = depths.sigma[np.isfinite(depths.sigma)], depths.depth[np.isfinite(depths.depth)]
    if not len(sigma) or not len(depth):
        return Fact(label="", value="")
    return Fact(
        label="Sigma of depths, median",
        value=f"{np.median(sigma):.3f} m",
        detail=f"{count_of(len(depth), 'point')}, {depth.min():.2f} to {depth.max():.2f} m deep",
        link=place_of(places, "Depths Of Bathymetric Points"),
    )


def _s44(depths: Depths, places: Mapping[str, str]) -> list[Fact]:
    count = int(depths.ranked.sum())
    if not count:
        return []
    best = next((order for order, met in depths.shares() if met >= _ENOUGH * count), NO_ORDER)
    exclusive, met = depths.shares()[0]
    return [
        Fact(
            label="Order of S-44 that 95 % of the depths meet",
            value=best,
            detail=f"{exclusive}: {met:,} of {count:,} points",
            link=place_of(places, ORDERS),
        )
    ]


def _hidden(tables: Tables, places: Mapping[str, str]) -> list[Fact]:
    table: Any = part(tables, "tests").get("hidden_errors") or {}
    weak = table.get("weak", ())
    if not len(weak):
        return []
    return [
        Fact(
            label="Points weakly checked",
            value=f"{sum(weak):,} of {len(weak):,}",
            detail=f"an undetected error may move them by more than {FAR:.0f} sigmas",
            link=place_of(places, "Statistics: Points That Undetected"),
        )
    ]


def _blunders(tables: Tables, places: Mapping[str, str]) -> Fact:
    editing = part(tables, "options").get("editing", "NONE")
    actions = Counter(row["action"] for row in tables["findings"])
    if editing == "NONE":
        return Fact(label="Blunders", value="not looked for")
    detail = ", ".join(f"{action} {count}" for action, count in actions.items()) or "none were found"
    return Fact(
        label="Blunders",
        value=f"{sum(actions.values()):,}",
        detail=detail,
        link=place_of(places, "Blunders Found"),
    )
