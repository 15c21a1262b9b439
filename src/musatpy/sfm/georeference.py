"""Where a model stands: a similarity to geocentric or local metres by control and positions of photos.

It gives first values only: the control becomes control of the block, the positions observations. Gross errors, in
plan and in height apart, do not draw it and are named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import Problem, SystemsError
from musatpy.geometry.crs import own_ellipsoid, system_of
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.similarity import Similarity, by_change, cauchy, fit, fit_robust, small, spread
from musatpy.geometry.systems import geographic
from musatpy.sfm.block import Placement
from musatpy.sfm.control import ImagedControl
from musatpy.sfm.intersection import intersections
from musatpy.sfm.model import LOCAL, Model, ModelError

CONTROL_SIGMA = 0.05  # m, where none is stated
_SAME_EARTH = 1e-3  # m, of semi-axes
_STEPS, _AT_REST = 50, 1e-9
_GROSS = 5.0  # robust scales
_LEAST_WRONG = 5.0  # px, of the image of a control point
_FAR = 1e5  # m, between control and photos
_MOST_PIXELS = 20.0  # px, of half of the images of control: a bundle that knew of no water misses by one or two
_MOST_BENT = 0.03  # of the distance of points, that half of the places miss by: such a bundle bends them by less
_NO_CHANCE = 10.0  # sigmas
_MOST_TURN = 0.1  # rad: the sigma of a turn that is as good as unknown


@dataclass(frozen=True, kw_only=True, eq=False)
class Georeference:
    """Where a model of n photos stands by k control points; residuals are placed minus given, m east, north, up."""

    placement: Placement
    control: FloatArray  # (k, 3), checks too; NaN: no place is given, or no two rays meet
    photos: FloatArray  # (n, 3); NaN: no position is given
    wrong: tuple[str, ...]  # sentences that name what does not fit
    notes: tuple[str, ...]


def level_positions(
    position: FloatArray, stated: str, crs: str = "", geoid: str = ""
) -> tuple[FloatArray, Ellipsoid | None]:
    """Return positions (n, 3) in a system as latitude, longitude (rad), height, with their ellipsoid.

    The system is the one that the file has stated, else `crs`: a code EPSG[+vertical], PROJ string or WKT, or
    `local` for metres with Z up, which stay as they are on no ellipsoid (None). `geoid` is the grid of heights.
    Raises `SystemsError` where no system is stated, where it is in feet or stands on another ellipsoid than WGS 84
    and GRS 80, and where `geometry.crs` refuses it, or `crs` beside it.
    """
    definition = stated or crs
    if stated and crs not in ("", LOCAL):
        system_of(crs, own_ellipsoid(crs), geoid)
    if not definition:
        message = "no coordinate system is stated: give --crs EPSG:code[+vertical], or --crs local for local metres"
        raise SystemsError.of(message)
    if definition == LOCAL:
        return np.array(position), None
    ellipsoid, a_b = own_ellipsoid(definition), Ellipsoid("WGS84").axes
    if np.abs(np.subtract(ellipsoid.axes, a_b)).max() > _SAME_EARTH:
        message = f"{definition[:60]} stands on another ellipsoid than WGS 84 and GRS 80: no datum is shifted"
        raise SystemsError.of(message)
    system = system_of(definition, ellipsoid, geoid)
    if system.plane and system.units[0] != "m":
        message = f"{system.text}: it is in {system.units[0]}, and heights beside it may be too: give metres"
        raise SystemsError.of(message)
    return system.level(position), ellipsoid


@dataclass(frozen=True, kw_only=True, eq=False)
class _Places:
    """k places in the model and in east, north, up about their middle."""

    x: FloatArray  # (k, 3)
    y: FloatArray  # (k, 3) m
    sigma: FloatArray  # (k, 3) m
    group: IntArray  # (k,) 0 control, 1 photos


def georeferenced(
    model: Model,
    ellipsoid: Ellipsoid | None,
    control: ImagedControl | None = None,
    control_level: FloatArray | None = None,
    station_level: FloatArray | None = None,
    station_sigma: FloatArray | None = None,
    *,
    metric: bool = False,
) -> Georeference:
    """Return where a model stands by control (k, 3) that is no check, and by positions (n, 3) of its photos.

    Positions are as `level_positions` has them, on one ellipsoid or, None, on none; `station_sigma` (n, 3) m east,
    north, up; NaN where not known. A model that is `metric` keeps its scale. Raises `ModelError` where fewer than
    three places are known or where these leave a turn of the model free.
    """
    count = 0 if control is None else len(control.ids)
    place, notes, wrong = _intersected(model, control)
    x = np.concatenate([place, model.centre])
    none = np.full(x.shape, np.nan)
    level, sigma = none.copy(), none.copy()
    level[:count] = none[:count] if control_level is None else control_level
    level[count:] = none[count:] if station_level is None else station_level
    sigma[count:] = none[count:] if station_sigma is None else station_sigma
    check, ids = np.zeros(len(x), dtype=bool), list[str]()
    if control is not None:
        sigma[:count] = np.where(np.isnan(control.sigma), CONTROL_SIGMA, control.sigma)
        check[:count], ids = control.check, control.ids.tolist()
    names = [f"control point {name}" for name in ids] + [f"photo {name}" for name in model.photos.tolist()]
    metres = level if ellipsoid is None else ellipsoid.geocentric(level)
    known = np.isfinite(metres).all(axis=1) & np.isfinite(x).all(axis=1)
    rows = np.flatnonzero(known & np.isfinite(sigma).all(axis=1) & ~check)
    if len(rows) < 3:
        flat = int((np.isfinite(sigma[count:, :2]).all(axis=1) & np.isnan(sigma[count:, 2])).sum())
        numbers = int((rows < count).sum()), int((rows >= count).sum()), flat
        raise ModelError([Problem(message=_too_few(*numbers))])
    groups = [metres[of] for of in (rows[rows < count], rows[rows >= count]) if len(of)]
    apart = float(np.linalg.norm(np.median(groups[0], axis=0) - np.median(groups[-1], axis=0)))
    if apart > _FAR:
        message = f"control is {apart / 1e3:,.0f} km from the positions of the photos: it is in another system"
        raise ModelError([Problem(message=message, file=control.source if control else None)])
    middle = metres[rows].mean(axis=0)
    axes = np.eye(3) if ellipsoid is None else ellipsoid.frame(geographic(ellipsoid, middle))
    y = (metres - middle) @ axes.T
    similarity, gross = _solved(
        _Places(x=x[rows], y=y[rows], sigma=sigma[rows], group=(rows >= count).astype(np.int64)), metric
    )
    placed = np.where(known[:, None], similarity.apply(x) - y, np.nan)
    _require_fit(model, placed, sigma, check, count, similarity.scale)
    wrong += [
        f"{names[row]} is {', '.join(f'{value:.2f}' for value in placed[row].tolist())} m off, east, north, up"
        for row in rows[gross].tolist()
    ]
    if len(rows) == 3:
        notes.append("three places fix the model, and do not check one another")
    placement = Placement(
        scale=similarity.scale,
        rotation=axes.T @ similarity.rotation,
        shift=middle + axes.T @ similarity.shift,
        ellipsoid=ellipsoid,
    )
    return Georeference(
        placement=placement, control=placed[:count], photos=placed[count:], wrong=tuple(wrong), notes=tuple(notes)
    )


def _too_few(control: int, photos: int, flat: int) -> str:
    heights = f"; the positions of {flat} photos have no heights of use: --heights takes them" if flat else ""
    return (
        f"{control} control points with coordinates and two images or more, and {photos} photos with positions are "
        f"known: three places that are not on a line are needed (--gcp, --gnss){heights}"
    )


def _intersected(model: Model, control: ImagedControl | None) -> tuple[FloatArray, list[str], list[str]]:
    """Return control points (k, 3) in the model, what is to be said of them, and images that are wrong."""
    if control is None:
        return np.zeros((0, 3)), [], []
    place = intersections(model, control.photo, control.point, control.pixel, len(control.ids))
    rays = np.bincount(control.point, minlength=len(control.ids))
    notes = [
        f"control point {name} has {number} image{'s' * (number != 1)}: no place in the model"
        for name, number, lost in zip(control.ids.tolist(), rays.tolist(), np.isnan(place[:, 0]), strict=True)
        if lost
    ]
    gap = model.gaps(place, control.photo, control.point, control.pixel)
    size = np.linalg.norm(gap, axis=1)
    seen = np.isfinite(size)
    if seen.any() and (middle := float(np.median(size[seen]))) > _MOST_PIXELS:
        message = (
            f"images of control miss where their rays meet by {middle:.0f} px (median): were they measured on "
            "photos of another size, or do they count from another corner?"
        )
        raise ModelError([Problem(message=message, file=control.source)])
    usual = max(_LEAST_WRONG, _GROSS * spread(size[seen], 0.0))
    wrong = [
        f"control point {control.ids[control.point[row]]} is {size[row]:.1f} px off on "
        f"photo {model.photos[control.photo[row]]}"
        for row in np.flatnonzero(seen & (size > usual)).tolist()
    ]
    return place, notes, wrong


def _require_fit(
    model: Model, off: FloatArray, sigma: FloatArray, check: BoolArray, control: int, scale: float
) -> None:
    """Raise `ModelError` where half of the places (k, 3), the first of control, miss by more than bundles bend."""
    rows = np.arange(0, len(model.photo), 1 + len(model.photo) // 2000)  # of images enough for a median
    away = model.position[model.point[rows]] - model.centre[model.photo[rows]]
    least = _MOST_BENT * scale * float(np.median(np.linalg.norm(away, axis=1))) if len(away) else np.inf
    given, medians, far = np.isfinite(off + sigma).all(axis=1) & ~check, list[str](), False
    for what, part in (("control points", slice(control)), ("photos", slice(control, None))):
        some = np.abs(off[part][given[part]])
        if len(some):
            middle, doubt = np.median(some, axis=0), np.median(sigma[part][given[part]], axis=0)
            far |= bool((middle > np.maximum(least, _NO_CHANCE * doubt)).any())
            medians.append(f"{len(some)} {what} by {', '.join(f'{value:.1f}' for value in middle.tolist())} m")
    if far:
        message = (
            f"the model does not fit its places: it misses {' and '.join(medians)} (medians; east, north, up). Are "
            "heights above the geoid and above the ellipsoid, or metres and feet mixed, are coordinates exchanged, "
            "or are the positions those of other photos?"
        )
        raise ModelError.of(message)


def _solved(of: _Places, metric: bool) -> tuple[Similarity, BoolArray]:
    """Return the similarity of known places, and which (k,) are gross errors. Raises `ModelError`.

    Least squares with Cauchy's weights, in plan and in height apart, whose scales are those of control and of
    photos each.
    """
    weight = 1.0 / np.mean(np.square(of.sigma), axis=1)
    mean = of.x.mean(axis=0)
    at, _ = fit_robust(of.x - mean, of.y, weight, 1.0)
    if metric:
        at = _unscaled(at, of.x - mean, of.y, weight)
    first = int(metric)
    for _ in range(_STEPS):
        placed = at.apply(of.x - mean)
        error = of.y - placed
        off, scale = _relative(error, of)
        W = cauchy(off, scale, 1.0 / np.square(of.sigma)).reshape(-1)
        J = by_change(placed)[..., first:].reshape(-1, 7 - first)
        step = np.zeros(7)
        step[first:] = np.linalg.lstsq(J * np.sqrt(W)[:, None], error.reshape(-1) * np.sqrt(W), rcond=None)[0]
        at = small(step).after(at)
        if np.abs(step).max() < _AT_REST:
            break
    variance = np.square(of.sigma * np.maximum(scale, 1.0))
    gross: BoolArray = np.asarray((off > _GROSS * scale).any(axis=1))
    _require_turns(of, J / np.sqrt(variance.reshape(-1))[:, None], np.asarray(~gross), first)
    shift = at.shift - at.scale * at.rotation @ mean
    return Similarity(scale=at.scale, rotation=at.rotation, shift=shift), gross


def _unscaled(at: Similarity, x: FloatArray, y: FloatArray, weight: FloatArray) -> Similarity:
    """Return the similarity without its scale, about the middle of what fits it."""
    error = np.linalg.norm(y - at.apply(x), axis=1) * np.sqrt(weight)
    robust = cauchy(error, spread(error, 1.0), weight)
    rotation = fit(x, y, robust).rotation
    shift = np.average(y - x @ rotation.T, axis=0, weights=robust)
    return Similarity(scale=1.0, rotation=rotation, shift=shift)


def _relative(error: FloatArray, of: _Places) -> tuple[FloatArray, FloatArray]:
    """Return errors (k, 3) over sigmas, that in plan in both of its columns, and their robust scales (k, 3)."""
    off = np.abs(error) / of.sigma
    off[:, :2] = np.hypot(off[:, 0], off[:, 1])[:, None]
    scale = np.ones_like(off)
    for group in (0, 1):
        rows = of.group == group
        for column in range(3):
            scale[rows, column] = spread(off[rows, column], 1.0)
    return off, scale


def _require_turns(of: _Places, J: FloatArray, good: BoolArray, first: int) -> None:
    """Raise `ModelError` where places without gross errors leave a turn free; J (3 k, 7 - first) over sigmas."""
    rows = J.reshape(len(good), 3, -1)[good].reshape(-1, J.shape[1])
    size = np.maximum(np.linalg.norm(rows, axis=0), np.finfo(float).tiny)
    values, vectors = np.linalg.eigh((rows / size).T @ (rows / size))
    turns = vectors[1 - first : 4 - first] / size[1 - first : 4 - first, None]
    variance = np.sum(np.square(turns) / np.maximum(values, 1e-14), axis=1)
    if float(np.sqrt(variance.max())) < _MOST_TURN:
        return
    spread_along = np.linalg.svd(of.y[good] - of.y[good].mean(axis=0), compute_uv=False) / np.sqrt(
        max(1, good.sum())
    )
    along, across = (float(value) for value in spread_along[:2])
    message = (
        f"the {good.sum()} places that fit leave a turn of the model free: they spread by {along:.2f} m along a "
        f"line and {across:.2f} m beside it, of sigmas of {np.median(of.sigma):.2f} m: a control point off that "
        "line is lacking"
    )
    raise ModelError.of(message)
