"""Raw plates: what their reduction needs of other cards, and what it cannot be asked for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from musatpy.arrays import BoolArray, IntArray
from musatpy.errors import Problem
from musatpy.formats.checks.identities import repeats
from musatpy.formats.draft import Draft
from musatpy.model import Atmosphere, CoordinateSystem, Curvature, Refused, Transformation

_MARKS = {Transformation.SIMILARITY: 2, Transformation.AFFINE: 3, Transformation.PROJECTIVE: 4}
_DIRECTIONS = (("X", "Y"), ("D1", "D2"))  # the axes of side marks, the diagonals of corner marks


def lenses(draft: Draft) -> Iterator[Problem]:
    """Yield principal points of best symmetry of which a coordinate is missing."""
    half = np.isnan(draft.rows["lenses"]["lenses.centre"])
    for row in np.flatnonzero(half.any(axis=1) & ~half.all(axis=1)).tolist():
        component = int(half[row].argmax())
        if draft.lacks("lenses", row, "lenses.centre", component):
            message = "the principal point of best symmetry needs both x and y, or neither"
            yield draft.problem("lenses", row, message, path="lenses.centre", component=component)


def distortions(draft: Draft) -> Iterator[Problem]:
    """Yield what cannot be used of the distortion of cameras with raw plates: second records, radii that repeat."""
    if not draft.raw:
        return
    rows, camera = draft.rows["distortion"], draft.camera["distortion"]
    kind, radius = rows["distortion.kind"], rows["distortion.values"][:, 0]
    for name in ("RADL", "DCEN"):
        for row, first in repeats(np.where(kind == name, camera, -1)):
            message = f"the {name} distortion of camera {draft.camera_ids[camera[row]]} is already given"
            yield draft.problem(
                "distortion", row, f"{message} {draft.place('distortion', first)}", path="distortion.kind"
            )
    table = np.where((kind == "TABL") & ~np.isnan(radius), camera, -1)
    for row, first in repeats(table, np.unique(radius, return_inverse=True)[1].reshape(-1)):
        message = f"the distortion at this radius is already given {draft.place('distortion', first)}"
        yield draft.problem("distortion", row, message, path="distortion.values", component=0)
    bad = (table >= 0) & ((radius < 0.0) | ((radius == 0.0) & (rows["distortion.values"][:, 1] != 0.0)))
    message = "a calibrated radius must be greater than zero, or zero without distortion"
    yield from draft.problems("distortion", bad, message, path="distortion.values", component=0)


def calibrations(draft: Draft) -> Iterator[Problem]:
    """Yield the cameras of raw plates that lack what the fiducial transformation goes by."""
    options = draft.reduction
    if not draft.raw or options is None or options.transformation is Transformation.NONE:
        return
    cameras = len(draft.camera_ids)
    crosses = _counts(draft.camera["reseau"], cameras)
    used = _counts(draft.camera_of_photo[_photos(draft)], cameras) > 0
    if options.transformation is Transformation.DISTANCES:
        lacking, role = ~_with_axes(draft), "mark_distances"
        message = "no distances along both axes (X and Y) or both diagonals (D1 and D2)"
    else:
        needed, role = _MARKS[options.transformation], "fiducials"
        marks = _counts(draft.camera[role], cameras)
        lacking = (marks < needed) & ((marks > 0) | (crosses == 0))
        message = f"fewer than the {needed} calibrated marks of a transformation {options.transformation}"
    for row, link in enumerate(draft.camera["cameras"].tolist()):
        if link >= 0 and used[link] and lacking[link]:
            text = f"camera {draft.camera_ids[link]} has {message} ({draft.cards(role)})"
            yield draft.problem("cameras", row, text, path="cameras.ids")


def reseaux(draft: Draft) -> Iterator[Problem]:
    """Yield the reseaux of cameras with raw plates that have no cell: fewer than two rows or columns."""
    if not draft.raw:
        return
    rows, camera = draft.rows["reseau"], draft.camera["reseau"]
    for link in np.unique(draft.camera_of_photo[_photos(draft)]).tolist():
        crosses = np.flatnonzero((camera == link) & (camera >= 0))
        if (
            len(crosses)
            and min(len(np.unique(rows[path][crosses])) for path in ("reseau.row", "reseau.column")) < 2
        ):
            message = f"the reseau of camera {draft.camera_ids[link]} has not two rows and two columns of crosses"
            yield draft.problem("reseau", int(crosses[0]), message, path="reseau.camera")


def unmeasured_marks(draft: Draft) -> Iterator[Problem]:
    """Yield the raw plates on which no fiducial mark is measured, nor crosses that stand for them.

    They will be refused: an error where that stops the run, a warning where it goes on.
    """
    options = draft.reduction
    if not draft.raw or options is None or options.transformation is Transformation.NONE:
        return
    photos = len(draft.photo_ids)
    without_marks = np.append(_counts(draft.camera["fiducials"], len(draft.camera_ids)) == 0, False)
    by_crosses = without_marks[draft.camera_of_photo] & (options.transformation is not Transformation.DISTANCES)
    measured = _counts(draft.photo["fiducial_measurements"], photos) > 0
    measured |= by_crosses & (_counts(draft.photo["cross_measurements"], photos) > 0)
    severity: Literal["error", "warning"] = "error" if options.refused is Refused.STOP else "warning"
    message = f"photo {{}} has no measured fiducial marks ({draft.cards('fiducial_measurements')})"
    rows, names = _plates_of(draft, ~measured), draft.names("photos", "plates")
    yield from draft.problems("plates", rows, message, names, path="plates.photo", severity=severity)


def unmeasured_crosses(draft: Draft) -> Iterator[Problem]:
    """Yield once the raw plates of a camera with a reseau on which no cross is measured."""
    if not draft.raw:
        return
    crosses = _counts(draft.camera["reseau"], len(draft.camera_ids))
    lacking = np.append(crosses > 0, False)[draft.camera_of_photo]
    lacking &= _counts(draft.photo["cross_measurements"], len(draft.photo_ids)) == 0
    rows, cards = _plates_of(draft, lacking), draft.cards("cross_measurements")
    more = f", like {len(rows) - 1} more," if len(rows) > 1 else ""
    message = f"photo {{}}{more} has no measured crosses ({cards}): its film deformation is not corrected"
    names = draft.names("photos", "plates")
    yield from draft.problems("plates", rows[:1], message, names, path="plates.photo", severity="warning")


def curvature(draft: Draft) -> Iterator[Problem]:
    """Yield a correction of the earth's curvature in a job that is not in a grid."""
    wanted = draft.raw and draft.reduction is not None and draft.reduction.curvature is Curvature.YES
    if wanted and draft.system is not CoordinateSystem.LOCAL:
        message = f"earth curvature belongs to jobs in a grid (LOCL), not to {draft.system} ones"
        yield draft.problem("reduction", 0, message, path="reduction.curvature")


def heights(draft: Draft) -> Iterator[Problem]:
    """Yield refraction or curvature without the heights of the ground and of every station."""
    options = draft.reduction
    if not draft.raw or options is None:
        return
    if options.atmosphere is Atmosphere.NONE and options.curvature is Curvature.NO:
        return
    path = "reduction.ground_height"
    if draft.lacks("reduction", 0, path):
        yield draft.problem("reduction", 0, "refraction and curvature need the height of the ground", path=path)
    if not draft.may_lack_station:
        return  # other checks miss the stations
    unknown = np.isnan(draft.by_photo("stations", "photos.position")).any(axis=1)
    message = "photo {} has no station card: refraction and curvature need its height"
    rows, names = _plates_of(draft, unknown), draft.names("photos", "plates")
    yield from draft.problems("plates", rows, message, names, path="plates.photo")


def flags(draft: Draft) -> Iterator[Problem]:
    """Yield the readings of a point whose flag is not that of its first reading on the photo."""
    if not draft.raw:
        return
    taken = draft.rows["plates"]["plates.triangulated"]
    for row, first in repeats(draft.photo["plates"], draft.point["plates"]):
        if taken[row] != taken[first]:
            message = f"the reading {draft.place('plates', first)} says otherwise"
            yield draft.problem("plates", row, message, path="plates.triangulated")


def _plates_of(draft: Draft, wanted: BoolArray) -> IntArray:
    """Return the rows of the plate cards that name each of the `wanted` (photos,) first."""
    links, first = np.unique(draft.photo["plates"], return_index=True)
    return first[(links >= 0) & wanted[links]]


def _photos(draft: Draft) -> IntArray:
    links = np.unique(draft.photo["plates"])
    return links[links >= 0]


def _counts(links: IntArray, size: int) -> IntArray:
    return np.bincount(links[links >= 0], minlength=size)


def _with_axes(draft: Draft) -> BoolArray:
    """Return (cameras,) True where distances lie along both axes, or both diagonals."""
    axis = draft.rows["mark_distances"]["mark_distances.axis"]
    camera, cameras = draft.camera["mark_distances"], len(draft.camera_ids)
    complete = np.zeros(cameras, dtype=bool)
    for pair in _DIRECTIONS:
        complete |= np.all([_counts(camera[axis == name], cameras) > 0 for name in pair], axis=0)
    return complete
