"""Scales against the images: control in another unit than the stations, or the focal length of another camera.

On a photo without tilt the control lies as on the plate, at H/f times its size. Tilts and relief make that wrong by
some percent, units and cameras by much more.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import ComplexArray, FloatArray
from musatpy.errors import Problem
from musatpy.formats.checks.headings import plan, sums
from musatpy.formats.checks.system_use import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.draft_rays import rays_of
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.model.block import other_focal_length
from musatpy.units import length_unit

_FEWEST = 3  # control points of a photo
_SAME = 0.1  # relative difference of scales that are the same
_SPREAD = 20.0  # mm: the control must spread this far (RMS) on the plate


def scales(draft: Draft) -> Iterator[Problem]:
    """Yield a unit, or another camera, that most photos with control agree on (not in geocentric jobs)."""
    if draft.raw or draft.may_lack_station or draft.system is CoordinateSystem.GEOCENTRIC:
        return
    if not all(fits_system(draft, role, path).all() for role, path in _POSITIONS):
        return
    ratios = _ratios(draft)
    if not len(ratios):
        return
    ratio = float(np.median(ratios))
    if not np.all(np.abs(ratios / ratio - 1.0) < _SAME):
        return
    for factor, text in (
        (ratio, "control in feet, and stations in metres"),
        (1.0 / ratio, "stations in feet, and control in metres"),
    ):
        if length_unit(factor, _SAME) == "feet":
            message = f"the control is {ratio:.2f} times as wide as on the photos, as with {text}"
            yield draft.problem("control", 0, message, path="control.position", severity="warning")
            return
    focal = draft.rows["cameras"]["cameras.focal_length"]
    other = other_focal_length(float(np.median(focal)), ratio, _SAME)
    if other:
        message = (
            f"the control is {ratio:.2f} times as wide as on the photos, as with a focal length of {other:g} mm"
        )
        yield draft.problem("cameras", 0, message, path="cameras.focal_length", severity="warning")


_POSITIONS = (("stations", "photos.position"), ("control", "control.position"))


def _ratios(draft: Draft) -> FloatArray:
    """Return, of each photo with enough control, the width of the control over that on the photo by its station."""
    position = _control(draft)
    ground, photo, point = plan(draft, position), draft.photo["plates"], draft.point["plates"]
    seen = rays_of(draft).sound & np.isfinite(ground[point]) & np.isfinite(position[point, 2])
    photo, point = photo[seen], point[seen]
    image = (draft.rows["plates"]["plates.xy"] @ np.array([1.0, 1j]))[seen]

    def total(values: FloatArray | ComplexArray) -> ComplexArray:
        return sums(np.asarray(values, dtype=complex), photo, len(draft.photo_ids))

    count = np.maximum(total(np.ones(len(photo))).real, 1.0)
    x = image - (total(image) / count)[photo]
    squares = total(np.abs(x) ** 2).real
    good = (count >= _FEWEST) & (squares > count * _SPREAD**2)
    scale = np.abs(total(np.conj(x) * ground[point])) / np.where(good, squares, np.nan)  # m a mm
    above = draft.by_photo("stations", "photos.position")[:, 2] - total(position[point, 2]).real / count
    focal = np.full(len(draft.camera_ids) + 1, np.nan)  # the last one: no camera
    focal[draft.camera["cameras"]] = draft.rows["cameras"]["cameras.focal_length"]
    focal[-1] = np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = scale * focal[draft.camera_of_photo] / above
    return ratios[np.isfinite(ratios) & (ratios > 0.0)]


def _control(draft: Draft) -> FloatArray:
    """Return (points + 1, 3) positions of full control, NaN for all others and for the last: no point.

    Of control on land: through the water photos show it nearer, and another camera would explain that as well.
    """
    rows, links = draft.rows["control"], draft.point["control"]
    position = np.full((len(draft.point_ids) + 1, 3), np.nan)
    dry = np.append(~draft.bathymetric, False)
    full = (rows["control.kind"] == ControlKind.FULL) & (links >= 0) & dry[links]
    position[links[full]] = rows["control.position"][full]
    return position
