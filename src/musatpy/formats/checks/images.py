"""The rays of a draft, how photos with common points lie; headings, units and cameras that images contradict."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, ComplexArray, FloatArray, IntArray, sums
from musatpy.errors import Problem
from musatpy.formats.checks.check import check
from musatpy.formats.checks.places import far_places
from musatpy.formats.checks.systems import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import ROLES
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.model.block import known_of_kinds, other_focal_length
from musatpy.units import DEGREE, length_unit

_SPREAD = 5.0  # mm: points in common must spread this far (RMS) to turn one photo on to another
_EARTH = 6.371e6  # m, of the sphere on which directions are good enough
FOCAL_LENGTHS = (3.0, 3000.0)  # mm: from drones to reconnaissance cameras
_LIMIT = 45 * DEGREE
_STEEPEST = 20 * DEGREE  # tilts up to which a photo is taken as vertical
_BASE = 5.0  # mm: the neighbour's nadir must lie this far from the photo's own
_AGREEMENT = 0.8  # length of the mean of unit vectors that point the same way
_FEWEST = 3  # control points of a photo that tell a scale
_SAME = 0.1  # relative difference of scales that are the same
_WIDE = 20.0  # mm: the control must spread this far (RMS) on the plate
_EXPLAINED, _UNEXPLAINED = 0.95, 0.8  # shares of the squares of control by its images, as they are and mirrored


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateRays:
    """The m plate measurements of a draft, and what is known of its p points."""

    sound: BoolArray  # (m,) photo, point and coordinates could be read
    usable: BoolArray  # (m,) triangulated, and the point has another triangulated ray, or a known component
    count: IntArray  # (p,) sound measurements, triangulated or not
    triangulated: IntArray  # (p,) sound measurements that are triangulated
    horizontal: BoolArray  # (p,) horizontally known by its control card
    vertical: BoolArray  # (p,) vertically known


def rays_of(draft: Draft) -> PlateRays:
    """Return the rays of a draft."""
    rows, points = draft.rows["plates"], len(draft.point_ids)
    point = draft.point["plates"]
    sound = (draft.photo["plates"] >= 0) & (point >= 0) & ~np.isnan(rows["plates.xy"]).any(axis=1)
    if draft.raw:  # all readings of a point on a photo make one ray
        pairs = np.stack([draft.photo["plates"], point])
        sound &= np.isin(np.arange(len(point)), np.unique(pairs, axis=1, return_index=True)[1])
    triangulated = sound & rows["plates.triangulated"]
    counts = np.bincount(point[triangulated], minlength=points)
    known = known_of_kinds(draft.rows["control"]["control.kind"])
    horizontal, vertical = (draft.points_of("control", known[:, component]) for component in (0, 2))
    helpful = np.append((counts > 1) | horizontal | vertical, False)  # the last: no point
    return PlateRays(
        sound=sound,
        usable=triangulated & helpful[point],
        count=np.bincount(point[sound], minlength=points),
        triangulated=counts,
        horizontal=horizontal,
        vertical=vertical,
    )


def odd_focal_lengths(focal: FloatArray) -> BoolArray:
    """Return (c,) the focal lengths (mm) that no aerial camera has."""
    return (focal > 0.0) & ((focal < FOCAL_LENGTHS[0]) | (focal > FOCAL_LENGTHS[1]))


def by_camera(draft: Draft, path: str, change: Callable[[FloatArray], FloatArray] = np.asarray) -> FloatArray:
    """Return (cameras + 1, ...) what the card of each camera says, NaN without; the last: no camera."""
    values, links = change(draft.rows["cameras"][path]), draft.camera["cameras"]
    out = np.full((len(draft.camera_ids) + 1, *values.shape[1:]), np.nan)
    out[links] = values
    out[-1] = np.nan
    return out


def common_rays(draft: Draft, wanted: BoolArray) -> tuple[IntArray, IntArray]:
    """Return rows (c,), (c,) of measurements of one point on two photos, consecutive ones of the `wanted` (m,)."""
    rows = np.flatnonzero(wanted)
    rows = rows[np.lexsort((draft.photo["plates"][rows], draft.point["plates"][rows]))]
    point = draft.point["plates"][rows]
    same = point[1:] == point[:-1]
    return rows[:-1][same], rows[1:][same]


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoPairs:
    """Pairs of photos, each both ways; y = a x + b from the first's plate coordinates to the second's, complex."""

    first: IntArray  # (k,) link to photos
    second: IntArray  # (k,)
    count: IntArray  # (k,) points in common
    a: ComplexArray  # (k,)
    b: ComplexArray  # (k,) mm


def photo_pairs(draft: Draft, wanted: BoolArray) -> PhotoPairs:
    """Return the pairs of photos whose `wanted` (m,) images in common spread well, by a least squares fit."""
    photo, xy = draft.photo["plates"], draft.rows["plates"]["plates.xy"]
    one, other = common_rays(draft, wanted)
    keys, pair = np.unique(photo[one] * len(draft.photo_ids) + photo[other], return_inverse=True)
    first, second = np.divmod(keys, max(len(draft.photo_ids), 1))
    image = xy[:, 0] + 1j * xy[:, 1]
    count = np.bincount(pair, minlength=len(keys))
    x, y = image[one], image[other]
    mean_x, mean_y = sums(x, pair, len(keys)) / count, sums(y, pair, len(keys)) / count
    x, y = x - mean_x[pair], y - mean_y[pair]
    spread = np.bincount(pair, weights=np.abs(x) ** 2, minlength=len(keys))
    product = sums(np.conj(x) * y, pair, len(keys))
    good = (first != second) & (spread > count * _SPREAD**2) & (np.abs(product) > 0)
    a = product[good] / spread[good]
    b = mean_y[good] - a * mean_x[good]
    return PhotoPairs(
        first=np.concatenate([first[good], second[good]]),
        second=np.concatenate([second[good], first[good]]),
        count=np.tile(count[good], 2),
        a=np.concatenate([a, 1.0 / a]),
        b=np.concatenate([b, -b / a]),
    )


def plan(draft: Draft, position: FloatArray) -> ComplexArray:
    """Return (k,) east + i north (m) of positions (k, 3) of the job, good from one to another near by."""
    if draft.system is CoordinateSystem.LOCAL:
        return position[:, 0] + 1j * position[:, 1]
    if draft.system is CoordinateSystem.GEOCENTRIC:  # latitude and longitude on the sphere
        x, y, z = position.T
        position = np.stack([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)], axis=1)
    good = position[np.isfinite(position).all(axis=1), :2]
    latitude, longitude = good[0] if len(good) else np.zeros(2)
    east = np.angle(np.exp(1j * (position[:, 1] - longitude)))  # across the date line as well
    return _EARTH * (east * np.cos(latitude) + 1j * position[:, 0])


def metric(draft: Draft, role: str, position: FloatArray) -> FloatArray:
    """Return positions (k, 3) on cards of a role as east, north, up in m, good from one to another near by."""
    geocentric = draft.system is CoordinateSystem.GEOCENTRIC
    if not geocentric and not draft.is_angular(role, ROLES[role]).all():
        return position
    level = plan(draft, position)
    height = np.linalg.norm(position, axis=1) if geocentric else position[:, 2]
    return np.stack([level.real, level.imag, height], axis=1)


@check(of_job=True, of_run=True, follows=("stations", "attitudes", "plates", "control"), raw=False)
def headings(draft: Draft) -> Iterator[Problem]:
    """Yield the photos whose heading differs by more than 45 degrees from what the images say (readings say none).

    On a photo without tilt the images lie around the nadir as the ground does around the station, turned by the
    heading. The points in common with a neighbour give the place of the neighbour's nadir on the photo; its
    direction against that of the neighbour's station is the heading, good to a few degrees for small tilts. They
    also give the turn from photo to photo, without the stations. A heading is wrong where both contradict it; where
    only the directions do, some station may be wrong instead, unless all photos are off by the same angle.
    """
    if draft.may_lack_station or not all(fits_system(draft, "stations")):
        return
    attitude = draft.by_photo("attitudes", "photos.attitude")
    pairs, heading = photo_pairs(draft, rays_of(draft).sound), np.exp(1j * attitude[:, 2])
    seen = _by_stations(draft, pairs, attitude)
    off = seen * np.conj(heading)
    wrong = (np.abs(np.angle(off)) > _LIMIT) & (off != 0)  # of a negative zero the angle is half a turn
    contradicted = wrong & (np.abs(np.angle(_by_neighbours(pairs, heading))) > _LIMIT)
    known = off[off != 0]
    if known.size > 1 and wrong[off != 0].all() and abs(known.sum()) > _AGREEMENT * np.abs(known).sum():
        contradicted = wrong
    if contradicted.any() and (mirror_images(draft) or any(far_places(draft))):
        return  # which turns them too
    for row, link in enumerate(draft.photo["attitudes"].tolist()):
        if link >= 0 and contradicted[link]:
            given, image = attitude[link, 2] / DEGREE, np.angle(seen[link]) / DEGREE
            message = f"a heading of {round(given)} degrees, where the images point to about {round(image)}"
            yield draft.problem("attitudes", row, message, path="photos.attitude", component=2, severity="warning")


def _by_stations(draft: Draft, pairs: PhotoPairs, attitude: FloatArray) -> ComplexArray:
    """Return (photos,) unit vectors of the headings that the neighbours' nadirs and stations give, else 0."""
    ground = plan(draft, draft.by_photo("stations", "photos.position"))
    neighbour, photo, nadir = pairs.first, pairs.second, pairs.b  # where the neighbour's is on the photo
    turn = (ground[neighbour] - ground[photo]) * np.conj(nadir)  # direction on the ground less that on the plate
    level = np.abs(attitude[:, :2]).max(axis=1, initial=0) < _STEEPEST
    good = level[photo] & level[neighbour] & (np.abs(nadir) > _BASE) & (np.abs(turn) > 0)
    return _mean_directions(photo[good], turn[good], pairs.count[good], len(attitude))


def _by_neighbours(pairs: PhotoPairs, heading: ComplexArray) -> ComplexArray:
    """Return (photos,) unit vectors of how far each heading is off if its neighbours' are right, else 0."""
    # y = a x turns by the heading of the first photo less that of the second.
    off = pairs.a * np.conj(heading[pairs.first]) * heading[pairs.second]
    good = np.abs(off) > 0
    return _mean_directions(pairs.first[good], off[good], pairs.count[good], len(heading))


def _mean_directions(photo: IntArray, vectors: ComplexArray, weight: IntArray, photos: int) -> ComplexArray:
    """Return (photos,) unit vectors of the weighted mean directions, 0 where there are none or they disagree."""
    total = sums(weight * vectors / np.abs(vectors), photo, photos)
    agree = np.abs(total) > _AGREEMENT * np.bincount(photo, weights=weight, minlength=photos)
    return np.where(agree, total / np.where(agree, np.abs(total), 1), 0)


@check(of_job=True, of_run=True, follows=("stations", "attitudes", "plates", "control"), raw=False)
def scales(draft: Draft) -> Iterator[Problem]:
    """Yield a unit, or another camera, that most photos with control agree on (not in geocentric jobs).

    On a photo without tilt the control lies as on the plate, at H/f times its size. Tilts and relief make that
    wrong by some percent, units and cameras by much more.
    """
    if draft.may_lack_station or draft.system is CoordinateSystem.GEOCENTRIC:
        return
    if not all(fits_system(draft, role).all() for role in ("stations", "control")):
        return
    ratios = _ratios(draft)
    ratio = float(np.median(ratios)) if len(ratios) else 1.0
    if abs(ratio - 1.0) < _SAME or not np.all(np.abs(ratios / ratio - 1.0) < _SAME):
        return
    if mirror_images(draft) or any(far_places(draft)):
        return  # which widen it too
    for factor, text in (
        (ratio, "control were in feet and stations in metres"),
        (1.0 / ratio, "stations were in feet and control in metres"),
    ):
        if length_unit(factor, _SAME) == "feet":
            message = f"the control is {ratio:.2f} times as wide as on the photos, as if {text}"
            yield draft.problem("control", 0, message, path="control.position", severity="warning")
            return
    focal = draft.rows["cameras"]["cameras.focal_length"]
    if odd_focal_lengths(focal).any():
        return  # as its card is told
    other = other_focal_length(float(np.median(focal)), ratio, _SAME)
    if other:
        wide = f"the control is {ratio:.2f} times as wide as on the photos"
        message = f"{wide}, as if the focal length were {other:g} mm"
        yield draft.problem("cameras", 0, message, path="cameras.focal_length", severity="warning")


def _control_images(draft: Draft) -> tuple[FloatArray, ComplexArray, ComplexArray, FloatArray]:
    """Return what the n photos with control enough show of it, on land: through the water they show it nearer.

    About the means of each photo, with image x (mm) and ground g (m): sums (n,) of |g|^2, of conj(x) g and of
    x g, each over that of |x|^2, NaN of other photos; and (n,) m, the mean height of the control.
    """
    rows, links = draft.rows["control"], draft.point["control"]
    full = (rows["control.kind"] == ControlKind.FULL) & (links >= 0) & np.append(~draft.bathymetric, False)[links]
    position = np.full((len(draft.point_ids) + 1, 3), np.nan)  # the last: no point
    position[links[full]] = rows["control.position"][full]
    ground, photo, point = plan(draft, position), draft.photo["plates"], draft.point["plates"]
    seen = rays_of(draft).sound & np.isfinite(ground[point]) & np.isfinite(position[point, 2])
    photo, point = photo[seen], point[seen]
    image = (draft.rows["plates"]["plates.xy"] @ np.array([1.0, 1j]))[seen]

    def total(values: FloatArray | ComplexArray) -> ComplexArray:
        return sums(np.asarray(values, dtype=complex), photo, len(draft.photo_ids))

    count = np.maximum(total(np.ones(len(photo))).real, 1.0)
    x = image - (total(image) / count)[photo]
    g = ground[point] - (total(ground[point]) / count)[photo]
    squares = total(np.abs(x) ** 2).real
    good = (count >= _FEWEST) & (squares > count * _WIDE**2)
    squares = np.where(good, squares, np.nan)
    height = total(position[point, 2]).real / count
    with np.errstate(invalid="ignore"):
        return total(np.abs(g) ** 2).real / squares, total(np.conj(x) * g) / squares, total(x * g) / squares, height


def mirror_images(draft: Draft) -> bool:
    """Return whether all photos with control enough show it as a mirror does (not in geocentric jobs)."""
    if draft.system is CoordinateSystem.GEOCENTRIC or not fits_system(draft, "control").all():
        return False
    ground, turned, mirrored, _ = _control_images(draft)
    with np.errstate(divide="ignore", invalid="ignore"):
        as_it_is, as_mirrored = np.abs(turned) ** 2 / ground, np.abs(mirrored) ** 2 / ground
    known = np.isfinite(as_mirrored)
    return bool(known.any() and ((as_mirrored > _EXPLAINED) & (as_it_is < _UNEXPLAINED))[known].all())


def _ratios(draft: Draft) -> FloatArray:
    """Return, of each photo with enough control, the width of the control over that on the photo by its station.

    Of control on land: another camera would explain what the water does as well.
    """
    _, scale, _, height = _control_images(draft)
    above = draft.by_photo("stations", "photos.position")[:, 2] - height
    focal = by_camera(draft, "cameras.focal_length")
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.abs(scale) * focal[draft.camera_of_photo] / above
    return ratios[np.isfinite(ratios) & (ratios > 0.0)]
