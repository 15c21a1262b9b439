"""What the stations and points of a record say of the flight: height, scale, area, overlap, times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.page.cells import number_text, size_text
from musatpy.page.parts import Fact, Head, PageTable
from musatpy.page.stated import anchor_of
from musatpy.plots.plane import plane_of
from musatpy.plots.tables import NothingToShowError, Tables, numbers, part, rows_of, texts
from musatpy.units import MICROMETRE

_KILOMETRE2 = 1e6  # m2
_WAYS = [[np.cos(angle), np.sin(angle)] for angle in np.arange(16) * np.pi / 8.0]
RAYS_TITLE = "Rays To Ground Points"


def flight_facts(tables: Tables) -> Iterator[Fact]:
    """Yield height, scale and area of a block, as far as its stations and points have places."""
    try:
        plane = plane_of(tables)
    except NothingToShowError:
        return
    stations = part(tables, "stations")
    flown = plane.places(numbers(stations, "position", 3))
    ground = plane.places(numbers(part(tables, "points"), "position", 3))
    ground, flown = (places[np.isfinite(places).all(axis=1)] for places in (ground, flown))
    if not len(ground) or not len(flown):
        return
    level, height = float(np.median(ground[:, 2])), float(np.median(flown[:, 2]))
    yield Fact(
        label="Flying height over the ground",
        value=f"{number_text(height - level, 0)} m",
        detail=f"stations {flown[:, 2].min():.0f} to {flown[:, 2].max():.0f} m, points typically at {level:.1f} m",
    )
    yield from _scale(tables, height - level)
    area = hull_area(ground[:, :2])
    if area:
        size = f"{size_text(area / _KILOMETRE2)} km²" if area > 0.1 * _KILOMETRE2 else f"{area:.0f} m²"
        yield Fact(label="Area", value=size, detail="hull of the ground points")


def _scale(tables: Tables, height: float) -> Iterator[Fact]:
    cameras, stations = part(tables, "cameras"), part(tables, "stations")
    known = numbers(cameras, "focal_length")
    if not len(known) or height <= 0.0:
        return
    focal_length = known[rows_of(texts(cameras, "camera"), texts(stations, "camera"))]
    scale = 1000.0 * height / float(np.median(focal_length))
    sigma = float(part(tables, "options")["plate_sigma"])
    rounded = round(scale, 1 - len(f"{scale:.0f}") + 2)
    detail = f"{sigma / MICROMETRE:g} µm, the sigma of plate coordinates, are {sigma * scale / 1000.0:.3f} m there"
    yield Fact(label="Scale of the photos", value=f"1 : {rounded:,.0f}", detail=detail)


def hull_area(places: FloatArray) -> float:
    """Return the area (m2) of the convex hull of places (n, 2); 0 of a line.

    By Andrew's monotone chain, of what may lie on the hull: scipy's would have to be loaded, for this alone.
    """
    if len(places) < 3:
        return 0.0
    places = places - places.mean(axis=0)
    extreme = places[np.unique([(places @ way).argmax() for way in _WAYS])]
    extreme = extreme[np.argsort(np.arctan2(*(extreme - extreme.mean(axis=0)).T[::-1]))]
    edge = np.roll(extreme, -1, axis=0) - extreme
    side = edge[:, 0] * (places[:, 1, None] - extreme[:, 1]) - edge[:, 1] * (places[:, 0, None] - extreme[:, 0])
    outer = np.unique(np.concatenate([places[(side < 0.0).any(axis=1)], extreme]), axis=0).tolist()
    ring = np.array([*_chain(outer), *_chain(outer[::-1])]).reshape(-1, 2)
    x, y = ring.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _chain(places: list[list[float]]) -> list[list[float]]:
    """Return the side of a hull that has sorted places at its left, without its last place."""
    kept: list[list[float]] = []
    for x, y in places:
        while len(kept) > 1:
            (x1, y1), (x2, y2) = kept[-2:]
            if (x2 - x1) * (y - y1) - (y2 - y1) * (x - x1) > 0.0:
                break
            kept.pop()
        kept.append([x, y])
    return kept[:-1]


def times_fact(tables: Tables) -> Iterator[Fact]:
    """Yield when the photos were taken, as far as the deck says it."""
    stations = part(tables, "stations")
    time, days = numbers(stations, "time"), sorted({str(day) for day in stations.get("tide_day", ()) if day})
    known = time[np.isfinite(time)]
    if len(known):
        span = f"{known.min():.1f} to {known.max():.1f} s"
        detail = f"on the clock of the deck, {(known.max() - known.min()) / 60.0:.1f} minutes"
        yield Fact(label="Exposures", value=span, detail=detail)
    if days:
        shown = ", ".join(days[:4]) + (f" and {len(days) - 4} more" if len(days) > 4 else "")
        yield Fact(label="Days of exposure", value=shown)
    tide = numbers(part(tables, "adjusted_water"), "tide")
    tide = tide[np.isfinite(tide)]
    if len(tide):
        span = f"{tide.min():.3f} to {tide.max():.3f} m"
        yield Fact(label="Water levels at the exposures", value=span if np.ptp(tide) else f"{tide[0]:.3f} m")


def rays_table(tables: Tables) -> PageTable | None:
    """Return how many points are measured on how many photos, dry and submerged; None without points."""
    points = part(tables, "points")
    wet = Counter(zip(points.get("rays", ()), points.get("bathymetric", ()), strict=True))
    rays = sorted({number for number, _ in wet})
    if not rays:
        return None
    return PageTable(
        title=RAYS_TITLE,
        anchor=anchor_of(RAYS_TITLE),
        heads=[Head(text="Rays", is_id=True), Head(text="Dry points"), Head(text="Submerged points")],
        rows=[[str(n), f"{wet[n, False]:,}", f"{wet[n, True]:,}"] for n in rays],
        total=len(rays),
        note="Plate measurements from which the position of a point comes.",
        folded=len(rays) > 8,
    )
