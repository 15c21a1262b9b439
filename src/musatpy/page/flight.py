"""What the stations and points of a record say of the flight: height, scale, area, overlap, times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.page.cells import number_text, size_text
from musatpy.page.page_tables import page_table
from musatpy.page.rendering import Fact, PageTable
from musatpy.plots.picture import NothingToShowError
from musatpy.plots.plane import plane_of
from musatpy.records.tables import Tables, numbers, part, rows_of, texts
from musatpy.units import MICROMETRE

_KILOMETRE2 = 1e6  # m2


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
        "Flying height over the ground",
        f"{number_text(height - level, 0)} m",
        detail=f"stations {flown[:, 2].min():.0f} to {flown[:, 2].max():.0f} m, points typically at {level:z.1f} m",
    )
    yield from _scale(tables, height - level)
    area = hull_area(ground[:, :2])
    if area:
        size = f"{size_text(area / _KILOMETRE2)} km²" if area > 0.1 * _KILOMETRE2 else f"{area:.0f} m²"
        yield Fact("Area", size, detail="hull of the ground points")


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
    yield Fact("Scale of the photos", f"1 : {rounded:,.0f}", detail=detail)


def hull_area(places: FloatArray) -> float:
    """Return the area (m2) of the convex hull of places (n, 2), which their triangles fill; 0 of a line."""
    from matplotlib.tri import Triangulation  # loaded for the pictures; scipy's hull is a quarter of all loading

    try:
        corners = places[Triangulation(*(places - places.mean(axis=0)).T).triangles]
    except (RuntimeError, ValueError):  # fewer than three points, or all on a line
        return 0.0
    (x1, y1), (x2, y2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return float(0.5 * np.abs(x1 * y2 - x2 * y1).sum())


def times_fact(tables: Tables) -> Iterator[Fact]:
    """Yield when the photos were taken, as far as the deck says it."""
    stations = part(tables, "stations")
    time, days = numbers(stations, "time"), sorted({str(day) for day in stations.get("tide_day", ()) if day})
    known = time[np.isfinite(time)]
    if len(known):
        span = f"{known.min():z.1f} to {known.max():z.1f} s"
        detail = f"on the clock of the deck, {(known.max() - known.min()) / 60.0:.1f} minutes"
        yield Fact("Exposures", span, detail=detail)
    if days:
        shown = ", ".join(days[:4]) + (f" and {len(days) - 4} more" if len(days) > 4 else "")
        yield Fact("Days of exposure", shown)
    tide = numbers(part(tables, "adjusted_water"), "tide")
    tide = tide[np.isfinite(tide)]
    if len(tide):
        span = f"{tide.min():z.3f} to {tide.max():z.3f} m"
        yield Fact("Water levels at the exposures", span if np.ptp(tide) else f"{tide[0]:z.3f} m")


def rays_table(tables: Tables) -> Iterator[PageTable]:
    """Yield how many points are measured on how many photos, dry and submerged, where there are points."""
    points = part(tables, "points")
    wet = Counter(zip(points["rays"], points["bathymetric"], strict=True))
    rays = sorted({number for number, _ in wet})
    if rays:
        yield page_table(
            "Rays To Ground Points",
            [
                ("Rays", "I4", rays),
                ("Dry points", "I8", [f"{wet[n, False]:,}" for n in rays]),
                ("Submerged points", "I8", [f"{wet[n, True]:,}" for n in rays]),
            ],
            note="Plate measurements from which the position of a point comes.",
            folded=len(rays) > 8,
        )
