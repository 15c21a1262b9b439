"""The page of a comparison with soundings (`musat as11 compare-soundings`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from musatpy.errors import MusatError
from musatpy.model import Grade
from musatpy.page.page_tables import PageReport, chapters_of, number_text, tables_of
from musatpy.page.rendering import Fact, Facts, Page, Part, anchor_of
from musatpy.plots.compiled_pictures import differences_of
from musatpy.plots.picture import NothingToShowError, counted
from musatpy.records.tables import Tables
from musatpy.reports import soundings
from musatpy.reports.answer import USE
from musatpy.reports.table import Report
from musatpy.soundings.differences import DepthDifferences, likeness_warning, order_shares
from musatpy.soundings.s44 import source

COMPARED = "COMPARED"
_LISTED = 200  # rows
_NO_LIMIT = "any"
_WITHOUT = "without blunders"  # a row of the samples
_ACCURACY = (
    PageReport(
        soundings.SAMPLE_TABLE,
        folded=False,
        note="Bands of sounded depth are without blunders; NMAD: median absolute deviation times 1.4826.",
    ),
    PageReport(
        soundings.SHARE_TABLE,
        folded=False,
        note=f"Share of the differences within the vertical uncertainty of an order. {source()}.",
    ),
)
_DIFFERENCES = Report(
    "Differences",
    soundings.DIFFERENCES,
    "sounding compiled sounded difference sigma blunder",
    worst=lambda t: np.abs(t["difference"]),
)
_LEFT_OUT = Report("Soundings That Do Not Meet The Bottom", soundings.LEFT_OUT, "sounding reason")
_SOUNDINGS = (
    PageReport(_DIFFERENCES, _LISTED, note="* beyond 3.29 robust deviations from the median."),
    PageReport(_LEFT_OUT, _LISTED),
)


def soundings_page(tables: Tables) -> Page:
    """Return the page of the record of a comparison with soundings.

    Raises `MusatError` where no sounding meets the bottom.
    """
    try:
        differences = differences_of(tables)
    except NothingToShowError as error:
        raise MusatError(f"the record has nothing to show: {error}") from error
    warning = likeness_warning(differences)
    contents = {
        "Accuracy": tables_of(_ACCURACY, tables),
        "Regression": _regression(tables["regression"]),
        "Soundings": tables_of(_SOUNDINGS, tables),
        "How They Were Compared": _matching(tables["matching"], tables["point_orders"]),
    }
    return Page(
        title="Comparison With Soundings",
        lines=["Compiled less sounded depths: positive where the compiled bottom is deeper."],
        grade=Grade.DOUBTFUL if warning else COMPARED,
        use=USE[Grade.DOUBTFUL] if warning else _order_met(differences),
        reasons=[Fact(Grade.DOUBTFUL, warning)] if warning else (),
        figures=Facts(list(_figures(tables)), large=True),
        chapters=chapters_of(contents),
    )


def _order_met(differences: DepthDifferences) -> str:
    """Return the strictest order that the differences meet, in words."""
    met = [order.name for order in order_shares(differences) if order.met]
    return f"95 % of the differences are within {f'S-44 {met[0]}' if met else 'no order of S-44'}"


def _figures(tables: Tables) -> Iterator[Fact]:
    met, missed = (len(tables[name]["sounding"]) for name in ("differences", "left_out"))
    yield Fact("Soundings that meet the bottom", f"{met:,} of {met + missed:,}")
    blunders = int(np.sum(tables["differences"]["blunder"]))
    yield Fact("Blunders among them", f"{blunders:,}", detail="beyond 3.29 robust deviations")
    sample = next(row for row in tables["samples"] if row["sample"] == _WITHOUT)
    link = anchor_of(soundings.SAMPLE_TABLE.title)
    for label, name in (("Median difference", "median"), ("RMS of differences", "rms"), ("NMAD", "spread")):
        yield Fact(label, f"{number_text(sample[name], 3)} m", detail=_WITHOUT, link=link)


def _regression(line: Mapping[str, float] | None) -> Iterator[Part]:
    if line is not None:
        a, a_sigma = (number_text(line[name], 4) for name in ("a", "a_sigma"))
        b, b_sigma = (number_text(line[name], 5) for name in ("b", "b_sigma"))
        yield Facts(
            [
                Fact("a: tide, datum", f"{a} m", f"sigma {a_sigma} m"),
                Fact("b: refraction", b, f"of the depth, sigma {b_sigma}"),
                Fact("Correlation of a and b", number_text(line["correlation"], 3)),
                Fact("Sigma0", number_text(line["sigma0"], 3)),
            ]
        )


def _matching(how: Mapping[str, Any], orders: Mapping[str, int]) -> Iterator[Part]:
    radius, steepest = how["radius"], how["steepest"]
    of_points = "triangles" if radius is None else f"planes of points within {radius:g} m"
    datum, datum_sigma, sigma = (number_text(how[name], 3) for name in ("datum", "datum_sigma", "sigma"))
    yield Facts(
        [
            Fact("Bottom", of_points if orders else "posts of a raster"),
            Fact("Datum of the soundings below the bottom's", f"{datum} m", f"sigma {datum_sigma} m"),
            Fact("Sigma of depths without one", f"{sigma} m"),
            Fact("Sigma of places", f"{number_text(how['plan_sigma'], 2)} m"),
            Fact("Steepest slope", _NO_LIMIT if steepest is None else f"{steepest:g}"),
            Fact("First day", str(how["not_before"] or _NO_LIMIT)),
            *(Fact(f"Points whose sigmas meet {name}", counted(count, "point")) for name, count in orders.items()),
        ]
    )
