"""The block in plan: stations, footprints, points, control, what moved and how well points are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray, at_rows, rows_of
from musatpy.figures import CONTROL, DRY, GREY, INK, WET
from musatpy.plots import maps
from musatpy.plots.picture import Picture, counted, measure
from musatpy.plots.plane import MapPlane, ground_of, outlines, plane_of, turned
from musatpy.records.tables import Tables, flags, numbers, part, texts

CONTROL_MARKERS = {"full": "^", "horizontal": "s", "vertical": "D", "check": "P"}  # kind of control -> marker


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPlan:
    """What the plan of a block shows, on its plane, m."""

    plane: MapPlane
    photos: TextArray  # (n,)
    stations: FloatArray  # (n, 2)
    outlines: FloatArray  # (n, 4, 2)
    ids: TextArray  # (p,) of points
    points: FloatArray  # (p, 2)
    submerged: BoolArray  # (p,)
    axes: FloatArray  # (p, 2) of the ellipses of 95 %
    angle: FloatArray  # (p,) rad, from x
    control: TextArray  # (c,) ids
    kind: TextArray  # (c,)
    control_places: FloatArray  # (c, 2)
    discrepancy: FloatArray  # (c, 2) adjusted minus given; NaN where a horizontal component is not known

    @property
    def checks(self) -> BoolArray:
        """(c,) of control that took no part."""
        return self.kind == "check"


def block_plan(tables: Tables) -> BlockPlan:
    """Return the plan of a block. Raises `NothingToShowError` without stations."""
    plane, stations, points = plane_of(tables), part(tables, "stations"), part(tables, "points")
    position = numbers(points, "position", 3)
    places, turns = plane.places(position), plane.turns(position)
    axes, angle = maps.confidence_ellipses(numbers(points, "covariance", 3, 3), turns)
    control = part(tables, "control")
    ids, known = texts(points, "point"), texts(control, "point")
    row = rows_of(ids, known)
    return BlockPlan(
        plane=plane,
        photos=texts(stations, "photo"),
        stations=plane.places(numbers(stations, "position", 3))[:, :2],
        outlines=outlines(tables, plane, ground_of(places)),
        ids=ids,
        points=places[:, :2],
        submerged=flags(points, "bathymetric"),
        axes=axes,
        angle=angle,
        control=known,
        kind=texts(control, "kind"),
        control_places=at_rows(places, row)[:, :2],
        discrepancy=turned(numbers(control, "difference", 3)[:, :2], np.nan_to_num(at_rows(turns, row))),
    )


def sentence(plan: BlockPlan) -> str:
    """Return what the plan says."""
    wet, checks = int(plan.submerged.sum()), int(plan.checks.sum())
    control = counted(len(plan.control) - checks, "control point")
    facts = [
        f"{counted(len(plan.photos), 'photo')}, {counted(len(plan.ids), 'point')}, {wet:,} of them submerged, "
        f"{control} and {counted(checks, 'check point')}"
    ]
    longer = plan.axes[:, 0]
    if np.isfinite(longer).any():
        worst = int(np.nanargmax(longer))
        facts.append(
            f"the 95 % ellipse of a typical point has a semi-axis of {measure(np.nanmedian(longer), 'm')}, the "
            f"largest {measure(longer[worst], 'm')} (point {plan.ids[worst]})"
        )
    for name, rows in (("control", ~plan.checks), ("check points", plan.checks)):
        size = np.linalg.norm(plan.discrepancy[rows], axis=1)
        if np.isfinite(size).any():
            worst = int(np.nanargmax(size))
            facts.append(
                f"largest discrepancy of {name} in plan {measure(size[worst], 'm')} at {plan.control[rows][worst]}"
            )
    return "; ".join(facts) + "."


def figure(plan: BlockPlan) -> Any:
    """Return the figure of a plan. Raises `MusatError` where matplotlib is missing."""
    core = np.concatenate([plan.stations, plan.outlines.reshape(-1, 2)])
    bounds, seen = maps.view_of(core, plan.points, keys=True)
    figure, (axes,) = maps.new_maps(bounds, plan.plane, "Block plan")
    maps.draw_outlines(axes, plan.outlines)
    marker = maps.dot_size(bounds, int(seen.sum()))
    axes.plot(*plan.stations.T, "o", color=INK, markerfacecolor="white", markersize=1.3 * marker, label="stations")
    for wet, sign, shade, label in ((False, ".", DRY, "dry point"), (True, "x", WET, "submerged point")):
        rows = seen & (plan.submerged == wet)
        if rows.any():
            label = counted(int(rows.sum()), label)
            axes.plot(*plan.points[rows].T, sign, color=shade, markersize=marker, label=label)
    _draw_ellipses(axes, plan, seen)
    for kind, sign in CONTROL_MARKERS.items():
        rows = plan.kind == kind
        if rows.any():
            label = counted(int(rows.sum()), *(["check point"] if kind == "check" else [f"{kind} control"] * 2))
            axes.plot(
                *plan.control_places[rows].T, sign, color=CONTROL, fillstyle="none", markersize=8, label=label
            )
    maps.add_arrows(axes, plan.control_places, plan.discrepancy, "control, adjusted minus given", color=CONTROL)
    taken = maps.name_places(axes, plan.control_places, plan.control, color=CONTROL)
    maps.name_places(axes, plan.stations, plan.photos, taken=taken)
    if outside := int((~seen).sum()):
        axes.plot([], [], " ", label=f"{counted(outside, 'point')} outside, or without a place")
    return figure


def _draw_ellipses(axes: Any, plan: BlockPlan, seen: BoolArray) -> None:
    """Draw ellipses nine in ten of which are within a fifth of the distance of points, and one of a round size."""
    from matplotlib.collections import EllipseCollection

    known = np.flatnonzero(seen & np.isfinite(plan.axes).all(axis=1))
    rows = known[maps.largest_of_cells(plan.points[known], plan.axes[known, 0], maps.MOST_ARROWS)]
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    factor = maps.magnification(plan.axes[rows, 0], maps.spacing(np.array([east - west, north - south]), len(rows)))
    if not factor:
        return
    radius = maps.round_length(0.02 * (east - west) / factor)
    place = np.array([west + 0.4 * (east - west), south + 0.035 * (north - south)])
    size = 2.0 * factor * np.concatenate([plan.axes[rows], [[radius, radius]]])
    drawn = EllipseCollection(
        size[:, 0], size[:, 1], np.degrees(np.append(plan.angle[rows], 0.0)), units="xy", linewidths=0.7,
        zorder=2.5, facecolors="none", edgecolors=GREY, offsets=np.concatenate([plan.points[rows], [place]]),
        offset_transform=axes.transData,
    )  # fmt: skip
    axes.add_collection(drawn, autolim=False)
    axes.annotate(f"{radius:g} m", place, (14, -3), textcoords="offset points")
    of = ", the largest of each cell" if len(rows) < len(known) else ""
    axes.plot([], [], "o", color=GREY, fillstyle="none", markersize=7, label=f"ellipses of 95 %{of}")


PLAN = Picture("plan", "Block plan", (*maps.MAPS_NEED, "plates", "control"), block_plan, figure, sentence)
