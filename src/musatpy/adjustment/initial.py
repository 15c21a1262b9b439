"""Initial values of the exposure stations from the plate coordinates and the control alone.

Pairs are oriented, joined to models, and these placed on the control; photos that no pair holds are resected from
known and intersected points; a robust adjustment of the whole block then takes the bends out of long strips.
Submerged points take part where their straight rays meet, with a small weight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.iteration import given_minus
from musatpy.adjustment.job import level_coordinates
from musatpy.adjustment.network import job_frame
from musatpy.adjustment.refinement import refined_stations
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import AdjustmentError, Problem
from musatpy.geometry import collinearity
from musatpy.geometry.geodesy import Frame
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, CoordinateSystem, Datum, Initial, Photos, Program
from musatpy.model.tables import finite_rows
from musatpy.orientation.absolute import Targets, absolute_orientation, levelling
from musatpy.orientation.mosaic import mosaics
from musatpy.orientation.resection import Resection, resection
from musatpy.orientation.strips import FEWEST, SUBMERGED, PhotoModel, Tangents, models_of, sights_of, tangent_sigma
from musatpy.units import DEGREE

GIVEN, MODEL, MOSAIC, RESECTION, THROUGH_WATER = "given", "model", "mosaic", "resection", "water"
NOT_FOUND = ""  # or how a photo was found

_CONTROL_ERROR = 1e-3  # of the extent of the control: the least error that counts as one
_BENT = 0.05  # rad, by which a lens that is little known may bend a ray
_WRONG = 0.1  # robust weight below which control is taken as wrong
_FEWEST_KNOWN = 3  # points of a resection, and of a model whose ground is not level
_AS_SURE = 2.0  # resections within this factor of the surest are taken together
UNHELD = 0.1  # of the flying height: stations less sure than this are not found
_NOMINAL_SCALE = 10.0  # m of flying height for a mm of focal length: photographs at 1:10,000
_TANGENTS = np.ones(()), np.zeros(2)  # focal length and principal point of images as tangents
MOST_MISSED = 30.0  # plate sigmas: a resection that misses its points by more is none
_MOSTLY = 0.7  # share of the photos of a mosaic that models must hold to be completed by resection
_MOST_SHIFT = 0.1  # of the flying height, and
_MOST_TURN = 5.0 * DEGREE  # a given value may be off; up to there adjustments start well
_NOMINAL = "too little is known to place the block: its place, heading or scale is arbitrary where nothing gives it"


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialValues:
    """The n photos of a block with what was found filled in, and how the given values compare with it."""

    photos: Photos  # NaN where nothing was found or given
    found: TextArray  # (n,) "given", "model", "mosaic", "resection", "water", or empty
    difference: FloatArray  # (n, 6) given minus computed: east, north, up m, angles rad; NaN where not both
    beyond: BoolArray  # (n,) the difference is more than a tenth of the flying height, or 5 degrees
    problems: tuple[Problem, ...]  # photos that could not be found, each with its reason
    notes: tuple[str, ...]  # on photos found in an unusual way, and on a block that nothing places


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoPlaces:
    """Where the n photos stand: working coordinates, and how each was found or why not."""

    frame: Frame
    C: FloatArray  # (n, 3) working coordinates, NaN where not found
    M: FloatArray  # (n, 3, 3) working axes to photo
    found: TextArray  # (n,) one of the names above, or empty
    wrong: BoolArray  # (k,) control that contradicts the rest
    reasons: dict[int, str]  # photo -> why it was not found
    notes: tuple[str, ...] = ()  # what is to be said of photos that were found

    def having(
        self, photo: IntArray | BoolArray, C: FloatArray, M: FloatArray, name: str | TextArray
    ) -> PhotoPlaces:
        """Return the places with photos found at C (k, 3) with M (k, 3, 3)."""
        place = replace(self, C=self.C.copy(), M=self.M.copy(), found=self.found.copy())
        place.C[photo], place.M[photo], place.found[photo] = C, M, name
        return place

    def without(self, photos: list[int], reason: str) -> PhotoPlaces:
        """Return the places with the reason why photos have none."""
        return replace(self, reasons={**self.reasons, **dict.fromkeys(photos, reason)})


@dataclass(frozen=True, kw_only=True, eq=False)
class _Known:
    """k control points, then observed and other given stations, in level coordinates with what is known of each."""

    point: IntArray  # (k,) link to points, -1 for stations
    photo: IntArray  # (k,) link to photos, -1 for points
    level: FloatArray  # (k, 3) NaN where not known
    known: BoolArray  # (k, 3)
    weight: FloatArray  # (k,)
    control: IntArray  # (k,) link to the control, -1 for stations


def started(block: Block) -> tuple[Block, tuple[str, ...]]:
    """Return the block with the initial values that its options ask for, and warnings.

    Raises `AdjustmentError` with every photo whose initial values are neither given nor found.
    """
    if block.options.initial is Initial.GIVEN:
        return block, ()
    values = initial_photos(block)
    if block.options.initial is Initial.COMPUTE:
        if values.problems:
            raise AdjustmentError(values.problems)
        return replace(block, photos=values.photos), values.notes
    unchecked = np.flatnonzero(np.isnan(values.difference).any(axis=1))
    return block, (
        *(_disagreement(block, values, row) for row in np.flatnonzero(values.beyond).tolist()),
        *(f"photo {block.photos.ids[row]}: its given values could not be checked" for row in unchecked.tolist()),
    )


def _disagreement(block: Block, values: InitialValues, row: int) -> str:
    # z: no sign where it rounds to zero
    east, north, up = (f"{shift:z.0f} m" for shift in values.difference[row, :3])
    angles = ", ".join(f"{angle / DEGREE:z.1f}" for angle in values.difference[row, 3:])
    return (
        f"photo {block.photos.ids[row]}: the given station is {east} east, {north} north, {up} up, "
        f"and the given angles are {angles} degrees off what the plates and the control say"
    )


def initial_photos(block: Block) -> InitialValues:
    """Return the initial values of a block, computed unless its options say CHECK.

    A station with an observed component (one with a sigma) stays as given, and so does an observed angle; all else
    is computed, and stays as given only where that fails. With CHECK everything stays as given, and is only
    compared. The models are placed on the control and the observed stations, and on other given stations where
    these are too few. Raises `AdjustmentError` where the ellipsoid is unknown.
    """
    place, photos = _found(block, sights_of(block)), block.photos
    given = finite_rows(np.concatenate([photos.position, photos.attitude], axis=1))
    lost = np.flatnonzero((place.found == NOT_FOUND) & ~given)
    if lost.size and block.options.initial is Initial.COMPUTE:
        from musatpy.adjustment.through_water import oriented_through_water  # most jobs have no use for it

        place = oriented_through_water(block, place, lost)
    computed = place.found != NOT_FOUND
    difference = given_minus(photos, place.frame, place.C, place.M, computed & given)
    with np.errstate(invalid="ignore"):
        beyond = np.linalg.norm(difference[:, :3], axis=1) > _MOST_SHIFT * typical_height(block, place)
        rates = collinearity.angle_rates(photos.attitude, collinearity.AngleForm.OMEGA_PHI_KAPPA)
        turns = np.einsum("nij,nj->ni", rates, difference[:, 3:])  # omega and kappa may turn about one line
        beyond |= (np.abs(turns) > _MOST_TURN).any(axis=1)
    new = computed & (block.options.initial is not Initial.CHECK)
    position, attitude = np.array(photos.position), np.array(photos.attitude)
    moved = new & ~(np.isfinite(photos.position_sigma).any(axis=1) & finite_rows(photos.position))
    position[moved] = place.frame.system(place.C[moved])
    there = collinearity.attitude_from_matrix(place.M[new] @ np.swapaxes(place.frame.axes(place.C[new]), 1, 2))
    observed = np.isfinite(photos.attitude_sigma) & np.isfinite(photos.attitude)
    attitude[new] = np.where(observed[new], attitude[new], there)
    found = np.where(new, place.found, np.where(given, GIVEN, NOT_FOUND))
    return InitialValues(
        photos=replace(photos, position=position, attitude=attitude),
        found=found,
        difference=difference,
        beyond=beyond,
        notes=place.notes,
        problems=_problems(photos, np.flatnonzero(found == NOT_FOUND), place),
    )


def _found(block: Block, sights: Tangents) -> PhotoPlaces:
    """Return the places by joined models, or by the mosaic where that finds photos that the models do not."""
    joined = placed(block, sights, models_of(block, sights), MODEL)
    if (joined.found == MODEL).all():
        return _completed(block, sights, joined)
    flat = placed(block, sights, mosaics(sights), MOSAIC)
    by_models = np.count_nonzero(joined.found) >= _MOSTLY * np.count_nonzero(flat.found)
    first, second = (joined, flat) if by_models else (flat, joined)
    place = _completed(block, sights, first)
    if misfit(block, sights, place)[0] and (second.found != NOT_FOUND).any():
        both = (place, _completed(block, sights, second))
        place, other = sorted(both, key=lambda place: misfit(block, sights, place))
        only = (place.found == NOT_FOUND) & (other.found != NOT_FOUND)
        if only.any():
            place = _refined(block, place.having(only, other.C[only], other.M[only], other.found[only]))
    return place


def _completed(block: Block, sights: Tangents, place: PhotoPlaces) -> PhotoPlaces:
    """Return the places with single photos resected, refined as a whole."""
    place = resected(block, sights, place)
    return _refined(block, place) if (place.found != NOT_FOUND).any() else place


def _refined(block: Block, place: PhotoPlaces) -> PhotoPlaces:
    return refined_stations(block, place, typical_height(block, place))


def _problems(photos: Photos, rows: IntArray, place: PhotoPlaces) -> tuple[Problem, ...]:
    """Return why photos were not found, those with one reason together."""
    alike: dict[str, list[str]] = {}
    for row in rows.tolist():
        alike.setdefault(place.reasons[row], []).append(photos.ids[row])
    return tuple(
        Problem(message=f"no initial values of {'photo' if len(ids) == 1 else 'photos'} {', '.join(ids)}: {reason}")
        for reason, ids in alike.items()
    )


def placed(block: Block, sights: Tangents, models: list[PhotoModel], name: str) -> PhotoPlaces:
    """Return the photos of models placed on the control; `name` says how they were found.

    Observed stations count as control, other given stations only where a model cannot be placed without them.
    Where no model can be placed, the largest one of a free network gets a nominal datum (`_nominally`).
    Raises `AdjustmentError` where the ellipsoid is unknown.
    """
    n = len(block.photos.ids)
    pairless = f"it has no pair of at least {FEWEST} good points in common, and too few known points"
    frame = _frame(block)
    place = PhotoPlaces(
        frame=frame,
        C=np.full((n, 3), np.nan),
        M=np.full((n, 3, 3), np.nan),
        found=np.full(n, "", dtype="U9"),
        wrong=np.zeros(len(block.control.point), dtype=bool),
        reasons={row: pairless if row in sights.photo else "nothing is measured on it" for row in range(n)},
    )
    surest, others = _known(block, frame, approximate=False), _known(block, frame, approximate=True)
    control = surest.point[surest.point >= 0]
    for model in models:
        if surest.known[_in_model(model, surest)[0], 0].sum() < _FEWEST_KNOWN:
            model = _with_lost(model, sights, control)
        on = _on_control(place, model, surest, name) or _on_control(place, model, others, name)
        place = on or place.without(model.photo.tolist(), _too_little(model, surest))
    free = block.options.datum is Datum.FREE and block.options.program is Program.IIIA
    if free and models and not (place.found != "").any():
        return _nominally(block, place, max(models, key=lambda model: len(model.photo)), others, name)
    return place


def _frame(block: Block) -> Frame:
    """Return the working frame of the job, about the middle of what is known of it."""
    photos = block.photos
    places = np.concatenate([block.control.position, photos.position]).T
    known = [component[np.isfinite(component)] for component in places]  # partial control counts for its part
    middle = [np.median(component) if component.size else 0.0 for component in known]
    return job_frame(replace(block, photos=replace(photos, position=np.tile(middle, (len(photos.ids), 1)))))


def _known(block: Block, frame: Frame, approximate: bool) -> _Known:
    """Return what is known in level coordinates; `approximate` lets given stations without sigma count as well."""
    control, photos = block.control, block.photos
    level = level_coordinates(block, frame)
    known = control.known & np.isfinite(level)
    submerged = block.points.bathymetric[control.point]
    given = finite_rows(photos.position)
    if not approximate:
        given &= finite_rows(photos.position_sigma)
    stations = np.flatnonzero(given)
    return _Known(
        point=np.concatenate([control.point, np.full(len(stations), -1)]),
        photo=np.concatenate([np.full(len(level), -1), stations]),
        level=np.concatenate([level, frame.level(frame.working(photos.position[stations]))]),
        known=np.concatenate([known, np.ones((len(stations), 3), dtype=bool)]),
        weight=np.concatenate([np.where(submerged, SUBMERGED, 1.0), np.ones(len(stations))]),
        control=np.concatenate([np.arange(len(level)), np.full(len(stations), -1)]),
    )


def _on_control(place: PhotoPlaces, model: PhotoModel, known: _Known, name: str) -> PhotoPlaces | None:
    """Return the places with those of a model's photos, None where too little is known of it.

    Components that are not known are first taken from the middle of the job, then from the placed model: on a
    curved earth the height of a point depends on where it is.
    """
    seen, x = _in_model(model, known)
    mask = known.known[seen]
    if mask[:, 0].sum() < 2 or not mask[:, 2].any():
        return None
    frame = place.frame
    origin = np.zeros(3)
    axes = frame.axes(origin)
    level = np.where(mask, known.level[seen], frame.level(origin))
    if not mask[:, 2].all():
        level[~mask[:, 2], 2] = np.median(level[mask[:, 2], 2])
    extent = np.ptp(frame.from_level(level)[mask[:, 0]], axis=0)
    floor = max(_CONTROL_ERROR * float(np.linalg.norm(extent)), 1e-6)
    for _ in range(3):
        targets = Targets(model=x, position=frame.from_level(level) @ axes.T, known=mask, weight=known.weight[seen])
        placement = absolute_orientation(targets, model.up, floor)
        if placement is None:
            return None
        move, robust = placement
        if mask.all():
            break
        level = np.where(mask, known.level[seen], frame.level(move.apply(x) @ axes))
    new, wrong = model.moved(move), place.wrong.copy()
    contradict = (mask & (robust < _WRONG * known.weight[seen][:, None])).any(axis=1) & (known.control[seen] >= 0)
    wrong[known.control[seen[contradict]]] = True
    return replace(place, wrong=wrong).having(model.photo, new.C @ axes, new.M @ axes, name)


def _with_lost(model: PhotoModel, sights: Tangents, points: IntArray) -> PhotoModel:
    """Return a model with those of some points that it has lost, each where its rays come nearest.

    A lens of which little is known bends rays farther than images of a model may be off.
    """
    X = dict(zip(model.point.tolist(), model.X, strict=True))
    lost = np.isin(sights.point, np.setdiff1d(points, model.point))
    rows = np.flatnonzero(lost & np.isin(sights.photo, model.photo))
    for of in np.split(rows, np.flatnonzero(np.diff(sights.point[rows])) + 1):
        if len(of) > 1:
            at = [model.row(photo) for photo in sights.photo[of].tolist()]
            ray = collinearity.ray(sights.x[of], model.M[at], *_TANGENTS)
            place = collinearity.nearest_point(model.C[at], ray)
            away = place - model.C[at]
            missed = np.linalg.norm(np.cross(ray, away), axis=1) / np.linalg.norm(away, axis=1)
            X |= {int(sights.point[of[0]]): place} if (missed < _BENT).all() else {}
    order = sorted(X)
    return replace(model, point=np.array(order), X=np.array([X[point] for point in order]))


def _in_model(model: PhotoModel, known: _Known) -> tuple[IntArray, FloatArray]:
    """Return the rows of `known` that a model holds, and where they are in it (k, 3)."""
    at = np.searchsorted(model.point, known.point)
    at = np.minimum(at, len(model.point) - 1)
    points = np.flatnonzero((known.point >= 0) & (model.point[at] == known.point))
    stations = np.flatnonzero((known.photo >= 0) & np.isin(known.photo, model.photo))
    rows = [model.row(photo) for photo in known.photo[stations].tolist()]
    return np.concatenate([points, stations]), np.concatenate([model.X[at[points]], model.C[rows]])


def _too_little(model: PhotoModel, known: _Known) -> str:
    """Return why the photos of a model have no place."""
    seen, _ = _in_model(model, known)
    horizontal, vertical = (int(known.known[seen, component].sum()) for component in (0, 2))
    return (
        f"the {len(model.photo)} photos that it hangs together with show {horizontal or 'no'} horizontally and "
        f"{vertical or 'no'} vertically known points: 2 and 1 are needed to place them"
    )


def _nominally(block: Block, place: PhotoPlaces, model: PhotoModel, known: _Known, name: str) -> PhotoPlaces:
    """Return the places with the photos of a model that too little is known of, in a datum of our own.

    Its ground lies level, and the x-axis of its first photo points east. The scale is that of measured distances,
    else of air bases, else the photographs are at 1:10,000. What is known of it horizontally, and vertically, gives
    the shift; else its first station has the coordinates 0, 0, and its highest submerged point stands at the mean
    tide, or its ground at the height 0. A job on an ellipsoid without any position on it keeps its photos unfound.
    """
    frame, level = place.frame, levelling(model.up)
    x = level @ model.M[0].T[:, 0]
    size = max(float(np.hypot(x[0], x[1])), 1e-9)
    c, s = x[0] / size, x[1] / size
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ level
    scale, notes = _scale(block, model)
    new = model.moved(Similarity(scale=scale, rotation=turn, shift=np.zeros(3)))
    seen, at = _in_model(new, known)
    mask = known.known[seen]
    if block.options.system is not CoordinateSystem.LOCAL and not mask[:, 0].any():
        reason = (
            f"a {block.options.system} job needs a position at least, and of the {len(model.photo)} photos that it "
            "hangs together with no station and no control point in common has one"
        )
        return place.without(model.photo.tolist(), reason)
    axes = frame.axes(np.zeros(3))
    target = frame.from_level(np.where(mask, known.level[seen], frame.level(np.zeros(3)))) @ axes.T
    offset = np.where(mask, target - at, np.nan)
    origin = frame.system(np.zeros((1, 3)))[0] if block.options.system is CoordinateSystem.LOCAL else np.zeros(3)
    shift = np.array(
        [*(-origin[:2] - new.C[0, :2]), _nominal_height(block, new) - float(frame.height(np.zeros(3)))]
    )
    given = mask.any(axis=0)
    shift[given] = np.nanmedian(offset[:, given], axis=0)
    return replace(place, notes=(_NOMINAL, *notes)).having(model.photo, (new.C + shift) @ axes, new.M @ axes, name)


def _scale(block: Block, model: PhotoModel) -> tuple[float, list[str]]:
    """Return metres per unit of a model: by distances, by air bases, or by the nominal scale of photographs.

    And notes on lengths that are more than twice, or less than half, what the shorter half of them say.
    """
    ends = np.searchsorted(model.point, block.distances.point)
    ends = np.minimum(ends, len(model.point) - 1)
    held = (model.point[ends] == block.distances.point).all(axis=1)
    bases = np.isin(block.air_bases.photo, model.photo).all(axis=1)
    rows = np.array(
        [[model.row(photo) for photo in pair] for pair in block.air_bases.photo[bases].tolist()], dtype=int
    )
    points, photos, heading = block.points.ids, block.photos.ids, "distance of points"
    for places, ends_of, length, names in (
        (model.X, ends[held], block.distances.length[held], points[block.distances.point[held]]),
        (model.C, rows.reshape(-1, 2), block.air_bases.length[bases], photos[block.air_bases.photo[bases]]),
    ):
        if len(length):
            ratio = length / np.linalg.norm(places[ends_of[:, 1]] - places[ends_of[:, 0]], axis=1)
            scale = float(np.sort(ratio)[(len(ratio) - 1) // 2])
            wrong = np.flatnonzero(np.abs(np.log(ratio / scale)) > np.log(2.0)).tolist()
            return scale, [
                f"the {heading} {' and '.join(names[row])} is {ratio[row] / scale:.3g} times as long as others say"
                for row in wrong
            ]
        heading = "air base of photos"
    focal_length = float(np.median(block.cameras.focal_length[block.photos.camera[model.photo]]))
    return _NOMINAL_SCALE * focal_length / model.height, []


def _nominal_height(block: Block, model: PhotoModel) -> float:
    """Return by how much a levelled model is to be lifted: submerged points up to the tide, or ground to 0."""
    tide = block.photos.tide[model.photo]
    wet = block.points.bathymetric[model.point]
    if wet.any() and np.isfinite(tide).any():
        return float(np.nanmean(tide) - model.X[wet, 2].max())
    return -float(np.median(model.X[:, 2]))


def resected(block: Block, sights: Tangents, place: PhotoPlaces) -> PhotoPlaces:
    """Return the places with photos resected from full control and from the points that found photos intersect.

    In each round only the surest ones are taken: they make the others surer.
    """
    while True:
        ground = _ground(block, sights, place)
        usable = finite_rows(ground[sights.point])
        count = np.bincount(sights.photo[usable], minlength=len(place.found))
        tried = np.flatnonzero((place.found == "") & (count >= _FEWEST_KNOWN)).tolist()
        stations = {photo: _resected(block, sights, place, photo, ground) for photo in tried}
        good = {photo: station for photo, station in stations.items() if station is not None}
        if not good:
            reason = "no station agrees with the known points that it shows, or they do not determine it"
            return place.without(tried, reason)
        limit = _AS_SURE * min(station.sigma for station in good.values())
        for photo, station in good.items():
            if station.sigma <= limit:
                place = place.having(np.array([photo]), station.C, station.M, RESECTION)


def _resected(
    block: Block, sights: Tangents, place: PhotoPlaces, photo: int, ground: FloatArray
) -> Resection | None:
    rows = np.flatnonzero((sights.photo == photo) & finite_rows(ground[sights.point]))
    X = ground[sights.point[rows]]
    sigma = tangent_sigma(block)
    station = resection(sights.x[rows], X, place.frame.axes(X.mean(axis=0))[2], sigma)
    if station is None or station.scale > MOST_MISSED * sigma:
        return None
    height = float(np.median(np.linalg.norm(X - station.C, axis=1)))
    return station if station.sigma < UNHELD * height else None


def _ground(block: Block, sights: Tangents, place: PhotoPlaces) -> FloatArray:
    """Return working coordinates (p, 3) of full control, and of points with rays from two found photos or more."""
    ground = np.full((len(block.points.ids), 3), np.nan)
    rows = np.flatnonzero(place.found[sights.photo] != "")
    if rows.size:
        of = sights.photo[rows]
        P, u = place.C[of], collinearity.ray(sights.x[rows], place.M[of], *_TANGENTS)
        point, start, count = np.unique(sights.point[rows], return_index=True, return_counts=True)
        for m in np.unique(count[count > 1]).tolist():
            rays = start[count == m][:, None] + np.arange(m)
            ground[point[count == m]] = collinearity.nearest_point(P[rays], u[rays])
    control = full_control(block, place)
    return np.where(np.isfinite(control), control, ground)


def full_control(block: Block, place: PhotoPlaces) -> FloatArray:
    """Return working coordinates (p, 3) of full control that does not contradict the rest, NaN of other points."""
    ground = np.full((len(block.points.ids), 3), np.nan)
    known = _known(block, place.frame, approximate=False)
    full = (known.point >= 0) & known.known.all(axis=1)
    full[: len(place.wrong)] &= ~place.wrong
    ground[known.point[full]] = place.frame.from_level(known.level[full])
    return ground


def typical_height(block: Block, place: PhotoPlaces) -> float:
    """Return the flying height of the photos found over the ground points, m; NaN where there are none."""
    sights = sights_of(block)
    ground = _ground(block, sights, place)
    distance = np.linalg.norm(ground[sights.point] - place.C[sights.photo], axis=1)
    return float(np.median(distance[np.isfinite(distance)])) if np.isfinite(distance).any() else float("nan")


def misfit(block: Block, sights: Tangents, place: PhotoPlaces) -> tuple[int, float]:
    """Return how many photos are lost or do not fit the others, and the median image error (tangent) of all."""
    ground = _ground(block, sights, place)
    M, v = place.M[sights.photo], ground[sights.point] - place.C[sights.photo]
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.linalg.norm(collinearity.image(v, M, *_TANGENTS) - sights.x, axis=1)
    error[~collinearity.in_front(v, M) & np.isfinite(error)] = np.inf
    imaged = ~np.isnan(error)
    measured = np.unique(sights.photo)
    middle = [np.median(error[imaged & (sights.photo == photo)]) for photo in measured if place.found[photo]]
    good = np.array(middle) < MOST_MISSED * tangent_sigma(block)
    return len(measured) - int(good.sum()), float(np.median(error[imaged])) if imaged.any() else np.inf
