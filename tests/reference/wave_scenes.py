"""Random strips photographed through one or two trains of waves, whose cards are wrong by what their sigmas say.

Nothing here shares a formula with the program: images are traced by the least optical path through a surface that
is written down here, and projected by the rotation of `reference.rays`. Axes: x along the flight (east), y across
(north), z up from the mean water level, m; times in s from the middle of the strip.
"""

from dataclasses import dataclass, replace

import numpy as np

from musatpy import model
from reference.rays import rotation

GRAVITY = 9.80665
INDEX = 1.34
FOCAL, HALF = 153.0, 112.0  # mm
_DEGREE = np.pi / 180.0
_NEWTON = 12  # steps to the least path: five are enough


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueWaves:
    """k waves in water of a depth (m): height from trough to crest, length, azimuth (rad, y to x), crest (m)."""

    values: np.ndarray  # (k, 4)
    depth: float

    def at(self, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return height, its two slopes and three second derivatives (xx, xy, yy) at places and times."""
        out = [np.zeros_like(x) for _ in range(6)]
        for H, L, a, c in self.values:
            k = 2.0 * np.pi / L
            w = np.sqrt(GRAVITY * k * np.tanh(k * self.depth))
            kx, ky = k * np.sin(a), k * np.cos(a)
            angle = kx * x + ky * y - k * c - w * t
            cosine, sine = 0.5 * H * np.cos(angle), 0.5 * H * np.sin(angle)
            parts = (cosine, -kx * sine, -ky * sine, -kx * kx * cosine, -kx * ky * cosine, -ky * ky * cosine)
            out = [whole + part for whole, part in zip(out, parts, strict=True)]
        return tuple(out)


def optical_path(waves: TrueWaves, xy: np.ndarray, C: np.ndarray, G: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return |W - C| + n |G - W| over places (r, 2) of the surface, from cameras to points (r, 3)."""
    W = np.column_stack([xy, waves.at(*xy.T, t)[0]])
    return np.asarray(np.linalg.norm(W - C, axis=1) + INDEX * np.linalg.norm(G - W, axis=1))


def entries(waves: TrueWaves, C: np.ndarray, G: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return where rays (r, 3) enter the water: the least of all optical paths, by Newton's steps downhill."""
    share = -G[:, 2] / (C - G)[:, 2] * 0.75
    xy = G[:, :2] + share[:, None] * (C - G)[:, :2]
    for _ in range(_NEWTON):
        h, sx, sy, sxx, sxy, syy = waves.at(*xy.T, t)
        W = np.column_stack([xy, h])
        a, b = W - C, W - G
        ra, rb = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
        one, nil = np.ones_like(h), np.zeros_like(h)
        T = np.stack([np.stack([one, nil, sx], axis=1), np.stack([nil, one, sy], axis=1)], axis=2)
        pull = a / ra[:, None] + INDEX * b / rb[:, None]
        slope = np.einsum("ria,ri->ra", T, pull)
        bend = (1.0 / ra + INDEX / rb)[:, None, None] * np.einsum("ria,rib->rab", T, T)
        for v, r, n in ((a, ra, 1.0), (b, rb, INDEX)):
            along = np.einsum("ria,ri->ra", T, v)
            bend -= (n / r**3)[:, None, None] * along[:, :, None] * along[:, None, :]
        bend += pull[:, 2, None, None] * np.moveaxis(np.array([[sxx, sxy], [sxy, syy]]), 2, 0)
        xy = xy - np.linalg.solve(bend, slope[..., None])[..., 0]
    if np.abs(slope).max() > 1e-10:
        raise ValueError("a ray has more than one way through these waves")
    return np.column_stack([xy, waves.at(*xy.T, t)[0]])


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is photographed, and how well it is known; lengths in m, times in s, noise in um."""

    photos: int
    flying_height: float
    interval: float  # between exposures; 0: simultaneous
    depth: float
    noise: float
    rows: int
    columns: int
    shore: int  # dry control points
    in_water: int  # control points on the bottom
    openness: float  # of a length, 1 sigma: what length and azimuth of the cards leave at the outermost points
    crest: float  # of a length, sigma of the crest
    level_guess: bool  # the cards say 0.1 m, sigma 1.2 m


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A scene as it is adjusted, and the truth: points (p, 3), and which of them are no control (p,)."""

    plan: Plan
    block: model.Block
    waves: TrueWaves
    points: np.ndarray
    check: np.ndarray


def plan_of(rng: np.random.Generator) -> Plan:
    """Return a random plan; one in five each is simultaneous, has a crest at random, or a nearly level guess."""
    height = float(np.exp(rng.uniform(np.log(300.0), np.log(3000.0))))
    return Plan(
        photos=int(rng.integers(2, 7)),
        flying_height=height,
        interval=0.0 if rng.random() < 0.2 else float(rng.uniform(2.0, 8.0)),
        depth=float(rng.uniform(2.0, 15.0)),
        noise=float(rng.uniform(3.0, 10.0)),
        rows=int(rng.integers(4, 8)),
        columns=int(rng.integers(5, 10)),
        shore=int(rng.integers(4, 13)),
        in_water=int(rng.integers(0, 9)),
        openness=float(np.exp(rng.uniform(np.log(0.05), np.log(0.8)))),
        crest=0.5 if rng.random() < 0.2 else float(rng.uniform(0.05, 0.25)),
        level_guess=bool(rng.random() < 0.2),
    )


def scene(seed: int, chop: float = 0.0) -> Scene:
    """Return the scene of a seed; with a chop of that height (m) on its waves, of which no card knows."""
    rng = np.random.default_rng([13, seed])
    plan = plan_of(rng)
    base = 0.4 * 230.0 / FOCAL * plan.flying_height
    half = 0.5 * (plan.photos - 1) * base
    waves = TrueWaves(values=_waves(plan, rng), depth=plan.depth)
    points, wet = _points(plan, half, rng)
    along = np.linspace(-half, half, plan.photos)
    camera = np.column_stack([along, np.zeros(plan.photos), np.full(plan.photos, plan.flying_height)])
    camera += rng.normal(0.0, 0.01 * plan.flying_height, camera.shape)
    attitude = rng.normal(0.0, 1.0 * _DEGREE, camera.shape)
    time = (np.arange(plan.photos) - 0.5 * (plan.photos - 1)) * plan.interval
    seen_through = replace(waves, values=np.concatenate([waves.values, _chop(chop, plan, rng)]))
    photo, point, xy = _images(seen_through, camera, attitude, time, points, wet)
    seen = np.bincount(point, minlength=len(points)) > 1
    control = np.concatenate([np.flatnonzero(~wet), rng.permutation(np.flatnonzero(wet & seen))[: plan.in_water]])
    sigma = 1e-4 * plan.flying_height
    xy = xy + rng.normal(0.0, 1e-3 * plan.noise, xy.shape)
    stations = (
        camera + rng.normal(0.0, 2.0, camera.shape),
        attitude + rng.normal(0.0, 0.1 * _DEGREE, camera.shape),
    )
    block = model.Block(
        titles=("A RANDOM SCENE THROUGH WAVES",),
        options=model.Options(
            program=model.Program.IIIA,
            system=model.CoordinateSystem.LOCAL,
            refraction=model.Refraction.RIGOROUS,
            plate_sigma=1e-3 * plan.noise,
        ),
        water=model.Water(index=INDEX),
        cameras=model.Cameras(
            ids=["WIDE"], focal_length=[FOCAL], principal_point=[[0.0, 0.0]], format_size=[[230.0, 230.0]]
        ),
        photos=_photos(*stations, time),
        points=model.Points(ids=[f"{'W' if one else 'L'}{i + 1}" for i, one in enumerate(wet)], bathymetric=wet),
        plates=model.PlateMeasurements(
            photo=photo,
            point=point,
            xy=xy,
        ),
        control=model.Control(
            point=control,
            kind=np.full(len(control), int(model.ControlKind.FULL)),
            position=points[control] + rng.normal(0.0, sigma, (len(control), 3)),
            sigma=np.full((len(control), 3), sigma),
        ),
        waves=_cards(plan, waves, points[wet], rng),
        wave_origin=model.WaveOrigin(position=(0.0, 0.0, 0.0)),
    )
    check = wet & seen
    check[control] = False
    return Scene(plan=plan, block=block, waves=waves, points=points, check=check)


def length_of(period: float, depth: float) -> float:
    """Return the length (m) of waves of a period (s) in water of a depth (m), by halving an interval."""
    short, long = 0.1, 2000.0
    for _ in range(80):
        middle = 0.5 * (short + long)
        k = 2.0 * np.pi / middle
        too_long = np.sqrt(GRAVITY * k * np.tanh(k * depth)) < 2.0 * np.pi / period
        short, long = (short, middle) if too_long else (middle, long)
    return middle


def _waves(plan: Plan, rng: np.random.Generator) -> np.ndarray:
    """Return one wave, or two that differ by a third of the period at least."""
    periods = [float(rng.uniform(4.0, 12.0))]
    if rng.random() < 0.3:
        periods.append(periods[0] * 0.6 if periods[0] > 7.0 else periods[0] * 1.6)
    rows = []
    for period in periods:
        L = length_of(period, plan.depth)
        # neither steep nor breaking: sinusoids stand for such waves only
        most = min(2.0, 0.04 * L, 0.3 * plan.depth)
        H = float(np.exp(rng.uniform(np.log(0.2), np.log(most)))) if most > 0.2 else 0.2
        rows.append([H, L, rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.5, 0.5) * L])
    return np.array(rows)


def _chop(height: float, plan: Plan, rng: np.random.Generator) -> np.ndarray:
    """Return a short wave of some height, (1, 4); (0, 4) for none."""
    if height == 0.0:
        return np.zeros((0, 4))
    return np.array(
        [[height, length_of(float(rng.uniform(2.8, 3.5)), plan.depth), rng.uniform(0.0, 2.0 * np.pi), 0.0]]
    )


def _points(plan: Plan, half: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (p, 3) on both shores and on the bottom between them, and which are under water (p,)."""
    H = plan.flying_height
    n = plan.shore
    shore = np.column_stack([
        np.linspace(-half, half, (n + 1) // 2).repeat(2)[:n] + rng.uniform(-0.05, 0.05, n) * H,
        np.where(np.arange(n) % 2, 0.58, -0.58) * H + rng.uniform(-0.04, 0.04, n) * H,
        rng.uniform(1.0, 0.03 * H, n),
    ])  # fmt: skip
    x, y = np.linspace(-half, half, plan.columns), np.linspace(-0.42, 0.42, plan.rows) * H
    grid = np.array([[a, b, -plan.depth] for a in x for b in y])
    spacing = [x[1] - x[0], y[1] - y[0]]
    grid[:, :2] += rng.uniform(-0.35, 0.35, (len(grid), 2)) * spacing
    grid[:, 2] *= 1.0 + rng.uniform(-0.15, 0.15, len(grid))
    return np.concatenate([shore, grid]), np.arange(n + len(grid)) >= n


def _images(
    waves: TrueWaves,
    camera: np.ndarray,
    attitude: np.ndarray,
    time: np.ndarray,
    points: np.ndarray,
    wet: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return photo (m,), point (m,) and plate coordinates (m, 2) mm of what lies within the format."""
    n, p = len(camera), len(points)
    photo, point = np.divmod(np.arange(n * p), p)
    near = _visible(_projected(camera, attitude, photo, points[point]), 1.1)
    photo, point = photo[near], point[near]
    place, under = points[point], wet[point]
    place[under] = entries(waves, camera[photo[under]], points[point[under]], time[photo[under]])
    xy = _projected(camera, attitude, photo, place)
    seen = _visible(xy, 1.0)
    return photo[seen], point[seen], xy[seen]


def _projected(camera: np.ndarray, attitude: np.ndarray, photo: np.ndarray, place: np.ndarray) -> np.ndarray:
    U, V, S = np.einsum("rij,rj->ir", rotation(attitude)[photo], place - camera[photo])
    return np.asarray(-FOCAL * np.column_stack([U, V]) / S[:, None])


def _visible(xy: np.ndarray, share: float) -> np.ndarray:
    return np.asarray((np.abs(xy) < share * HALF).all(axis=1))


def _photos(position: np.ndarray, attitude: np.ndarray, time: np.ndarray) -> model.Photos:
    n = len(time)
    return model.Photos(
        ids=[str(i + 1) for i in range(n)],
        camera=np.zeros(n, dtype=int),
        position=position,
        attitude=attitude,
        tide=np.zeros(n),
        time=time,
    )


def _cards(plan: Plan, waves: TrueWaves, bottom: np.ndarray, rng: np.random.Generator) -> model.Waves:
    """Return the cards of the waves: wrong by errors drawn from their sigmas, none beyond three of them."""
    k = len(waves.values)
    H, L = waves.values[:, :2].T
    reach = float(np.sqrt(np.mean(np.sum(np.square(bottom[:, :2]), axis=1))))
    apart = plan.openness / np.sqrt(2.0)
    sigma = np.column_stack([
        np.full(k, 1.2) if plan.level_guess else 0.5 * H,
        np.minimum(apart * L / reach, 0.15) * L,
        np.minimum(apart * L / reach, 0.3),
        plan.crest * L,
    ])  # fmt: skip
    value = waves.values + sigma * np.clip(rng.normal(size=(k, 4)), -3.0, 3.0)
    value[:, 0] = 0.1 if plan.level_guess else np.maximum(value[:, 0], 0.05)
    nothing = np.full(k, np.nan)
    return model.Waves(
        ids=["SWELL", "SEA"][:k],
        shape=["SINU"] * k,
        period=nothing,
        depth=np.full(k, plan.depth),
        length=value[:, 1],
        speed=nothing,
        height=value[:, 0],
        azimuth=value[:, 2] % (2.0 * np.pi),
        crest=value[:, 3],
        height_sigma=sigma[:, 0],
        length_sigma=sigma[:, 1],
        azimuth_sigma=sigma[:, 2],
        crest_sigma=sigma[:, 3],
    )
