"""The listing and the record of a comparison with soundings (`musat as11 compare-soundings`)."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from musatpy.reports.analyses import differences
from musatpy.reports.fields import Document, Each, Field, FieldGroup, Rows, flag, within
from musatpy.reports.pages import Section, labelled, print_titled, wrapped
from musatpy.reports.table import Report
from musatpy.soundings.differences import (
    OrderShare,
    Regression,
    Sample,
    likeness_warning,
    order_shares,
    regression,
    samples,
)
from musatpy.soundings.s44 import order_names, source

if TYPE_CHECKING:
    from musatpy.compilation.compiled import Compiled
    from musatpy.compilation.other_bottoms import Matching, Sounded

_LARGEST = 20  # blunders that are named


MATCHING: FieldGroup[Sounded, Matching] = FieldGroup(
    "matching", "how the soundings are held against the bottom", of=lambda s: s.how, fields=(
        Field("radius", "number?", "of points whose plane is the bottom; null: triangles",
              lambda m: _limit(m.radius), unit="m"),
        Field("datum", "number", "of the soundings below that of the bottom", unit="m"),
        Field("datum_sigma", "number", "of that", unit="m"),
        Field("sigma", "number", "of soundings whose file has none", unit="m"),
        Field("plan_sigma", "number", "of the places of soundings", unit="m"),
        Field("steepest", "number?", "slope that counts; null: any", lambda m: _limit(m.steepest)),
        Field("not_before", "string?", "first day that counts; null: any", lambda m: _first_day(m)),
    ),
)  # fmt: skip


def _limit(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _first_day(how: Matching) -> str | None:
    return how.not_before.isoformat() if how.not_before else None


SAMPLES: Each[Sounded, Sample] = Each(
    "samples", "compiled less sounded depths, in numbers", of=lambda s: samples(s.differences), fields=(
        Field("sample", "string", "which soundings, by sounded depth", "what", "Sample", "A16", is_id=True),
        *within(lambda p: p.statistics, differences("m", "sounding")),
        Field("median", "number?", "", heading="Median\nm", edit="F9.3"),
        Field("spread", "number?", "median absolute deviation times 1.4826", heading="NMAD\nm", edit="F9.3"),
    ),
)  # fmt: skip
REGRESSION: FieldGroup[Sounded, Regression] = FieldGroup(
    "regression", "difference = a + b depth without blunders; null for fewer than three depths",
    of=lambda s: regression(s.differences), optional=True, fields=(
        Field("a", "number", "tells of tide or datum", unit="m"),
        Field("a_sigma", "number", "of a", unit="m"),
        Field("b", "number", "tells of refraction"),
        Field("b_sigma", "number", "of b"),
        Field("correlation", "number", "of a and b"),
        Field("sigma0", "number", "of the differences over their sigmas"),
    ),
)  # fmt: skip
SHARES: Each[Sounded, OrderShare] = Each(
    "orders", "differences within the vertical uncertainty of the orders of S-44",
    of=lambda s: order_shares(s.differences), fields=(
        Field("order", "string", "of the survey", "name", "Order", "A10", is_id=True),
        Field("share", "number", "of the differences", heading="Within", edit="F7.3"),
        Field("met", "boolean", "95 % are within", heading="95 %", edit="A4", words={True: "met", False: "NO"}),
    ),
)  # fmt: skip
DIFFERENCES: Rows[Sounded, Sounded] = Rows(
    "differences", "one row per sounding that meets the bottom", (
        Field("sounding", "string", "its name, or line", "differences.names", "Sounding", "A16", is_id=True),
        Field("compiled", "number", "depth", "differences.compiled", "Compiled\nm", "F9.3"),
        Field("sounded", "number", "depth below the same datum", "differences.sounded", "Sounded\nm", "F9.3"),
        Field("difference", "number", "compiled less sounded", "differences.difference", "Difference\nm", "F9.3"),
        Field("sigma", "number", "of the difference", "differences.sigma", "Sigma\nm", "F9.3"),
        flag("blunder", "beyond 3.29 robust deviations", "Blunder", "*", "differences.blunders"),
        Field("place", "2 number", "east and north on the map of the first model, or raster", "xy", unit="m"),
    ),
)  # fmt: skip
LEFT_OUT: Rows[Sounded, Sounded] = Rows(
    "left_out", "soundings that do not meet the bottom", (
        Field("sounding", "string", "its name, or line", lambda s: s.soundings.names[list(s.reasons)], "Sounding",
              "A16", is_id=True),
        Field("reason", "string", "why", lambda s: list(s.reasons.values()), "Reason", "A60"),
    ),
)  # fmt: skip
POINT_ORDERS: Field[Compiled | None] = Field(
    "point_orders", "map", "compiled points by the order of S-44 that their sigmas meet; none of a raster",
    lambda c: {} if c is None else point_orders(c),
)  # fmt: skip

SAMPLE_TABLE = Report(
    "Comparison With Soundings: Compiled Less Sounded Depths",
    SAMPLES,
    "sample size sum mean rms deviation median spread maximum maximum_id",
)
SHARE_TABLE = Report("Orders Of S-44 Met By The Differences", SHARES)
STATED = (SAMPLE_TABLE, SHARE_TABLE)
DOCUMENT: Document[Sounded] = Document(
    name="soundings_version",
    version="2.1",
    title="musatpy soundings",
    about="Compiled less sounded depths, metres. A number that does not exist is null",
    nodes=(MATCHING, SAMPLES, REGRESSION, SHARES, DIFFERENCES, LEFT_OUT, POINT_ORDERS),
)


def point_orders(compiled: Compiled) -> dict[str, int]:
    """Return how many submerged points meet each order by their own sigmas, as the strictest."""
    return {name: int(np.count_nonzero(compiled.orders == name)) for name in order_names()}


def sections_of(compared: Sounded, compiled: Compiled | None) -> list[Section]:
    """Return what the listing says, section by section; `compiled` is None for a raster."""
    line, warning = regression(compared.differences), likeness_warning(compared.differences)
    blunders = compared.differences[compared.differences.blunders]
    rows = zip(blunders.names, blunders.compiled, blunders.sounded, strict=True)
    named = [f"{name}: compiled {of:.2f} m, sounded {read:.2f} m" for name, of, read in rows]
    more = [f"and {len(named) - _LARGEST} more"] if len(named) > _LARGEST else []
    lost = Counter(reason.capitalize() for reason in compared.reasons.values())
    how = _matching(compared.how, is_raster=compiled is None)
    met = ["Not known: a raster has no sigmas of places."]
    if compiled is not None:
        met = labelled({name: f"{count} points" for name, count in point_orders(compiled).items()})
    parts: list[Section | None] = [
        Section(title="Warning", lines=wrapped([f"{warning}."])) if warning else None,
        Section(title="How The Soundings Are Held Against The Bottom", lines=labelled(how)),
        SAMPLE_TABLE.section(compared),
        None if line is None else _regression(line),
        SHARE_TABLE.section(compared),
        Section(title="Orders Of S-44 Met By The Sigmas Of The Points", lines=[*met, "", f"{source()}."]),
        Section(title="Blunders", lines=wrapped([*named[:_LARGEST], *more])),
        Section(
            title="Soundings That Do Not Meet The Bottom",
            lines=labelled({reason: f"{count} soundings" for reason, count in lost.items()}),
        ),
    ]
    return [part for part in parts if part and part.lines]


def _regression(line: Regression) -> Section:
    lines = {
        "a, m (tide, datum)": f"{line.a:.4f}, sigma {line.a_sigma:.4f}",
        "b (refraction)": f"{line.b:.5f}, sigma {line.b_sigma:.5f}",
        "Correlation of a and b": f"{line.correlation:.3f}",
        "Sigma0": f"{line.sigma0:.3f}",
    }
    return Section(title="Regression: Difference = a + b Depth", lines=labelled(lines))


def _matching(how: Matching, is_raster: bool) -> dict[str, str]:
    """Return in words how soundings are held against a bottom."""
    planes = f"planes of points within {how.radius:g} m" if np.isfinite(how.radius) else "triangles"
    return {
        "Bottom": "posts of a raster" if is_raster else planes,
        "Datum of the soundings below the bottom's, m": f"{how.datum:.3f}, sigma {how.datum_sigma:.3f}",
        "Sigma of depths without one, m": f"{how.sigma:.3f}",
        "Sigma of places, m": f"{how.plan_sigma:.2f}",
        "Steepest slope": f"{how.steepest:g}" if np.isfinite(how.steepest) else "any",
        "First day": _first_day(how) or "any",
    }


def listing_of(compared: Sounded, compiled: Compiled | None, title: str, caution: str) -> str:
    """Return the listing of a comparison, on pages of 60 lines of 132 columns, `caution` on each."""
    return print_titled("SOUNDINGS", title, sections_of(compared, compiled), caution)
