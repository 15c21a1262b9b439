"""Enough rays for every photo, and a datum for every part of the block: what observations hold of its motions.

These are one scale, three turns and three shifts. Each observed component of a station, of a control point, of an
attitude, and each observed length or difference of heights is a row of seven: what the motions change of it. Their
rank says what is held. Positions are those of the cards; where a card says nothing of one, any other would do, for
what is free with most of them is free.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import Problem
from musatpy.formats.checks.check import MOTIONS, check
from musatpy.formats.checks.images import PlateRays, common_rays, metric, rays_of
from musatpy.formats.checks.systems import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import OF_STATIONS, ROLES
from musatpy.geometry.similarity import by_change
from musatpy.model import Datum, Program

_OF_RAYS = ("stations", "attitudes", "plates", "control", "equal_elevations")
_UNKNOWNS = 6  # of a photo
_HORIZONTAL, _VERTICAL = 2, 3  # known points that fix them
_MOTIONS = 7
_RELIEF = 0.1  # of the extent, of points whose height no card gives
_LEVEL = 0.1  # rad: tilts up to which the angles turn about east, north and up
_FREE = 1e-3  # of the motions over the extent of a part: what holds less than that holds nothing
_OUTSIDE = 50.0  # extents: a card that is wrong says nothing of where its photo or point is
_SEED = 0  # the same deck must always get the same answer


@check(of_run=True, follows=_OF_RAYS)
def single_rays(draft: Draft) -> Iterator[Problem]:
    """Yield the points with a single ray and nothing known of them: they have no position."""
    rays = rays_of(draft)
    alone = np.append((rays.count == 1) & ~rays.horizontal & ~rays.vertical, False)
    message = "point {} has a single ray and no known component: it cannot be used"
    rows, names = rays.sound & alone[draft.point["plates"]], draft.names("points", "plates")
    yield from draft.problems("plates", rows, message, names, path="plates.point", severity="warning")
    for role, what in (("distances", "distance"), ("height_differences", "height difference")):
        for row, end in np.argwhere(alone[draft.point[role]]).tolist():
            name = draft.point_ids[draft.point[role][row, end]]
            message = f"point {name} has a single ray: its {what} cannot be used"
            yield draft.problem(role, row, message, path=f"{role}.point", component=end, severity="warning")


@check(of_run=True, follows=_OF_RAYS)
def photo_rays(draft: Draft) -> Iterator[Problem]:
    """Yield the measured photos whose usable rays and observed station parameters are too few to hold them.

    A photo has six unknowns. A usable ray gives two equations at most, an observed parameter (with a sigma) one.
    """
    photos = len(draft.photo_ids)
    rays = rays_of(draft)
    photo = draft.photo["plates"]
    measured = np.bincount(photo[photo >= 0], minlength=photos)
    usable = np.bincount(photo[rays.usable], minlength=photos)
    components = {role: draft.rows[role][f"{role}.sigma"][:1].size for role in MOTIONS}
    observed = _observed(draft).sum(axis=1) + sum(components[role] * _named(draft, role) for role in MOTIONS)
    stations = draft.photo["stations"]
    cards = [("stations", "photos.ids", row, link) for row, link in enumerate(stations.tolist())]
    if draft.may_lack_station:  # what shows a photo without a station card
        photos_measured, first = np.unique(photo, return_index=True)
        alone = ~np.isin(photos_measured, stations)
        pairs = zip(first[alone].tolist(), photos_measured[alone].tolist(), strict=True)
        cards += [("plates", "plates.photo", row, link) for row, link in pairs]
    for role, path, row, link in cards:
        if link < 0 or not measured[link] or 2 * usable[link] + observed[link] >= _UNKNOWNS:
            continue
        have = f"{_count(usable[link], 'usable ray')} ({measured[link]} measured)"
        held = f"{observed[link] or 'none'} of its six parameters observed"
        need = "three rays are needed, to points with another ray or with control"
        message = f"photo {draft.photo_ids[link]} has {have} and {held}: {need}"
        yield draft.problem(role, row, message, path=path)


def _observed(draft: Draft) -> BoolArray:
    """Return (photos, 6) True for the east, north, up, X-tilt, Y-tilt and heading that have a sigma."""
    position = draft.by_photo("stations", "photos.position_sigma")
    attitude = draft.by_photo("attitudes", "photos.attitude_sigma")
    observed: BoolArray = np.isfinite(np.concatenate([position, attitude], axis=1))
    return observed


def _named(draft: Draft, role: str) -> BoolArray:
    """Return (photos,) whether a card of a role names the photo."""
    return np.isin(np.arange(len(draft.photo_ids)), draft.photo[role])


@check(of_run=True, follows=_OF_RAYS)
def parts(draft: Draft) -> Iterator[Problem]:
    """Yield each part of the block (photos that hang together by usable rays) whose datum is not fixed.

    Two horizontally and three vertically known points fix it, and so does whatever else is observed and holds all
    seven motions: a single component of a station, an angle, an air base, differences of heights. A part of which a
    motion is held by nothing is an error; else, where only the relief of horizontal points can level it, a warning.
    Photos that are wholly observed need nothing more. A free network needs no datum, but it must be one.
    """
    if not len(draft.rows["stations"]) and not draft.may_lack_station:
        return
    rays = rays_of(draft)
    part = _parts(draft, rays)
    numbers = np.unique(part[part >= 0]).tolist()
    free = draft.options.datum is Datum.FREE
    observed = _observed(draft)
    for number in numbers:
        inside = part == number
        if observed[inside].all() or (free and len(numbers) == 1):
            continue
        measured = np.zeros(len(draft.point_ids), dtype=bool)
        measured[draft.point["plates"][rays.usable & np.append(inside, False)[draft.photo["plates"]]]] = True
        known, is_level = _known(draft, rays, inside, measured)
        photos = draft.photo_ids[inside].tolist()
        shown = ", ".join(photos if len(photos) <= 4 else [*photos[:3], "...", photos[-1]])
        part_of = f"the part of the block with photo{'s' if len(photos) > 1 else ''} {shown}"
        name = "the block" if len(numbers) == 1 else part_of
        have = f"has {known}"
        if _motions_held(draft, rays, inside, measured, observed) < _MOTIONS:
            need = f"its datum needs {_HORIZONTAL} horizontal and {_VERTICAL} vertical ones, or observed stations"
            leaving = [words for role, (_, words) in MOTIONS.items() if _named(draft, role)[inside].any()]
            if draft.options.program is Program.IIIA and len(numbers) == 1:
                leaving.append("without them it is a free network (FREE on OP2)")
            need = "; ".join([need, *leaving])
            alone = "" if len(numbers) == 1 else " and hangs together with the rest by nothing"
            yield Problem(file=draft.deck.file, message=f"{name} {have}{alone}: {need}")
        elif not is_level:
            message = f"{name} {have}: only the relief of the horizontal ones levels it"
            yield Problem(file=draft.deck.file, message=message, severity="warning")


def _known(draft: Draft, rays: PlateRays, inside: BoolArray, measured: BoolArray) -> tuple[str, bool]:
    """Return in words how much is known of a part of the block, and whether its heights or tilts level it."""
    observed = _observed(draft)[inside]
    placed = np.any([_named(draft, role)[inside] for role in OF_STATIONS], axis=0)
    observed = observed | (placed[:, None] & (np.arange(_UNKNOWNS) < 3))
    horizontal = observed[:, :2].all(axis=1).sum() + np.count_nonzero(measured & rays.horizontal)
    # A point of which only the height is known helps with two rays or more.
    helpful = rays.vertical & ((rays.triangulated > 1) | rays.horizontal)
    vertical = observed[:, 2].sum() + np.count_nonzero(measured & helpful)
    group, point = _equal_elevations(draft)
    differences = np.maximum(np.bincount(group[measured[point]]) - 1, 0).sum()
    tilts = observed[:, 3:5].any(axis=0).sum() + differences
    others = (
        (observed[:, 5].sum(), "observed heading"),
        (tilts, "levelling condition"),
        (_bases(draft, inside, measured), "air base or distance"),
    )
    known = f"{horizontal or 'no'} horizontally and {vertical or 'no'} vertically known points or stations"
    words = [known, *(_count(number, noun) for number, noun in others if number)]
    return ", ".join(words), bool(vertical + tilts >= _VERTICAL)


def _equal_elevations(draft: Draft) -> tuple[IntArray, IntArray]:
    """Return (k,) the group and (k,) the point of each name on an equal elevation card."""
    points, (_, group) = draft.point["equal_elevations"], draft.equal_elevation_groups
    row, column = np.nonzero((group >= 0)[:, np.newaxis] & (points >= 0))
    return group[row], points[row, column]


def _parts(draft: Draft, rays: PlateRays) -> IntArray:
    """Return (photos,) the number of the part that each photo with usable rays belongs to, -1 without rays.

    Photos hang together by points measured on both, by air bases, and by the points of an equal elevation group.
    """
    photo, photos = draft.photo["plates"], len(draft.photo_ids)
    by_points = np.stack([photo[rows] for rows in common_rays(draft, rays.usable)], axis=1)
    photo_of_point = np.full(len(draft.point_ids) + 1, -1)
    photo_of_point[draft.point["plates"][rays.usable]] = photo[rays.usable]
    group, point = _equal_elevations(draft)
    seen = photo_of_point[point] >= 0
    order = np.argsort(group[seen], kind="stable")
    group, member = group[seen][order], photo_of_point[point][seen][order]
    by_levels = np.stack([member[:-1], member[1:]], axis=1)[group[1:] == group[:-1]]
    links = np.concatenate([by_points, draft.photo["air_bases"], by_levels])
    keys = np.unique(links[(links >= 0).all(axis=1)] @ [photos, 1])  # each pair of photos once
    part = _join(photos, np.stack(np.divmod(keys, max(photos, 1)), axis=1))
    return np.where(np.bincount(photo[rays.usable], minlength=photos) > 0, part, -1)


def _join(count: int, links: IntArray) -> IntArray:
    """Return (count,) the smallest member of the set that each number is in, when `links` (k, 2) join numbers."""
    part = np.arange(count)
    while len(links := np.sort(part[links], axis=1)) and (links[:, 0] < links[:, 1]).any():
        np.minimum.at(part, links[:, 1], links[:, 0])
        while (part[part] < part).any():
            part = part[part]
    return part


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _motions_held(draft: Draft, rays: PlateRays, photos: BoolArray, points: BoolArray, observed: BoolArray) -> int:
    """Return how many motions of a part are held: of its photos (n,) and the points (p,) measured there.

    observed (n, 6): the east, north, up, X-tilt, Y-tilt and heading that have a sigma.
    """
    station, ground = _places(draft, rays, photos, points)
    lengths = np.zeros((_bases(draft, photos, points), _MOTIONS))
    lengths[:, 0] = 1.0  # each holds the scale
    rows = [
        by_change(station)[observed[:, :3] & photos[:, None]],
        by_change(ground)[np.stack([rays.horizontal, rays.horizontal, rays.vertical], axis=1) & points[:, None]],
        _turns(draft)[observed[:, 3:] & photos[:, None]],
        lengths,
        *(part for held, _ in MOTIONS.values() for part in held(draft, station, photos)),
        *_levels(draft, ground, points),
    ]
    return int(np.linalg.matrix_rank(np.concatenate(rows), tol=_FREE))


def _places(draft: Draft, rays: PlateRays, photos: BoolArray, points: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the photos (n, 3) and points (p, 3) about their middle, east, north, up, in units of their extent.

    That is twice the median distance from the middle.
    """
    stations = np.array(metric(draft, "stations", draft.by_photo("stations", ROLES["stations"])))
    for role in OF_STATIONS:
        others = metric(draft, role, draft.by_photo(role, ROLES[role]))
        stations = np.where(np.isnan(stations), others, stations)
    control = np.full((len(points), 3), np.nan)
    link = draft.point["control"]
    control[link[link >= 0]] = draft.rows["control"][ROLES["control"]][link >= 0]
    control = np.array(metric(draft, "control", control))
    control[~rays.horizontal, :2], control[~rays.vertical, 2] = np.nan, np.nan
    if not all(fits_system(draft, role).all() for role in ("stations", "control", *OF_STATIONS)):  # said elsewhere
        stations[:], control[:] = np.nan, np.nan
    both = np.concatenate([stations[photos], control[points]])
    known = np.isfinite(both)
    if not known.any():
        both, known = np.zeros((1, 3)), np.ones((1, 3), dtype=bool)
    middle = np.array([np.median(both[good, k]) if good.any() else 0.0 for k, good in enumerate(known.T)])
    off = np.nanmax(np.abs(both - middle)[known.any(axis=1)], axis=1, initial=0.0)
    extent = 2.0 * float(np.median(off)) or float(off.max()) or 1.0
    rng = np.random.default_rng(_SEED)
    places = []
    for xyz in (stations, control):
        somewhere = rng.uniform(-1.0, 1.0, size=xyz.shape) * np.array([1.0, 1.0, _RELIEF])
        scaled = (xyz - middle) / extent
        places.append(np.where(np.abs(scaled) < _OUTSIDE, scaled, somewhere))
    return places[0], places[1]


def _turns(draft: Draft) -> FloatArray:
    """Return the rows of the angles (n, 3, 7): turns of the block about east, north and up change them."""
    attitude = np.nan_to_num(draft.by_photo("attitudes", "photos.attitude"))
    omega, phi = np.where((np.abs(attitude[:, :2]) > _LEVEL).any(axis=1)[:, None], attitude[:, :2], 0.0).T
    zero, one = np.zeros_like(omega), np.ones_like(omega)
    # the axes about which the angles turn, M = R3(kappa) R2(phi) R1(omega)
    axes = np.stack(
        [
            [one, zero, zero],
            [zero, np.cos(omega), np.sin(omega)],
            [np.sin(phi), -np.cos(phi) * np.sin(omega), np.cos(phi) * np.cos(omega)],
        ]
    )
    rows = np.zeros((len(omega), 3, _MOTIONS))
    rows[:, :, 1:4] = np.linalg.pinv(np.transpose(axes, (2, 1, 0)))
    return rows


def _bases(draft: Draft, photos: BoolArray, points: BoolArray) -> int:
    """Return how many air bases lie between photos and, in IIIA, distances that stand for them between points."""
    count = np.append(photos, False)[draft.photo["air_bases"]].all(axis=1).sum()
    if draft.options.program is Program.IIIA:
        count += np.append(points, False)[draft.point["distances"]].all(axis=1).sum()
    return int(count)


def _levels(draft: Draft, ground: FloatArray, points: BoolArray) -> Iterator[FloatArray]:
    """Yield the rows of equal elevations and, in IIIA, of measured differences of heights."""
    up = by_change(ground)[:, 2]
    inside = np.append(points, False)
    if draft.options.program is Program.IIIA:
        ends = draft.point["height_differences"]
        ends = ends[inside[ends].all(axis=1)]
        yield up[ends[:, 1]] - up[ends[:, 0]]
    group, point = _equal_elevations(draft)
    for number in np.unique(group).tolist():
        points_of_group = np.unique(point[(group == number) & points[point]])
        level = np.array(up[points_of_group])
        level[:, 0] = 0.0  # heights that are the same stay so
        yield level[1:] - level[:1]
