"""A block to go on with, from a solution: to start again from there, or with the results as new observations.

What a card gives with a sigma is at once an observation and the value that an adjustment starts from. A restart
therefore has to leave it as it is, or the adjusted value would be counted as observed; a result makes it just that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, turn_about_one_line, wrapped
from musatpy.geometry.geodesy import frame_of
from musatpy.jobs.agreement import in_common
from musatpy.model.block import in_order, with_tables
from musatpy.model.tables import empty, stacked, taken
from musatpy.model.water import WAVE_SIGMAS, known_waves
from musatpy.units import DEGREE


class Content(StrEnum):
    """What a punched deck is for."""

    RESTART = "restart"  # the same job again, from where it came to rest
    RESULT = "result"  # another job: adjusted values with their sigmas


class PunchedPoints(StrEnum):
    """Which ground points get control cards with their adjusted positions."""

    NONE = "none"
    CONTROL = "control"  # those that have a control card (result only: a restart leaves these as they are)
    ALL = "all"  # every point with a position; in a restart as check points, where they have no card


_PUNCHED = ("", "plates", "photos", "control")  # tables of observations that a result has
KINDS = {
    "F": model.ControlKind.FULL,
    "H": model.ControlKind.HORIZONTAL,
    "V": model.ControlKind.VERTICAL,
    "C": model.ControlKind.CHECK,
}


@dataclass(frozen=True, kw_only=True)
class Punch:
    """What is to be punched. Raises `ValueError` for what a restart cannot have."""

    content: Content = Content.RESTART
    points: PunchedPoints | None = None  # None: no point of a restart, all of a result
    kind: model.ControlKind | None = None  # of the points of a result; None: full
    sigmas: bool | None = None  # of a result, with them where None: without, an approximation, or without error
    plates: bool | None = None  # with plate coordinates; None: those of a restart only

    @classmethod
    def of(
        cls, content: str, *, points: str | None, kind: str | None, sigmas: bool | None, plates: bool | None
    ) -> Self:
        """Return what the words of options ask for; raises `ValueError`."""
        return cls(
            content=Content(content),
            points=PunchedPoints(points) if points else None,
            kind=KINDS[kind] if kind else None,
            sigmas=sigmas,
            plates=plates,
        )

    def __post_init__(self) -> None:
        if self.content is Content.RESULT:
            return
        if self.points is PunchedPoints.CONTROL:
            raise ValueError("a restart has the control as it was given: its points are none or all")
        if self.kind is not None:
            raise ValueError("the points of a restart are check points, or it would not be the same job")
        if self.sigmas is not None:
            raise ValueError("a restart has the sigmas of the job, or it would not be the same job")


def punched(solution: model.Solution, punch: Punch) -> tuple[model.Block, tuple[str, ...]]:
    """Return the block that is punched of a solution, and what to note about it."""
    if punch.content is Content.RESTART:
        block, notes = restart(solution, check_points=punch.points is PunchedPoints.ALL)
    else:
        kind = model.ControlKind.FULL if punch.kind is None else punch.kind
        block, notes = result(solution, punch.points or PunchedPoints.ALL, kind)
        if punch.sigmas is False:
            block = _without_sigmas(block)
    plates = punch.content is Content.RESTART if punch.plates is None else punch.plates
    if plates and punch.content is Content.RESULT:
        notes += ("the plate coordinates are in the sigmas of the result already: do not adjust both together",)
    if not plates:
        block = in_order(replace(block, plates=empty(model.PlateMeasurements)))
    return block, notes


# --- restart ---


def restart(solution: model.Solution, *, check_points: bool = False) -> tuple[model.Block, tuple[str, ...]]:
    """Return the block of a solution with every value that is not observed as it was adjusted, and notes.

    An adjustment of it starts where that of the solution came to rest, and has the same observations. Observed
    components of stations and attitudes, and tides, index, tilt and waves with a sigma, stay as given. With
    `check_points` points without control card get one as check points, with their a posteriori sigmas.
    """
    block = solution.block
    position, attitude = _places_to_start(solution)
    tide = _tides_to_start(solution)
    water = block.water
    if water is not None and solution.water is not None:
        water = _water_to_start(block, water, solution)
    notes: tuple[str, ...] = ()
    if water is not None and (water.tilt_east or water.tilt_north):
        notes = ("tilted water turns about the middle of the given stations, which a restart moves a little",)
    control = block.control
    if check_points:
        control = stacked([control, _adjusted_control(solution, _without_card(block), model.ControlKind.CHECK)])
    photos = replace(block.photos, position=position, attitude=attitude, tide=tide)
    punched = replace(block, options=_options(block), photos=photos, water=water, control=control)
    return in_order(punched), notes


def _options(block: model.Block) -> model.Options:
    """Return the options of what is punched: stations are given, and what was taken out as a blunder is out."""
    options = block.options
    initial = model.Initial.GIVEN if options.initial is model.Initial.COMPUTE else options.initial
    editing = model.Editing.NONE if options.editing is model.Editing.EDIT else options.editing
    return replace(options, initial=initial, editing=editing)


def _places_to_start(solution: model.Solution) -> tuple[FloatArray, FloatArray]:
    """Return stations (n, 3) and attitudes (n, 3): given where observed, else adjusted.

    A station with some of east, north, up observed moves along the others, and attitudes are those in the vertical
    frame of the station where it then is. Their observations keep their residuals: what a card says of them may
    change in its last digits with the vertical, and stands for the same observation.
    """
    photos, adjusted = solution.block.photos, solution.stations
    frame = frame_of(solution.block.options.system, solution.block.ellipsoid)
    observed = np.isfinite(photos.position_sigma)
    stays = observed.all(axis=1, keepdims=True)
    given, at_rest = frame.working(photos.position), frame.working(adjusted.position)
    there, here = frame.axes(given), frame.axes(at_rest)
    residual = np.where(observed, np.einsum("nij,nj->ni", there, at_rest - given), 0.0)
    start = np.where(stays, given, at_rest - np.einsum("nji,nj->ni", here, residual))
    M = attitude_matrix(adjusted.attitude) @ here
    moved, before = (
        wrapped(attitude_from_matrix(M @ np.swapaxes(axes, 1, 2)), photos.attitude)
        for axes in (frame.axes(start), there)
    )
    as_given = np.where(stays, photos.attitude, photos.attitude + moved - before)
    return (
        np.where(stays, photos.position, frame.system(start)),
        np.where(np.isfinite(photos.attitude_sigma), as_given, moved),
    )


def _tides_to_start(solution: model.Solution) -> FloatArray:
    """Return the tides (n,): adjusted where their correction is an unknown without prior, else given."""
    photos, water = solution.block.photos, solution.water
    _, correction = _tide_corrections(solution.block)
    if water is None:
        return photos.tide
    free = (correction >= 0) & ~np.isin(correction, correction[np.isfinite(photos.tide_sigma)])
    return np.where(free, water.tide, photos.tide)


def _tide_corrections(block: model.Block) -> tuple[TextArray, IntArray]:
    """Return the names (c,) of the unknown corrections of tides, and which one (n,) each tide has, -1 for none."""
    options, photos = block.options, block.photos
    labels = {
        model.WaterLevel.ONE: np.full(len(photos.ids), "one"),
        model.WaterLevel.PHOTO: photos.ids,
        model.WaterLevel.GROUP: photos.tide_group,
        model.WaterLevel.DAY: photos.tide_day,
    }.get(options.water_level if options.program is model.Program.IIIA else model.WaterLevel.KNOWN)
    if labels is None or block.water is None:
        return photos.ids[:0], np.full(len(photos.ids), -1)
    ids, link = np.unique(labels, return_inverse=True)
    return ids, np.where(~np.isnan(photos.tide) & (labels != ""), link, -1)


def _water_to_start(block: model.Block, water: model.Water, solution: model.Solution) -> model.Water:
    """Return the water with what is unknown of it and has no prior as it was adjusted."""
    options, adjusted = block.options, solution.water
    if adjusted is None or options.program is not model.Program.IIIA:
        return water
    if options.water_index is model.Treatment.ADJUST and not water.sigma:
        water = replace(water, index=adjusted.index, conditions=None)
    if options.water_tilt is model.Treatment.ADJUST and not water.tilt_sigma:
        east, north = adjusted.tilt.tolist()
        water = replace(water, tilt_east=east, tilt_north=north)
    return water


# --- result ---


def result(
    solution: model.Solution, points: PunchedPoints, kind: model.ControlKind
) -> tuple[model.Block, tuple[str, ...]]:
    """Return the adjusted values of a solution with their a posteriori sigmas, for another job, and notes.

    Stations, attitudes, water, waves, and `points` as control of one kind, in the system of the answer. What was
    observed besides is in their sigmas, and left out. Control that is fixed, a check point, or not determined keeps
    its card.
    """
    block, tables = solution.block, solution.block.tables()
    notes = [] if solution.converged else ["the run has not converged: these are not results to use"]
    used = {kind.attribute: kind.noun for kind in model.ObservationKind if kind.attribute not in _PUNCHED}
    notes += [f"{noun} are left out: {tables[name].count}" for name, noun in used.items() if tables[name].count]
    block = with_tables(
        block, {name: empty(type(of)) for name, of in tables.items() if name in used or of.about in used}
    )
    punched = replace(
        block,
        options=_options(block),
        water=_water_found(block, solution),
        waves=_waves_found(block.waves, solution),
        photos=_photos_found(solution),
        control=_control_found(solution, points, kind),
        **in_common(),
        given_in=_words_of_answer(block),
        stated_in=None,
    )
    return in_order(punched), tuple(notes)


def _words_of_answer(block: model.Block) -> model.SystemSpec | None:
    """Return how the answer is stated, with sigmas along east, north, up: those of no system need correlations."""
    spec = block.answer_in
    return spec and replace(spec, sigmas="LOCL")


def _without_sigmas(block: model.Block) -> model.Block:
    """Return a result whose control is exact, and all else an approximation; waves and index count as known."""
    photos, control, water = block.photos, block.control, block.water
    return replace(
        block,
        photos=replace(
            photos,
            position_sigma=np.full_like(photos.position_sigma, np.nan),
            attitude_sigma=np.full_like(photos.attitude_sigma, np.nan),
            tide_sigma=np.full_like(photos.tide_sigma, np.nan),
        ),
        control=replace(
            control, fixed=control.kind != model.ControlKind.CHECK, sigma=np.full_like(control.sigma, np.nan)
        ),
        water=water and replace(water, sigma=None, tilt_sigma=None),
        waves=known_waves(block.waves),
    )


def _photos_found(solution: model.Solution) -> model.Photos:
    """Return the photos as adjusted; a sigma that is zero or not known leaves a value an approximation.

    Omega and kappa that are known only together are approximations too: cards cannot say what they have in common.
    """
    photos, stations = solution.block.photos, solution.stations
    sigma = _sigmas(stations.covariance)
    together = turn_about_one_line(stations.attitude, DEGREE)
    sigma[together, 3] = sigma[together, 5] = np.nan
    tide, tide_sigma = _tides_found(solution)
    return replace(
        photos,
        position=stations.position,
        position_sigma=sigma[:, :3],
        attitude=stations.attitude,
        attitude_sigma=sigma[:, 3:],
        tide=tide,
        tide_sigma=tide_sigma,
    )


def _sigmas(covariance: FloatArray) -> FloatArray:
    """Return the sigmas (k, c) of covariances (k, c, c), NaN where there is none greater than zero."""
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        return np.where(sigma > 0.0, sigma, np.nan)


def _tides_found(solution: model.Solution) -> tuple[FloatArray, FloatArray]:
    """Return the tides (n,) as adjusted, and their sigmas: those of their corrections, else the given ones."""
    photos, water = solution.block.photos, solution.water
    if water is None:
        return photos.tide, photos.tide_sigma
    ids, correction = _tide_corrections(solution.block)
    names, sigma = water.correction_ids.tolist(), np.array(photos.tide_sigma)
    for row in np.flatnonzero(correction >= 0).tolist():
        name = "" if solution.block.options.water_level is model.WaterLevel.ONE else ids[correction[row]]
        sigma[row] = water.correction_sigma[names.index(name)]
    return water.tide, np.where(sigma > 0.0, sigma, np.nan)


def _water_found(block: model.Block, solution: model.Solution) -> model.Water | None:
    """Return the water as adjusted, with the sigmas of what was unknown."""
    water, adjusted = block.water, solution.water
    if water is None or adjusted is None:
        return water
    if np.isfinite(adjusted.index_sigma):
        water = replace(water, index=adjusted.index, sigma=adjusted.index_sigma, conditions=None)
    if np.isfinite(adjusted.tilt_sigma).all():
        east, north = adjusted.tilt.tolist()
        larger = float(adjusted.tilt_sigma.max())  # there is one field for both
        water = replace(water, tilt_east=east, tilt_north=north, tilt_sigma=larger)
    return water


def _waves_found(waves: model.Waves, solution: model.Solution) -> model.Waves:
    """Return the waves as adjusted, with the sigmas of what was unknown.

    Where a length was unknown the card gives it, beside the period or the speed that it gave; the rest is for
    theory, as before. A height below zero stands for crests half a length on.
    """
    adjusted = solution.water and solution.water.waves
    if not adjusted or not len(waves.ids):
        return waves
    height, length, azimuth, crest = adjusted.value.T
    sigmas = dict(zip(WAVE_SIGMAS, adjusted.sigma.T, strict=True))
    return replace(
        waves,
        height=np.abs(height),
        length=np.where(np.isnan(sigmas["length_sigma"]), waves.length, length),
        azimuth=np.where(np.isnan(sigmas["azimuth_sigma"]), waves.azimuth, azimuth),
        crest=np.where(height < 0.0, crest + 0.5 * length, crest),
        **sigmas,
    )


def _control_found(solution: model.Solution, points: PunchedPoints, kind: model.ControlKind) -> model.Control:
    """Return the control of a result: cards that stay as given, and adjusted points."""
    control = solution.block.control
    stays = control.fixed | (control.kind == model.ControlKind.CHECK)
    stays |= solution.points.status[control.point] == model.PointStatus.NOT_DETERMINED
    if points is PunchedPoints.NONE:
        return empty(model.Control)
    wanted = np.zeros(len(solution.block.points.ids), dtype=bool)
    wanted[control.point[~stays]] = True
    if points is PunchedPoints.ALL:
        wanted |= _without_card(solution.block)
    return stacked([taken(control, stays), _adjusted_control(solution, wanted, kind)])


def _without_card(block: model.Block) -> BoolArray:
    """Return (p,) the points without a control card."""
    without = np.ones(len(block.points.ids), dtype=bool)
    without[block.control.point] = False
    return without


def _adjusted_control(solution: model.Solution, wanted: BoolArray, kind: model.ControlKind) -> model.Control:
    """Return control cards of the `wanted` points (p,) that have a position and its sigmas.

    Points that were kept out of the solution are check points, whatever the kind.
    """
    points = solution.points
    sigma = _sigmas(points.covariance)
    rows = np.flatnonzero(wanted & np.isfinite(points.position).all(axis=1) & np.isfinite(sigma).all(axis=1))
    took_part = points.status[rows] == model.PointStatus.TRIANGULATED
    return model.Control(
        point=rows,
        kind=np.where(took_part, kind, model.ControlKind.CHECK),
        fixed=np.zeros(len(rows), dtype=bool),
        position=points.position[rows],
        sigma=sigma[rows],
    )
