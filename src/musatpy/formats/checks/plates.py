"""Plate coordinates that cannot be, zeros of cards that were not punched, and what raw plates need."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import Problem
from musatpy.formats.checks.check import check
from musatpy.formats.checks.images import by_camera, common_rays, mirror_images, photo_pairs, rays_of
from musatpy.formats.checks.references import repeats
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import ROLES
from musatpy.model import Atmosphere, CoordinateSystem, Curvature, Program, Refused, Transformation

_SOME, _SMALL = 3, 0.01  # images of a camera, and the share of its format in which all of them do not lie
_MANY = 30  # images, of which some lie on either side of a principal point
_MICROMETRES = 500.0  # of a format in mm: half of it in the smaller unit
_INTERIOR = {"F": 0, "XP": 1, "YP": 2}
_POLYNOMIALS = {"RADL": ("K1", "K2", "K3"), "DCEN": ("P1", "P2")}
_CONTRADICTS = 5.0  # standard deviations between two values of one parameter
_FOCAL_LENGTHS_OFF = 5.0  # 79 degrees off the axis: no frame camera has images farther out
_NEAR = 30.0  # mm: so well the images of another photo say where one is
_AROUND = 3.0  # extents of all other positions, beyond which zeros are no position
_OF_REDUCTION = (
    *("distortion", "fiducials", "fiducial_measurements"),
    *("comparator", "lenses", "mark_distances", "reseau", "cross_measurements"),
)
_MARKS = {Transformation.SIMILARITY: 2, Transformation.AFFINE: 3, Transformation.PROJECTIVE: 4}
_DIRECTIONS = (("X", "Y"), ("D1", "D2"))  # the axes of side marks, the diagonals of corner marks


def _camera_of_plates(draft: Draft) -> IntArray:
    """Return (m,) the camera of each plate measurement, -1 where it is not known."""
    return np.append(draft.camera_of_photo, -1)[draft.photo["plates"]]


@check(raw=False)
def plate_coordinates(draft: Draft) -> Iterator[Problem]:
    """Yield the plate coordinates outside the format of their camera; readings lie anywhere.

    Those outside by more than half the format are errors; without a format, those that no frame camera has. Images
    that count from a corner are one warning.
    """
    camera, xy = _camera_of_plates(draft), draft.rows["plates"]["plates.xy"]
    size, focal = by_camera(draft, "cameras.format_size")[camera], by_camera(draft, "cameras.focal_length")[camera]
    known, middle = size > 0, by_camera(draft, "cameras.principal_point")[camera]
    off = xy - np.where(np.abs(middle) > size / 4, middle, 0.0)  # plates may count from a corner
    reach = np.where(focal > 0, _FOCAL_LENGTHS_OFF * focal, np.inf)[:, np.newaxis]
    far = np.abs(off) > np.where(known, size, np.where(np.isnan(size), reach, np.inf))
    outside = known & (np.abs(off) > size / 2) | far
    for link in np.unique(camera[far.any(axis=1)]).tolist():
        of_camera = camera == link
        out = np.flatnonzero(of_camera & far.any(axis=1))
        if of_camera.sum() >= _SOME and 2 * len(out) > of_camera.sum():
            in_um = (np.abs(xy[of_camera]) <= _MICROMETRES * np.maximum(size[of_camera], 1.0)).all()
            of_corner = (xy[of_camera] >= 0.0).all()
            unit = ", these look like pixels" if of_corner else ", these look like micrometres" if in_um else ""
            message = (
                f"{len(out)} of the {of_camera.sum()} images of camera {draft.camera_ids[link]} lie far outside "
                f"its format: millimetres are needed{unit}"
            )
            yield draft.problem("plates", int(out[0]), message, path="plates.xy")
            outside[of_camera] = False
    for link in np.unique(camera[outside.any(axis=1)]).tolist():
        rows = np.flatnonzero((camera == link) & np.isfinite(off).all(axis=1))
        if len(rows) >= _MANY and (np.abs(np.sign(off[rows]).sum(axis=0)) == len(rows)).all():
            x, y = 0.5 * (xy[rows].min(axis=0) + xy[rows].max(axis=0))
            message = (
                f"all {len(rows)} images of camera {draft.camera_ids[link]} lie to one side of its principal point "
                f"in x, and in y: if they count from a corner, CAM has a principal point near {x:.1f}, {y:.1f}"
            )
            yield draft.problem("plates", int(rows[0]), message, path="plates.xy", severity="warning")
            outside[rows] = False
    for component, name in enumerate("xy"):
        for row in np.flatnonzero(outside[:, component]).tolist():
            what = f"{name} = {xy[row, component]:g} mm lies"
            owner = f"of camera {draft.camera_ids[camera[row]]}"
            message = f"{what} outside the format of {size[row, component]:g} mm {owner}"
            if not known[row, component]:
                message = f"{what} {_FOCAL_LENGTHS_OFF:g} focal lengths off the axis {owner}, which has no format"
            severity: Literal["error", "warning"] = "error" if far[row, component] else "warning"
            yield draft.problem("plates", row, message, path="plates.xy", component=component, severity=severity)


@check(of_job=True, raw=False, follows=("control", "plates"))
def mirrored(draft: Draft) -> Iterator[Problem]:
    """Yield once that the images are mirror images of the control: no camera makes them."""
    if mirror_images(draft) and not any(plate_coordinates(draft)):
        message = (
            "the images are mirror images of the control: x and y, or two coordinates of the control, are "
            "exchanged, or one has the wrong sign on all cards"
        )
        yield draft.problem("plates", 0, message, path="plates.xy", severity="warning")


@check(raw=False)
def small_plates(draft: Draft) -> Iterator[Problem]:
    """Yield the first image of each camera all of whose images lie near the middle of its format: another unit."""
    camera, xy = _camera_of_plates(draft), np.abs(draft.rows["plates"]["plates.xy"])
    sizes = draft.rows["cameras"]["cameras.format_size"]
    for link, size in zip(draft.camera["cameras"].tolist(), sizes, strict=True):
        rows = np.flatnonzero((camera == link) & (link >= 0) & np.isfinite(xy).all(axis=1))
        if len(rows) >= _SOME and (xy[rows] <= _SMALL * size).all() and xy[rows].any():
            message = (
                f"all {len(rows)} images of camera {draft.camera_ids[link]} lie within a hundredth of its "
                "format: are they in millimetres?"
            )
            yield draft.problem("plates", int(rows[0]), message, path="plates.xy", severity="warning")


@check()
def plates_at_zero(draft: Draft) -> Iterator[Problem]:
    """Yield the images at x = y = 0 that cannot be there: a card that was not punched reads as one.

    Two of different points on one photo (a single one may lie at the principal point), and one that the same
    point on another photo does not put there. One of which no other photo tells is an error where the principal
    point lies elsewhere, else a warning.
    """
    rows, photo = draft.rows["plates"], draft.photo["plates"]
    zero = _at_zero(rows["plates.xy"])
    if not zero.any():
        return
    several = _several(zero, photo, draft.point["plates"])
    distance = np.full(len(zero), np.nan) if draft.raw else _distances(draft, zero)
    centre = by_camera(draft, "cameras.principal_point", np.nan_to_num)
    centred = _at_zero(centre)[_camera_of_plates(draft)]
    for row in np.flatnonzero(zero).tolist():
        where = ""
        severity: Literal["error", "warning"] = "error"
        if several[row]:
            where = ", and of another one on the photo"
        elif distance[row] > _NEAR:
            where = f", which by other photos lies {distance[row]:.0f} mm from there"
        elif draft.raw or not np.isnan(distance[row]):
            continue
        elif centred[row]:
            severity = "warning"
        name = draft.point_ids[draft.point["plates"][row]]
        message = f"x = y = 0 of point {name}{where}: an image that was not punched reads so"
        yield draft.problem("plates", row, message, path="plates.xy", severity=severity)


def _distances(draft: Draft, zero: BoolArray) -> FloatArray:
    """Return how far (m,) mm from zero each image lies by another photo, the least; NaN where none tells."""
    photo, xy = draft.photo["plates"], draft.rows["plates"]["plates.xy"]
    image, sound, count = xy[:, 0] + 1j * xy[:, 1], rays_of(draft).sound, len(draft.photo_ids)
    pairs, rays = photo_pairs(draft, sound & ~zero), np.array(common_rays(draft, sound))
    one, other = np.concatenate([rays, rays[::-1]], axis=1)
    fits = {key: row for row, key in enumerate((pairs.first * count + pairs.second).tolist())}
    place = np.array([fits.get(key, -1) for key in (photo[one] * count + photo[other]).tolist()], dtype=np.int64)
    one, other, place = one[place >= 0], other[place >= 0], place[place >= 0]
    out = np.full(len(photo), np.nan)
    np.fmin.at(out, other, np.abs(pairs.a[place] * image[one] + pairs.b[place]))
    return out


@check()
def marks_at_zero(draft: Draft) -> Iterator[Problem]:
    """Yield the fiducial marks and crosses at 0/0 of which one camera, or photo, has several."""
    for role in ("fiducials", "fiducial_measurements", "reseau", "cross_measurements"):
        rows, path = draft.rows[role], f"{role}.xy"
        owners = draft.photo[role] if role in draft.photo else draft.camera[role]
        names = np.unique(rows[f"{role}.ids"], return_inverse=True)[1].reshape(-1)
        several = _several(_at_zero(rows[path]), owners, names)
        message = "x = y = 0, and so has another one: marks that were not punched read so"
        yield from draft.problems(role, several, message, path=path)


@check()
def positions_at_zero(draft: Draft) -> Iterator[Problem]:
    """Yield stations and control points at 0/0 where several are, or where nothing else is near."""
    for role, what in (("stations", "the station"), ("control", "the control point")):
        path = ROLES[role]
        names = draft.photo["stations"] if role == "stations" else draft.point["control"]
        zero = _at_zero(draft.rows[role][path][:, :2])
        several = _several(zero, np.zeros(len(zero), dtype=np.int64), names)
        message = f"zeros for the position of {what}, {{}}: a card that was not punched reads so"
        why = np.where(several, "as of another one", "far from all others")
        yield from draft.problems(role, zero & (several | ~_reached(draft, role, zero)), message, why, path=path)


def _reached(draft: Draft, role: str, zero: BoolArray) -> BoolArray:
    """Return (k,) whether zeros on a card of a role lie about all other positions on cards of its words."""
    out = np.ones(len(zero), dtype=bool)
    for angular in (True, False):
        others = []
        for one in ("stations", "control"):
            xy = draft.rows[one][ROLES[one]][:, :2]
            alike = (draft.is_angular(one, ROLES[one]) == angular) & ~_at_zero(xy) & np.isfinite(xy).all(axis=1)
            others.append(xy[alike])
        xy = np.concatenate(others)
        if len(xy) > 1:
            low, high = xy.min(axis=0), xy.max(axis=0)
            far = bool((_AROUND * (high - low).max() < np.maximum(low, -high)).any())
            out[(draft.is_angular(role, ROLES[role]) == angular) & far] = False
    return out


def _at_zero(xy: FloatArray) -> BoolArray:
    return (xy == 0.0).all(axis=1)


def _several(zero: BoolArray, owner: IntArray, name: IntArray) -> BoolArray:
    """Return (k,) the zeros whose owner has zeros of another name too; -1 is no owner and no name."""
    out = np.zeros(len(zero), dtype=bool)
    counts = zero & (owner >= 0) & (name >= 0)
    for one in np.unique(owner[counts]).tolist():
        of_owner = counts & (owner == one)
        out[of_owner] = len(np.unique(name[of_owner])) > 1
    return out


@check(raw=False)
def plates_taken_as_refined(draft: Draft) -> Iterator[Problem]:
    """Yield once for each kind of card that plate reduction would need: such cards are carried, not applied.

    But the distortion of lenses that are estimated: the adjustment starts from it.
    """
    for role in _OF_REDUCTION:
        carried = np.ones(len(draft.rows[role]), dtype=bool)
        if role in ("distortion", "lenses"):
            carried = ~np.isin(draft.camera[role], draft.camera["lens_unknowns"])
        if number := int(carried.sum()):
            count = "1 card" if number == 1 else f"{number} cards"
            message = f"plate coordinates are taken as refined: {count} carried and listed, not applied"
            yield draft.problem(role, int(carried.argmax()), message, severity="warning")


@check(of_card=True)
def lenses(draft: Draft) -> Iterator[Problem]:
    """Yield principal points of best symmetry of which a coordinate is missing."""
    half = np.isnan(draft.rows["lenses"]["lenses.centre"])
    for row in np.flatnonzero(half.any(axis=1) & ~half.all(axis=1)).tolist():
        component = int(half[row].argmax())
        if draft.lacks("lenses", row, "lenses.centre", component):
            message = "the principal point of best symmetry needs both x and y, or neither"
            yield draft.problem("lenses", row, message, path="lenses.centre", component=component)


@check(of_run=True)
def lens_unknowns(draft: Draft) -> Iterator[Problem]:
    """Yield what of the unknowns of lenses cannot be estimated, or is held."""
    role, camera = "lens_unknowns", draft.camera["lens_unknowns"]
    free = np.isnan(draft.rows[role]["lens_unknowns.sigma"])
    if draft.options.program is Program.IIA and free.any():
        message = "MUSAT-IIA holds cameras: of a lens only values, and standard deviations, count"
        row = int(np.flatnonzero(free)[0])
        yield draft.problem(role, row, message, path="lens_unknowns.sigma", severity="warning")
    photos = _counts(draft.camera["stations"], len(draft.camera_ids))
    for number in np.unique(camera[free & (photos[camera] == 1)]).tolist():
        row = int(np.flatnonzero(camera == number)[0])
        message = f"camera {draft.camera_ids[number]} took one photo: its lens can hardly be told from its station"
        yield draft.problem(role, row, message, path="lens_unknowns.camera", severity="warning")
    apart = draft.camera["lenses"][np.isfinite(draft.rows["lenses"]["lenses.centre"]).any(axis=1)]
    others = np.isin(camera, apart)
    message = "a lens with a principal point of best symmetry of its own (LNS) cannot be estimated"
    yield from draft.problems(role, others, message, path="lens_unknowns.camera")


@check(of_run=True)
def lens_values(draft: Draft) -> Iterator[Problem]:
    """Yield values of CAL cards that lie many of their standard deviations off those of CAM and DST."""
    cameras, distortion, cal = (draft.rows[role] for role in ("cameras", "distortion", "lens_unknowns"))
    given: dict[tuple[int, str], float] = {}
    for name, column in _INTERIOR.items():
        values = np.column_stack([cameras["cameras.focal_length"], cameras["cameras.principal_point"]])[:, column]
        given |= {
            (link, name): value
            for link, value in zip(draft.camera["cameras"].tolist(), values.tolist(), strict=True)
        }
    for link, kind, values in zip(
        draft.camera["distortion"].tolist(),
        distortion["distortion.kind"],
        distortion["distortion.values"],
        strict=True,
    ):
        given |= {
            (link, name): float(value) for name, value in zip(_POLYNOMIALS.get(kind, ()), values, strict=False)
        }
    for row, (link, name, value, sigma) in enumerate(
        zip(
            draft.camera["lens_unknowns"].tolist(),
            *(cal[f"lens_unknowns.{column}"].tolist() for column in ("parameter", "value", "sigma")),
            strict=True,
        )
    ):
        other = given.get((link, name), 0.0)
        off = abs(value - other) / sigma if other and sigma else 0.0  # zero says nothing
        if off > _CONTRADICTS:
            message = f"{off:.0f} standard deviations off the {other:g} of CAM or DST, which does not count"
            yield draft.problem("lens_unknowns", row, message, path="lens_unknowns.value", severity="warning")


@check(raw=True)
def distortions(draft: Draft) -> Iterator[Problem]:
    """Yield what cannot be used of the distortion of cameras with raw plates: second records, radii that repeat."""
    role, camera = "distortion", draft.camera["distortion"]
    kind, (radius, value) = draft.rows[role]["distortion.kind"], draft.rows[role]["distortion.values"].T[:2]
    for name in ("RADL", "DCEN"):
        for row, first in repeats(np.where(kind == name, camera, -1)):
            message = f"the {name} distortion of camera {draft.camera_ids[camera[row]]} is already given"
            yield draft.problem(role, row, f"{message} {draft.place(role, first)}", path="distortion.kind")
    table = np.where((kind == "TABL") & ~np.isnan(radius), camera, -1)
    for row, first in repeats(table, np.unique(radius, return_inverse=True)[1].reshape(-1)):
        message = f"the distortion at this radius is already given {draft.place(role, first)}"
        yield draft.problem(role, row, message, path="distortion.values", component=0)
    bad = (table >= 0) & ((radius < 0.0) | ((radius == 0.0) & (value != 0.0)))
    message = "a calibrated radius must be greater than zero, or zero without distortion"
    yield from draft.problems(role, bad, message, path="distortion.values", component=0)


@check(raw=True, of_run=True)
def calibrations(draft: Draft) -> Iterator[Problem]:
    """Yield the cameras of raw plates that lack what the fiducial transformation goes by."""
    options = draft.reduction
    if options is None or options.transformation is Transformation.NONE:
        return
    cameras = len(draft.camera_ids)
    if options.transformation is Transformation.DISTANCES:
        role, lacking = "mark_distances", np.ones(cameras, dtype=bool)
        axis, camera = draft.rows[role][f"{role}.axis"], draft.camera[role]
        for pair in _DIRECTIONS:
            lacking &= ~np.all([_counts(camera[axis == name], cameras) > 0 for name in pair], axis=0)
        message = "no distances along both axes (X and Y) or both diagonals (D1 and D2)"
    else:
        role, needed = "fiducials", _MARKS[options.transformation]
        marks = _counts(draft.camera[role], cameras)
        lacking = (marks < needed) & ((marks > 0) | (_counts(draft.camera["reseau"], cameras) == 0))
        message = f"fewer than the {needed} calibrated marks of a transformation {options.transformation}"
    lacking &= np.isin(np.arange(cameras), _cameras_of_plates(draft))
    rows, names = np.append(lacking, False)[draft.camera["cameras"]], draft.names("cameras", "cameras")
    text = f"camera {{}} has {message} ({draft.cards(role)})"
    yield from draft.problems("cameras", rows, text, names, path="cameras.ids")


@check(raw=True)
def reseaux(draft: Draft) -> Iterator[Problem]:
    """Yield the reseaux of cameras with raw plates that have no cell: fewer than two rows or columns."""
    places = np.stack([draft.rows["reseau"][f"reseau.{name}"] for name in ("row", "column")])
    for link in _cameras_of_plates(draft).tolist():
        crosses = np.flatnonzero(draft.camera["reseau"] == link)
        if len(crosses) and min(len(np.unique(place)) for place in places[:, crosses]) < 2:
            message = f"the reseau of camera {draft.camera_ids[link]} has not two rows and two columns of crosses"
            yield draft.problem("reseau", int(crosses[0]), message, path="reseau.camera")


@check(raw=True, of_run=True)
def unmeasured_marks(draft: Draft) -> Iterator[Problem]:
    """Yield the raw plates on which no fiducial mark is measured, nor crosses that stand for them.

    They will be refused: an error where that stops the run, a warning where it goes on.
    """
    options = draft.reduction
    if options is None or options.transformation is Transformation.NONE:
        return
    without_marks = np.append(_counts(draft.camera["fiducials"], len(draft.camera_ids)) == 0, False)
    by_crosses = without_marks[draft.camera_of_photo] & (options.transformation is not Transformation.DISTANCES)
    unmeasured = ~(_measured(draft, "fiducial") | by_crosses & _measured(draft, "cross"))
    message = f"photo {{}} has no measured fiducial marks ({draft.cards('fiducial_measurements')})"
    severity: Literal["error", "warning"] = "error" if options.refused is Refused.STOP else "warning"
    yield from _of_plates(draft, unmeasured, message, severity)


@check(raw=True, of_run=True)
def unmeasured_crosses(draft: Draft) -> Iterator[Problem]:
    """Yield once the raw plates of a camera with a reseau on which no cross is measured."""
    with_reseau = np.append(_counts(draft.camera["reseau"], len(draft.camera_ids)) > 0, False)
    lacking = with_reseau[draft.camera_of_photo] & ~_measured(draft, "cross")
    count = len(_first_plates(draft, lacking))
    more = f", like {count - 1} more," if count > 1 else ""
    cards = draft.cards("cross_measurements")
    message = f"photo {{}}{more} has no measured crosses ({cards}): its film deformation is not corrected"
    yield from list(_of_plates(draft, lacking, message, "warning"))[:1]


@check(raw=True)
def curvature(draft: Draft) -> Iterator[Problem]:
    """Yield a correction of the earth's curvature in a job that is not in a grid."""
    options = draft.reduction
    if options and options.curvature is Curvature.YES and draft.system is not CoordinateSystem.LOCAL:
        message = f"earth curvature belongs to jobs in a grid (LOCL), not to {draft.system} ones"
        yield draft.problem("reduction", 0, message, path="reduction.curvature")


@check(raw=True, of_run=True)
def heights(draft: Draft) -> Iterator[Problem]:
    """Yield refraction or curvature without the heights of the ground and of every station."""
    options, path = draft.reduction, "reduction.ground_height"
    if options is None or (options.atmosphere is Atmosphere.NONE and options.curvature is Curvature.NO):
        return
    if draft.lacks("reduction", 0, path):
        yield draft.problem("reduction", 0, "refraction and curvature need the height of the ground", path=path)
    if draft.may_lack_station:  # else other checks miss the stations
        unknown = np.isnan(draft.by_photo("stations", "photos.position")).any(axis=1)
        message = "photo {} has no station card: refraction and curvature need its height"
        yield from _of_plates(draft, unknown, message, "error")


@check(raw=True)
def flags(draft: Draft) -> Iterator[Problem]:
    """Yield the readings of a point whose flag is not that of its first reading on the photo."""
    taken = draft.rows["plates"]["plates.triangulated"]
    for row, first in repeats(draft.photo["plates"], draft.point["plates"]):
        if taken[row] != taken[first]:
            message = f"the reading {draft.place('plates', first)} says otherwise"
            yield draft.problem("plates", row, message, path="plates.triangulated")


def _first_plates(draft: Draft, wanted: BoolArray) -> IntArray:
    """Return the rows of the plate cards that name each of the `wanted` (photos,) first."""
    links, first = np.unique(draft.photo["plates"], return_index=True)
    return first[(links >= 0) & wanted[links]]


def _of_plates(
    draft: Draft, wanted: BoolArray, message: str, severity: Literal["error", "warning"]
) -> Iterator[Problem]:
    """Return a problem of each of the `wanted` (photos,) with plates, whose name stands for `{}` of the message."""
    rows, names = _first_plates(draft, wanted), draft.names("photos", "plates")
    return draft.problems("plates", rows, message, names, path="plates.photo", severity=severity)


def _cameras_of_plates(draft: Draft) -> IntArray:
    """Return the cameras of the photos that have plates."""
    cameras = np.unique(_camera_of_plates(draft)[draft.photo["plates"] >= 0])
    return cameras[cameras >= 0]


def _measured(draft: Draft, what: str) -> BoolArray:
    """Return (photos,) True where a fiducial or a cross is measured."""
    return _counts(draft.photo[f"{what}_measurements"], len(draft.photo_ids)) > 0


def _counts(links: IntArray, size: int) -> IntArray:
    return np.bincount(links[links >= 0], minlength=size)
