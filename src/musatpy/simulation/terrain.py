"""The ground: tie points, extra points, given points; land, shoals, shore lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import SpecError
from musatpy.simulation.flight import FlightPlan, TrueFlight
from musatpy.simulation.scene_keys import GivenPoint
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.world import TruePlaces, World
from musatpy.specs import Area
from musatpy.units import DEGREE

GIVEN, TIE, EXTRA = 0, 1, 2  # origin of a point


@dataclass(frozen=True, kw_only=True)
class TrueGround:
    """p true points: first the given ones, then ties, then extras; control may rename them later."""

    ids: tuple[str, ...]
    places: TruePlaces
    plan: FloatArray  # (p, 2) m
    bathymetric: BoolArray  # (p,)
    origin: IntArray  # (p,) GIVEN, TIE or EXTRA
    shore: IntArray  # (p,) equal elevation group, -1 for none
    levels: FloatArray  # (g,) m, true levels of the groups


@dataclass(frozen=True, kw_only=True)
class Scene:
    """All that is true of a block, and what its errors are drawn by."""

    spec: SimulationSpec
    world: World
    draws: Draws
    plan: FlightPlan
    flight: TrueFlight
    ground: TrueGround


def inside(plan: FloatArray, area: Area | None) -> BoolArray:
    """Return which plan positions (p, 2) lie in the rectangle; everywhere without one."""
    if area is None:
        return np.ones(len(plan), dtype=bool)
    east_from, east_to, north_from, north_to = area
    east, north = plan.T
    return (east >= east_from) & (east <= east_to) & (north >= north_from) & (north <= north_to)


def spread(plan: FloatArray, candidates: IntArray, number: int) -> IntArray:
    """Return `number` of the candidates, spread over the block: each the farthest from those before it.

    The first is the farthest from the middle. Distances are whole decimetres, so that ties break alike everywhere.
    """
    if number == 0:
        return candidates[:0]
    here = np.round(plan[candidates], 1)
    distance = np.round(np.linalg.norm(here - here.mean(axis=0), axis=1), 1)
    chosen: list[int] = []
    for _ in range(number):
        best = int(np.argmax(distance))
        to_best = np.round(np.linalg.norm(here - here[best], axis=1), 1)
        distance = to_best if not chosen else np.minimum(distance, to_best)
        chosen.append(best)
        distance[chosen] = -1.0
    return candidates[np.array(chosen, dtype=int)]


def lay_ground(
    spec: SimulationSpec, plan: FlightPlan, flight: TrueFlight, world: World, draws: Draws
) -> TrueGround:
    """Return the true points. Raises `SpecError` where land lies below the water, or groups lack points."""
    given = _given_places(spec, world)
    ties, extras = _tie_sites(spec, plan, draws), _extra_sites(spec, plan, draws)
    sites = np.concatenate([ties, extras])
    terrain = spec.terrain
    east, north = np.sin(2.0 * np.pi * (sites / terrain.wavelength + draws.uniform("terrain", 2))).T
    heights = terrain.level + terrain.relief / 2.0 * (east + north)
    sea = _submerge(spec, sites, heights, draws)
    shore, levels = _shore_lines(spec, sites, flight, np.arange(len(ties)), sea, heights, draws)
    places = given.then(world.at_plan(sites, heights))
    g = len(spec.point)
    bathymetric = np.concatenate([np.array([point.bathymetric for point in spec.point], dtype=bool), sea])
    shore = np.concatenate([np.full(g, -1), shore])
    _refuse_drowned_land(flight, places[np.flatnonzero(~bathymetric & (shore < 0))])
    first = spec.points.first_id
    return TrueGround(
        ids=(*(point.id for point in spec.point), *(str(first + i) for i in range(len(sites)))),
        places=places,
        plan=world.plan(places),
        bathymetric=bathymetric,
        origin=np.repeat([GIVEN, TIE, EXTRA], [g, len(ties), len(extras)]),
        shore=shore,
        levels=levels,
    )


def _given_places(spec: SimulationSpec, world: World) -> TruePlaces:
    """Return the places of the [[point]] tables."""

    def place(point: GivenPoint) -> TruePlaces:
        if point.geographic is not None:
            return world.at_natural(np.array([point.geographic]) * [DEGREE, DEGREE, 1.0])
        return world.at_xyz(np.array([point.local or point.geocentric]))

    job = [place(point).job for point in spec.point]
    return world.at_job(np.concatenate([*job, np.empty((0, 3))]))


def _tie_sites(spec: SimulationSpec, plan: FlightPlan, draws: Draws) -> FloatArray:
    """Return the plan positions (k, 2) of the von Gruber sites, photo by photo, scattered about them.

    Below every photo, and half a strip spacing to the left and right of it; a site between strips serves both.
    """
    nadirs = plan.nadirs.copy()
    if spec.flight.reverse_alternate:
        nadirs[1::2] = nadirs[1::2, ::-1]
    rows = [nadirs[0] - plan.right * plan.spacing / 2.0]
    for strip in nadirs:
        rows += [strip, strip + plan.right * plan.spacing / 2.0]
    sites = np.stack(rows).transpose(1, 0, 2).reshape(-1, 2)
    sites = np.repeat(sites, spec.points.per_site, axis=0)
    offset = (2.0 * draws.uniform("sites", len(sites), 2) - 1.0) * spec.points.scatter * plan.base
    return sites + offset[:, :1] * plan.along + offset[:, 1:] * plan.right


def _extra_sites(spec: SimulationSpec, plan: FlightPlan, draws: Draws) -> FloatArray:
    """Return plan positions (k, 2) spread evenly over areas, or over the stereo coverage of the block."""
    strips, photos = plan.nadirs.shape[:2]
    length, width = (photos - 1) * plan.base, strips * plan.spacing
    sites = [np.empty((0, 2))]
    for extra in spec.points.extra:
        u = draws.uniform("extra points", extra.number, 2)
        if extra.area is None:
            u -= 0.5
            sites.append(u[:, :1] * length * plan.along + u[:, 1:] * width * plan.right)
        else:
            low, high = np.array(extra.area[0::2]), np.array(extra.area[1::2])
            sites.append(low + u * (high - low))
    return np.concatenate(sites)


def _submerge(spec: SimulationSpec, sites: FloatArray, heights: FloatArray, draws: Draws) -> BoolArray:
    """Choose the submerged ones of the generated points, put them on the bottom, and return which they are (k,)."""
    sea = np.zeros(len(sites), dtype=bool)
    for shoal in spec.shoal:
        candidates = np.flatnonzero(inside(sites, shoal.area) & ~sea)
        number = round(shoal.share * len(candidates))
        chosen = candidates[draws.pick("submerged points", len(candidates), number)]
        low, high = shoal.depth
        assert spec.water is not None  # the spec says so of every shoal
        heights[chosen] = spec.water.level - (low + (high - low) * draws.uniform("depths", number))
        sea[chosen] = True
    return sea


def _shore_lines(
    spec: SimulationSpec,
    sites: FloatArray,
    flight: TrueFlight,
    ties: IntArray,
    sea: BoolArray,
    heights: FloatArray,
    draws: Draws,
) -> tuple[IntArray, FloatArray]:
    """Bring tie points on land to the levels of their groups; return group (k,) of each and levels (g,) m."""
    group, levels = np.full(len(sites), -1), np.zeros(len(spec.equal_elevation))
    for i, shore in enumerate(spec.equal_elevation):
        candidates = ties[~sea[ties] & (group[ties] < 0) & inside(sites[ties], shore.area)]
        if len(candidates) < shore.number:
            raise SpecError.of(f"only {len(candidates)} tie points on land", field=f"equal_elevation[{i + 1}]")
        default = float(flight.tide.max()) if spec.water else spec.terrain.level
        levels[i] = default if shore.level is None else shore.level
        chosen = spread(sites, candidates, shore.number)
        heights[chosen] = levels[i] + shore.error * draws.normal("shore", shore.number)
        group[chosen] = i
    return group, levels


def _refuse_drowned_land(flight: TrueFlight, land: TruePlaces) -> None:
    """Raise `SpecError` where land lies below the highest tide: its images would be refracted unbeknown."""
    if np.isnan(flight.tide).all():
        return
    highest, height = float(np.nanmax(flight.tide)), land.natural[:, 2]
    drowned = height[height < flight.water.levels(land, np.full(len(height), highest))]
    if drowned.size:
        message = f"land down to {drowned.min():.2f} m lies below the highest tide, {highest:.2f} m"
        raise SpecError.of(message, field="terrain or point")
