"""What the ORI card of a block asks for: photos and their sights, and what is known of the water."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from musatpy import model
from musatpy.adjustment.lenses import ideal_plates
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.geodesy import Frame, LocalFrame, frame_of
from musatpy.orientation.twomedia.methods import METHODS, TRIPLET
from musatpy.orientation.twomedia.oriented import OrientationError
from musatpy.orientation.twomedia.sights import Method, Sights, WaterPlane

# of straight rays alone too
_DRY = (model.OrientationMethod.PAIR_INDEPENDENT, model.OrientationMethod.PAIR_SUCCESSIVE)
_NO_WATER = WaterPlane(treatment=model.PlaneTreatment.KNOWN, index=1.0)
_FEWEST = 5  # points that three photos on end of a strip must have in common, at least
_ASTRAY = 0.25  # of the photos that have more in common with the next but one than with the next: no strip
NO_CARD = "no ORI card says what is to be oriented, and by which method"
NO_CONTROL = "no two components of it are known: a single photo gives it no place"
ONE_PHOTO = "only one of the photos shows it"
ONE_COMPONENT = "only one component of it is known, which the conditions cannot use: taken as unknown"
BLOCK = "a block, or branches, is not for STRIP: musat run adjusts it with IIIA, from nothing by OP2 COMPUTE"


@dataclass(frozen=True, kw_only=True)
class LevelAxes:
    """Level axes at a place of the job, east, north and up, in which photos are oriented; those of a model else.

    `middle` (3,) in the working axes of `frame`, `turn` (3, 3) east, north, up there; Z counts from height zero. In
    a model, which has a place and a scale of its own, both are nothing.
    """

    frame: Frame
    middle: FloatArray
    turn: FloatArray

    def inside(self, system: FloatArray) -> FloatArray:
        """Return coordinates (..., 3) of positions in the system of the job."""
        return (self.frame.working(system) - self.middle) @ self.turn.T

    def system(self, inside: FloatArray) -> FloatArray:
        """Return positions (..., 3) in the system of the job."""
        return self.frame.system(inside @ self.turn + self.middle)

    def local_turn(self, inside: FloatArray) -> FloatArray:
        """Return (..., 3, 3) what turns the axes into the local east, north and up at places (..., 3)."""
        return self.frame.axes(inside @ self.turn + self.middle) @ self.turn.T


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientationTask:
    """The sights of m photos, p points and n images, with their rows in the tables of the block.

    Of a strip the method is that of its triplets. `in_model`: in axes of its own; `base` is the length of its first
    base, 1 where nothing gives it. `left_out` has the points that no condition can use, and why; `notes` what was
    not used of others. `dry`: no point is under water, the plane is none and rays are straight.
    """

    block: model.Block
    spec: model.OrientationSpec
    method: Method
    sights: Sights
    plane: WaterPlane
    axes: LevelAxes
    in_model: bool
    base: float
    photos: IntArray
    points: IntArray
    plates: IntArray
    left_out: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    dry: bool


def task_of(block: model.Block) -> OrientationTask:
    """Return the task of a block with refined plates. Raises `OrientationError` where there is none."""
    spec = block.orientation
    if spec is None:
        raise OrientationError(NO_CARD)
    method = METHODS.get(spec.method, TRIPLET)
    photos = _photos(block, spec)
    in_model = spec.method.in_model(len(block.control.point) > 0)
    axes = _axes(block, photos, in_model)
    control, control_sigma = _control(block, axes, in_model)
    point, plates, left_out, notes = _used(block, photos, control, spec.method)
    number, row = _numbers(photos, len(block.photos.ids)), _numbers(point, len(block.points.ids))
    plates = plates[np.argsort(number[block.plates.photo[plates]], kind="stable")]
    camera = block.photos.camera[block.plates.photo[plates]]
    seen = ideal_plates(block)
    focal = seen.cameras.focal_length[camera][:, None]
    sights = Sights(
        photos=block.photos.ids[photos],
        points=block.points.ids[point],
        photo=number[block.plates.photo[plates]],
        point=row[block.plates.point[plates]],
        image=(seen.plates.xy[plates] - seen.cameras.principal_point[camera]) / focal,
        image_sigma=block.plate_sigmas[plates] / focal,
        wet=block.points.bathymetric[point],
        control=control[point],
        control_sigma=control_sigma[point],
    )
    if not len(point):
        reasons = ", or ".join(sorted({reason for _, reason in left_out}))
        raise OrientationError(f"{method.name}: no point can be used: {reasons}")
    dry = not sights.wet.any()
    if dry and spec.method not in _DRY:
        raise OrientationError(
            f"no point is flagged submerged: of dry points {' and '.join(_DRY)} are the relative orientation, and "
            "musat run orients photos by control (OP2 COMPUTE)"
        )
    return OrientationTask(
        block=block,
        spec=replace(spec, plane=model.PlaneTreatment.KNOWN) if dry else spec,
        method=method,
        sights=sights,
        plane=_NO_WATER if dry else _plane(block, spec, photos, in_model),
        axes=axes,
        in_model=in_model,
        base=_base(block, photos) or 1.0,
        photos=photos,
        points=point,
        plates=plates,
        left_out=left_out,
        notes=notes,
        dry=dry,
    )


def _numbers(rows: IntArray, count: int) -> IntArray:
    """Return the places (count,) of rows of a table among these, -1 for the others."""
    number = np.full(count, -1)
    number[rows] = np.arange(len(rows))
    return number


def _photos(block: model.Block, spec: model.OrientationSpec) -> IntArray:
    """Return the photos in the order of the method: those that are named, else those that have images."""
    ids, measured = block.photos.ids.tolist(), np.unique(block.plates.photo)
    names = [ids[row] for row in measured]
    with_tide = block.photos.ids[np.isfinite(block.photos.tide)].tolist()
    index = block.water.index if block.water else np.nan
    control = len(block.control.point) > 0
    if faults := [message for _, message in spec.faults(names, with_tide, index, control)]:
        raise OrientationError("; ".join(faults))
    photos = np.array([ids.index(name) for name in spec.photos or names])
    if spec.method is not model.OrientationMethod.STRIP:
        return photos
    usable = _usable(block) & np.isin(block.plates.photo, photos)
    photo = np.searchsorted(photos, block.plates.photo[usable])
    return np.asarray(photos[_strip_order(photo, block.plates.point[usable], block.photos.ids[photos])])


def _strip_order(photo: IntArray, point: IntArray, ids: TextArray) -> IntArray:
    """Return the photos (m,) in the order of the strip, from the end that comes first in `ids` (m,).

    photo and point (n,) of the images. Raises `OrientationError` where there are gaps or branches.
    """
    from scipy.sparse.csgraph import connected_components  # heavy, of strips alone

    shows = np.zeros((len(ids), int(point.max()) + 1), dtype=np.float32)
    shows[photo, point] = 1.0
    common = shows @ shows.T
    np.fill_diagonal(common, 0.0)
    count, part = connected_components(common >= _FEWEST, directed=False)
    if count > 1:
        sets = [ids[part == number].tolist() for number in range(count)]
        texts = [", ".join(names if len(names) <= 6 else [*names[:3], "...", *names[-2:]]) for names in sets]
        raise OrientationError(
            f"STRIP: a gap: no photos of these have {_FEWEST} points in common: {' | '.join(texts)}"
        )
    laplacian = np.diag(common.sum(axis=1)) - common
    _, vectors = eigh(laplacian.astype(float), subset_by_index=[1, 1])
    order = np.argsort(vectors[:, 0], kind="stable")
    order = order if order[0] <= order[-1] else order[::-1]
    next_one, next_but_one = common[order[:-2], order[1:-1]], common[order[:-2], order[2:]]
    if np.mean(next_but_one > next_one) > _ASTRAY:
        raise OrientationError(f"STRIP: {BLOCK}")
    three = (shows[order[:-2]] * shows[order[1:-1]] * shows[order[2:]]).sum(axis=1)
    if len(gaps := np.flatnonzero(three < _FEWEST)):
        texts = [f"{', '.join(ids[order[gap : gap + 3]])}: {int(three[gap])}" for gap in gaps[:8]]
        raise OrientationError(
            f"STRIP: three photos on end need {_FEWEST} points that all of them show; gaps at {'; '.join(texts)}"
        )
    return np.asarray(order)


def _usable(block: model.Block) -> BoolArray:
    """Return which plate measurements may be used."""
    return block.plates.triangulated & np.isfinite(block.plates.xy).all(axis=1)


def _axes(block: model.Block, photos: IntArray, in_model: bool) -> LevelAxes:
    """Return the axes about the middle of the given stations, where these are given, else of the control.

    The water turns about the stations, as tilts of the water cards do.
    """
    if in_model:
        return LevelAxes(frame=LocalFrame(np.zeros(3)), middle=np.zeros(3), turn=np.eye(3))
    frame = frame_of(block.options.system, block.ellipsoid)
    stations = block.photos.position[photos]
    given = stations if np.isfinite(stations).all() else block.control.position
    given = given[np.isfinite(given).all(axis=1)]
    if not len(given):
        raise OrientationError("no control point has all three coordinates: nothing places the photos")
    level = frame.level(frame.working(given).mean(axis=0))
    middle = frame.from_level(np.array([level[0], level[1], 0.0]))
    return LevelAxes(frame=frame, middle=middle, turn=np.array(frame.axes(middle)))


def _control(block: model.Block, axes: LevelAxes, in_model: bool) -> tuple[FloatArray, FloatArray]:
    """Return what is known of the points (p, 3), NaN for what is not, and its sigmas, 0 without error.

    A component that is not given is put to the middle of the others to find those that are: what it changes in
    them is far less than they are worth.
    """
    known = np.full((len(block.points.ids), 3), np.nan)
    sigma = np.zeros(known.shape)
    if in_model:
        return known, sigma
    control = block.control
    place = control.position
    if block.options.system is not model.CoordinateSystem.GEOCENTRIC:
        middle = np.nanmean(np.where(control.known, place, np.nan), axis=0) if len(place) else np.zeros(3)
        place = np.where(np.isfinite(place), place, middle)
    known[control.point] = np.where(control.known, axes.inside(place), np.nan)
    sigma[control.point] = np.where(np.isfinite(control.sigma) & ~control.fixed[:, None], control.sigma, 0.0)
    return known, sigma


def _used(
    block: model.Block, photos: IntArray, control: FloatArray, method: model.OrientationMethod
) -> tuple[IntArray, IntArray, tuple[tuple[str, str], ...], tuple[str, ...]]:
    """Return the points and plate measurements that conditions can use, the points they cannot, and notes."""
    plates, ids = block.plates, block.points.ids
    usable = np.isin(plates.photo, photos) & _usable(block)
    rays = np.bincount(plates.point[usable], minlength=len(ids))
    components = np.isfinite(control).sum(axis=1)
    by_rays = METHODS.get(method, TRIPLET).in_model
    by_control = (components >= 2) & (rays > 0) & (not by_rays)
    enough = by_control | ((rays >= 2) & (method.photos > 1))
    shown = np.unique(plates.point[np.isin(plates.photo, photos)])
    why = NO_CONTROL if method.photos == 1 else ONE_PHOTO
    left_out = tuple(
        (str(ids[point]), why if rays[point] else "its plate cards keep it out")
        for point in shown[~enough[shown]].tolist()
    )
    single = ids[(components == 1) & enough].tolist()
    notes = (f"{ONE_COMPONENT}: {', '.join(single)}",) if single and not by_rays else ()
    point: IntArray = shown[enough[shown]]
    return point, np.flatnonzero(usable & np.isin(plates.point, point)), left_out, notes


def _plane(block: model.Block, spec: model.OrientationSpec, photos: IntArray, in_model: bool) -> WaterPlane:
    """Return what the deck knows of the water.

    The tides of the photos are heights of the job; a model, which has other axes, can take their differences only.
    """
    water = block.water
    assert water is not None  # there are submerged points, which the check of the deck has no water for otherwise
    tide, sigma = block.photos.tide[photos], block.photos.tide_sigma[photos]
    given = bool(np.isfinite(tide).all())  # of all photos or of none
    index_unknown = block.options.water_index is model.Treatment.ADJUST
    if index_unknown and spec.method is model.OrientationMethod.STRIP:
        raise OrientationError("STRIP takes the index of the water as known: WTR, not OP3 ADJUST")
    if given and np.ptp(tide) > 0.0 and in_model and _base(block, photos) is None:
        raise OrientationError("the tides differ, and nothing gives the scale of the model: give both stations")
    level = float(tide.mean()) if given and not in_model else None
    return WaterPlane(
        treatment=spec.plane,
        slope=(0.0, 0.0) if in_model else (water.tilt_east or 0.0, water.tilt_north or 0.0),
        slope_sigma=None if in_model else water.tilt_sigma,
        level=level,
        level_sigma=float(sigma.mean()) if level is not None and np.isfinite(sigma).all() else None,
        rise=tide - tide.mean() if given else None,
        index=water.index,
        index_sigma=water.sigma,
        index_unknown=index_unknown,
    )


def _base(block: model.Block, photos: IntArray) -> float | None:
    """Return the distance (m) of the first two stations where both are given: the scale of a model."""
    stations = block.photos.position[photos[:2]]
    if len(stations) < 2 or not np.isfinite(stations).all():
        return None
    first, second = frame_of(block.options.system, block.ellipsoid).working(stations)
    return float(np.linalg.norm(second - first)) or None
