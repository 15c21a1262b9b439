"""Small simulated strips and blocks with known truth, for tests of the adjustment: a few photos, a few points.

Images come from the reference projection of `dense_bundle`, so they share nothing with the program.
"""

from dataclasses import dataclass, replace

import numpy as np

from musatpy import model
from musatpy.units import ARC_SECOND, DEGREE
from reference.dense_bundle import Network, Start, State
from reference.earth import Earth, earth_of
from reference.rays import angles_of, rotation

_CENTRE = (19.3 * DEGREE, -81.3 * DEGREE, 0.0)  # of geographic and geocentric jobs: the Cayman Islands
_TIDES = (0.35, -0.30, 0.15, 0.60, -0.10)
_CONTROL_SIGMA = (0.05, 0.05, 0.08)
_SIGHT = 105.0  # mm: points farther from the axis are not on the plate


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What to simulate. Lengths in metres, angles in radians, plates in millimetres."""

    system: model.CoordinateSystem = model.CoordinateSystem.LOCAL
    strips: int = 1
    photos_per_strip: int = 3
    height: float = 3000.0
    focal_length: float = 152.4
    base: float = 1300.0
    heading: float = 0.4
    submerged: bool = False
    wet_every: int = 2  # one point in so many is submerged
    sea_control: bool = False  # control may fall on submerged points
    kinds: tuple[model.ControlKind, ...] = (model.ControlKind.FULL,)  # taken in turn along the control points
    fixed_every: int = 0  # every so many control points are held fixed
    control_errors: bool = True
    station_sigma: float = np.nan
    attitude_sigma: float = np.nan
    equal_elevation: bool = False
    air_base: bool = False
    keep_out: int = 0  # so many measurements are flagged not triangulated
    plate_sigma: float = 0.010
    noise: float = 1.0  # times the sigmas; 0 for exact data
    start_error: tuple[float, float] = (20.0, 0.5 * DEGREE)  # of stations without sigma
    seed: int = 1


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """A simulated block and what is true of it: stations and points in the job's system."""

    block: model.Block
    truth: Start


def simulate(plan: Plan) -> Simulated:
    """Return a block after `plan`; the same plan gives the same numbers."""
    rng = np.random.default_rng(plan.seed)
    stations, headings = _flight(plan)
    ground, wet = _terrain(plan, rng)
    n, p = len(stations), len(ground)
    exact = _exact_block(plan, p, wet, n)
    earth = earth_of(exact)
    centre = np.zeros(3) if plan.system == model.CoordinateSystem.LOCAL else np.array(_CENTRE)
    native = earth.shift(np.broadcast_to(centre, (p, 3)), ground)
    station_native = earth.shift(np.broadcast_to(centre, (n, 3)), stations)
    attitude = np.stack([rng.normal(0, 1.5 * DEGREE, n), rng.normal(0, 1.5 * DEGREE, n), headings], axis=-1)
    exact = replace(exact, photos=replace(exact.photos, position=earth.given(station_native), attitude=attitude))
    images = project_all(exact, native, refraction=plan.submerged)
    seen = (np.abs(images) < _SIGHT).all(axis=2)
    assert seen.any(axis=0).all()
    block = replace(
        exact,
        plates=_measure(images, seen, plan, rng),
        control=_control(plan, earth, native, wet, seen.sum(axis=0) == 1, rng),
    )
    if plan.equal_elevation:
        block = replace(block, equal_elevations=_shore(native, wet))
    if plan.air_base:
        xyz = earth.cartesian(station_native)
        length = np.linalg.norm(xyz[1] - xyz[0]) + plan.noise * rng.normal(0, 0.03)
        block = replace(block, air_bases=model.AirBases(photo=[[0, 1]], length=[length], sigma=[0.03]))
    return _with_approximate_stations(block, plan, earth, native, rng)


def _flight(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    along = (np.arange(plan.photos_per_strip) - 0.5 * (plan.photos_per_strip - 1)) * plan.base
    across = (np.arange(plan.strips) - 0.5 * (plan.strips - 1)) * 1.06 * plan.height
    rows = [[x, y, plan.height + 15.0 * np.sin(x)] for y in across for x in along]
    headings = [plan.heading + (np.pi if i % 2 else 0.0) for i in range(plan.strips) for _ in along]
    return turned(np.array(rows), plan.heading), np.array(headings)


def turned(enu: np.ndarray, heading: float) -> np.ndarray:
    """Return rows (k, 3) of a plan along x, turned to a heading (rad)."""
    c, s = np.cos(heading), np.sin(heading)
    return enu @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _terrain(plan: Plan, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    half = 0.5 * (plan.photos_per_strip - 1) * plan.base
    margin = 0.3 * plan.height
    along = np.arange(-half - margin, half + margin + 1.0, 0.5 * plan.base)
    across = (np.arange(2 * plan.strips + 1) - plan.strips) * 0.5 * plan.height
    grid = np.array([[x, y, 0.0] for x in along for y in across])
    grid[:, :2] += rng.uniform(-0.04, 0.04, (len(grid), 2)) * plan.height
    grid[:, 2] = rng.uniform(2.0, 80.0, len(grid))
    wet = np.zeros(len(grid), dtype=bool)
    if plan.submerged:
        wet[1 :: plan.wet_every] = True
        grid[wet, 2] = -np.geomspace(0.9, 30.0, wet.sum())
        grid[np.flatnonzero(wet)[0], 2] = 0.0  # under water at some tides, dry at others
    shore = np.flatnonzero(~wet)[1::3]
    if plan.equal_elevation:
        grid[shore, 2] = 3.0
    return turned(grid, plan.heading), wet


def _exact_block(plan: Plan, p: int, wet: np.ndarray, n: int) -> model.Block:
    """The frame of the block: cameras, tides, options; positions and measurements come later."""
    local = plan.system == model.CoordinateSystem.LOCAL
    centre = np.broadcast_to(_CENTRE, (n, 3))
    if plan.system == model.CoordinateSystem.GEOCENTRIC:
        centre = np.broadcast_to([911000.0, -5952000.0, 2094000.0], (n, 3))
    return model.Block(
        titles=("SIMULATED",),
        options=model.Options(
            system=plan.system,
            refraction=model.Refraction.RIGOROUS if plan.submerged else model.Refraction.NONE,
            plate_sigma=plan.plate_sigma,
            max_iterations=50,
            max_passes=50,
            rotation_limit=1e-5 * ARC_SECOND,  # so tight that the last step is far below 1e-6 sigma
            translation_limit=1e-7,
            water_limit=1e-6,
        ),
        ellipsoid=None if local else model.EllipsoidSpec(name="clrk66"),
        water=model.Water(index=1.340) if plan.submerged else None,
        cameras=model.Cameras(
            ids=["RC8"],
            focal_length=[plan.focal_length],
            principal_point=[[0.012, -0.007]],
            format_size=[[230.0, 230.0]],
        ),
        photos=model.Photos(
            ids=[str(837 + i) for i in range(n)],
            camera=np.zeros(n, dtype=int),
            position=np.zeros((n, 3)) if local else centre,
            attitude=np.zeros((n, 3)),
            tide=np.resize(_TIDES, n) if plan.submerged else [],
        ),
        points=model.Points(ids=[f"P{i + 1:03d}" for i in range(p)], bathymetric=wet),
    )


def project_all(block: model.Block, native: np.ndarray, *, refraction: bool) -> np.ndarray:
    """(n, p, 2) plate coordinates, mm, of every point on every photo from the block's own stations."""
    network = Network(block, refraction=refraction)
    n, p = len(block.photos.ids), len(native)
    photo, point = np.divmod(np.arange(n * p), p)
    attitude = np.hstack([np.zeros((n, 3)), block.photos.attitude])
    state = State(
        stations=attitude, ground=native, levels=np.zeros(0), tides=np.zeros(0), tilt=np.zeros(2),
        index=block.water.index if block.water else 1.340,
    )  # fmt: skip
    wet = block.points.bathymetric[point] & refraction
    return network.project(state, photo, point, np.zeros((n * p, 13)), wet).reshape(n, p, 2)


def _measure(images: np.ndarray, seen: np.ndarray, plan: Plan, rng: np.random.Generator) -> model.PlateMeasurements:
    photo, point = np.nonzero(seen)
    m = len(photo)
    sigma = np.full((m, 2), np.nan)
    sigma[::5] = [1.5 * plan.plate_sigma, 2.0 * plan.plate_sigma]  # some cards carry their own
    error = np.where(np.isnan(sigma), plan.plate_sigma, sigma) * rng.normal(size=(m, 2)) * plan.noise
    triangulated = np.ones(m, dtype=bool)
    triangulated[rng.choice(m, plan.keep_out, replace=False)] = False
    return model.PlateMeasurements(
        photo=photo, point=point, xy=images[photo, point] + error, sigma=sigma, triangulated=triangulated
    )


def _control(
    plan: Plan, earth: Earth, native: np.ndarray, wet: np.ndarray, alone: np.ndarray, rng: np.random.Generator
) -> model.Control:
    """Some points, the first and last dry ones, and whatever has a single ray; full control at the ends.

    The kinds of the plan come in turn in between; a single ray gets full control, without which it is of no use.
    """
    dry = np.flatnonzero(~wet)
    full = np.unique(np.concatenate([dry[[0, 1, -2, -1]], np.flatnonzero(alone)]))
    chosen = np.union1d(full, np.arange(len(native))[::3] if plan.sea_control else dry[::2])
    kinds = np.resize([int(kind) for kind in plan.kinds], len(chosen))
    kinds[np.isin(chosen, full)] = model.ControlKind.FULL
    fixed = np.zeros(len(chosen), dtype=bool)
    if plan.fixed_every:
        fixed[:: plan.fixed_every] = True
    sigma = np.broadcast_to(_CONTROL_SIGMA, (len(chosen), 3)).copy()
    scale = plan.noise * plan.control_errors * ~fixed[:, None]
    position = earth.given(earth.shift(native[chosen], scale * sigma * rng.normal(size=sigma.shape)))
    if plan.system != model.CoordinateSystem.GEOCENTRIC:  # there a card gives X, Y and Z together
        position[kinds == model.ControlKind.VERTICAL, :2] = np.nan
        position[kinds == model.ControlKind.HORIZONTAL, 2] = np.nan
    sigma[kinds == model.ControlKind.VERTICAL, :2] = np.nan
    sigma[kinds == model.ControlKind.HORIZONTAL, 2] = np.nan
    sigma[fixed | (kinds == model.ControlKind.CHECK)] = np.nan
    return model.Control(point=chosen, kind=kinds, fixed=fixed, position=position, sigma=sigma)


def _shore(native: np.ndarray, wet: np.ndarray) -> model.EqualElevations:
    members = np.flatnonzero(~wet)[1::3]
    assert np.ptp(native[members, 2]) < 1e-9
    return model.EqualElevations(ids=["SHORE"], sigma=[0.1], group=np.zeros(len(members), dtype=int), point=members)


def _with_approximate_stations(
    block: model.Block, plan: Plan, earth: Earth, native: np.ndarray, rng: np.random.Generator
) -> Simulated:
    """Replace the true stations by observed or by bad ones; the truth goes into the frame of the given ones."""
    n = len(block.photos.ids)
    true_native = earth.native(block.photos.position)
    matrix = rotation(block.photos.attitude) @ earth.frame(true_native)
    metres, radians = plan.start_error
    observed = np.isfinite(plan.station_sigma)
    errors = rng.normal(size=(n, 3)) * (plan.noise * plan.station_sigma if observed else metres)
    given = earth.shift(true_native, errors)
    attitude = angles_of(matrix @ np.swapaxes(np.array(earth.frame(given)), -1, -2))
    observed = np.isfinite(plan.attitude_sigma)
    turns = rng.normal(size=(n, 3)) * (plan.noise * plan.attitude_sigma if observed else radians)
    photos = replace(
        block.photos,
        position=earth.given(given),
        attitude=attitude + turns,
        position_sigma=np.full((n, 3), plan.station_sigma),
        attitude_sigma=np.full((n, 3), plan.attitude_sigma),
    )
    truth = Start(position=earth.given(true_native), attitude=attitude, points=earth.given(native))
    return Simulated(block=replace(block, photos=photos), truth=truth)
