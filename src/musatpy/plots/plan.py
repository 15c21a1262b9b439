"""The block in plan: stations, footprints, points, control, what moved and how well points are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.plots.ellipses import ellipses, magnification, round_length, turned
from musatpy.plots.footprints import outlines
from musatpy.plots.mapping import GREY, INK, LIGHT, finish, name_places, new_map, view_of
from musatpy.plots.picture import Picture
from musatpy.plots.plane import Plane, plane_of
from musatpy.plots.tables import Tables, flags, numbers, part, rows_of, texts

_SHOWN = 0.02  # of the extent: what most ellipses and arrows are drawn as
CONTROL_MARKERS = {"full": "^", "horizontal": "s", "vertical": "D", "check": "P"}  # kind of control -> marker


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPlan:
    """What the plan of a block shows, on its plane, m."""

    plane: Plane
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
    R = np.stack([turned(np.tile(axis, (len(turns), 1)), turns) for axis in np.eye(2)], axis=2)
    covariance = R @ numbers(points, "covariance", 3, 3)[:, :2, :2] @ np.swapaxes(R, 1, 2)
    axes, angle = ellipses(covariance)
    control = part(tables, "control")
    ids, known = texts(points, "point"), texts(control, "point")
    row = rows_of(ids, known)
    return BlockPlan(
        plane=plane,
        photos=texts(stations, "photo"),
        stations=plane.places(numbers(stations, "position", 3))[:, :2],
        outlines=outlines(tables, plane, ground_of(tables, places)),
        ids=ids,
        points=places[:, :2],
        submerged=flags(points, "bathymetric"),
        axes=axes,
        angle=angle,
        control=known,
        kind=texts(control, "kind"),
        control_places=places[row, :2],
        discrepancy=turned(numbers(control, "difference", 3)[:, :2], turns[row]),
    )


def ground_of(tables: Tables, places: FloatArray) -> float:
    """Return the height on which most points stand, 0 where none has a place."""
    heights = places[np.isfinite(places).all(axis=1), 2]
    return float(np.median(heights)) if len(heights) else 0.0


def sentence(plan: BlockPlan) -> str:
    """Return what the plan says."""
    wet, checks = int(plan.submerged.sum()), int(plan.checks.sum())
    known = np.isfinite(plan.axes).all(axis=1)
    text = (
        f"{len(plan.photos)} photos, {len(plan.ids)} points, {wet} of them submerged, "
        f"{len(plan.control) - checks} control points and {checks} check points"
    )
    if known.any():
        larger = plan.axes[known, 0]
        text += f"; the 95 % ellipse of the typical point has a semi-axis of {np.median(larger):.3g} m"
        text += f", the largest {larger.max():.3g} m (point {plan.ids[known][larger.argmax()]})"
    for name, rows in (("control", ~plan.checks), ("check points", plan.checks)):
        size = np.linalg.norm(plan.discrepancy[rows], axis=1)
        if np.isfinite(size).any():
            worst = int(np.nanargmax(size))
            text += f"; {name}: largest discrepancy in plan {size[worst]:.3g} m at {plan.control[rows][worst]}"
    return text + "."


def figure(plan: BlockPlan) -> Any:
    """Return the figure of a plan. Raises `MusatError` where matplotlib is missing."""
    core = np.concatenate([plan.stations, plan.outlines.reshape(-1, 2)])
    bounds, seen = view_of(core, plan.points)
    drawing, axes = new_map(bounds, plan.plane, "Block plan")
    shown = _SHOWN * float((bounds[1] - bounds[0]).max())
    _draw_outlines(axes, plan.outlines)
    axes.plot(*plan.stations.T, "o", color=INK, markerfacecolor="white", markersize=5, label="exposure stations")
    name_places(axes, plan.stations, plan.photos, color=INK)
    for rows, marker, shade, label in (
        (seen & ~plan.submerged, ".", "#b8860b", "dry points"),
        (seen & plan.submerged, "x", "#00457c", "submerged points"),
    ):
        if rows.any():
            axes.plot(*plan.points[rows].T, marker, color=shade, markersize=4, label=f"{rows.sum()} {label}")
    _draw_ellipses(axes, plan, seen, shown)
    _draw_control(axes, plan, shown)
    if outside := int((~seen).sum()):
        axes.plot([], [], " ", label=f"{outside} points are outside, or have no place")
    return finish(drawing, axes)


def _draw_outlines(axes: Any, outlines: FloatArray) -> None:
    from matplotlib.collections import LineCollection

    known = outlines[np.isfinite(outlines).all(axis=(1, 2))]
    if len(known):
        rings = np.concatenate([known, known[:, :1]], axis=1)
        axes.add_collection(LineCollection(rings, colors=LIGHT, linewidths=0.6, zorder=0), autolim=False)
        axes.plot([], [], "-", color=LIGHT, label="footprints")


def _draw_ellipses(axes: Any, plan: BlockPlan, seen: BoolArray, shown: float) -> None:
    from matplotlib.collections import EllipseCollection

    rows = seen & np.isfinite(plan.axes).all(axis=1)
    factor = magnification(plan.axes[rows, 0], shown)
    if not factor:
        return
    size, angle = 2.0 * factor * plan.axes[rows], np.degrees(plan.angle[rows])
    axes.add_collection(
        EllipseCollection(
            size[:, 0], size[:, 1], angle, units="xy", offsets=plan.points[rows], offset_transform=axes.transData,
            facecolors="none", edgecolors=GREY, linewidths=0.7,
        ),
        autolim=False,
    )  # fmt: skip
    radius = round_length(shown / factor)
    axes.plot([], [], "o", color=GREY, markerfacecolor="none", label=f"95 % ellipses, {factor:,g} times enlarged")
    (west, _), (south, north) = axes.get_xlim(), axes.get_ylim()
    place = (west + 2.0 * shown, south + 0.09 * (north - south))
    axes.add_collection(
        EllipseCollection(
            [2.0 * factor * radius], [2.0 * factor * radius], [0.0], units="xy", offsets=[place],
            offset_transform=axes.transData, facecolors="none", edgecolors=GREY, linewidths=0.7,
        ),
        autolim=False,
    )  # fmt: skip
    axes.annotate(
        f"semi-axis of {radius:g} m ({factor:,g} x)", place, textcoords="offset points", xytext=(16, -3), fontsize=8
    )


def _draw_control(axes: Any, plan: BlockPlan, shown: float) -> None:
    for kind, marker in CONTROL_MARKERS.items():
        rows = plan.kind == kind
        if rows.any():
            label = "check points" if kind == "check" else f"{kind} control"
            axes.plot(
                *plan.control_places[rows].T, marker, color="#c1272d", markerfacecolor="none", markersize=9,
                markeredgewidth=1.3, label=f"{rows.sum()} {label}",
            )  # fmt: skip
    rows = np.isfinite(plan.discrepancy).all(axis=1) & np.isfinite(plan.control_places).all(axis=1)
    factor = magnification(np.linalg.norm(plan.discrepancy[rows], axis=1), 2.0 * shown)
    if factor:
        arrows = axes.quiver(
            *plan.control_places[rows].T, *(factor * plan.discrepancy[rows].T), angles="xy", scale_units="xy",
            scale=1.0, color="#c1272d", width=0.0025, zorder=3,
        )  # fmt: skip
        length = round_length(2.0 * shown / factor)
        axes.quiverkey(
            arrows, 0.045, 0.04, factor * length, f"adjusted minus given: {length:g} m ({factor:,g} x)",
            labelpos="E", coordinates="axes", fontproperties={"size": 8},
        )  # fmt: skip


PLAN = Picture(
    name="plan",
    title="Block plan",
    needs={
        "options": ("system",),
        "stations": ("photo", "camera", "position", "attitude"),
        "cameras": ("camera", "focal_length", "principal_point", "format_size"),
        "plates": ("photo", "xy"),
        "points": ("point", "bathymetric", "position", "covariance"),
        "control": ("point", "kind", "difference"),
    },
    numbers=block_plan,
    figure=figure,
    words=sentence,
)
