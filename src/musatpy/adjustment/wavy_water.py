"""Waves on the water of a job: refraction at any surface in place of the flat one.

The surface stands on the level water of each exposure, its tide. Its axes x and y are east and north at the origin
of the waves, carried to each ground point without a turn about the vertical; the vertical is that of the ground
point, as for the flat surface.

The surface is known, or a sum of k sinusoidal waves whose height, length, azimuth, crest may be unknown: Okamoto
(1982), technique (2) of his discussion, by the simultaneous adjustment. Their state is an array (k, 4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import AdjustmentError, Problem
from musatpy.geometry.geodesy import Frame
from musatpy.model import Block, Datum, Program, Refraction, Treatment
from musatpy.model.water import WAVE_SIGMAS
from musatpy.refraction.flat import Incidence, RefractedRay

if TYPE_CHECKING:  # most runs have no waves
    from musatpy.refraction.bending import WaveRay
    from musatpy.refraction.fermat import WaveIncidence
    from musatpy.refraction.surface import Surface
    from musatpy.refraction.waves import Trains

Result = TypeVar("Result")

HEIGHT, LENGTH, AZIMUTH, CREST = range(4)  # columns of the parameters of waves
_HALVES = 8  # lengths that a crest may be looked for to either side, twice
_NEARER = 1e-6  # squared sigmas: less is no gain


@dataclass(frozen=True, kw_only=True, eq=False)
class Sea:
    """Waves over the tides of a job, their parameters known, or observed.

    surface: heights about level 0, axes east, north, up (m) about `origin`; time (n,) s of the exposure of each
    photo; origin (3,) in the job's coordinate system, where the surface has its x = y = 0.

    sigma (k, 4), for a `Harmonic` of k waves only, in the words of the cards: of height from trough to crest (m),
    length (m), azimuth (rad, clockwise from north) and crest (m, its distance from the origin at time 0). NaN:
    known; else unknown, and observed with the value that the surface has. Origin and time 0 belong in the middle of
    what is observed: far off, length and azimuth cannot be told from the crest (`trains.about` moves a surface).
    Where the program cannot adjust waves (IIA) they are `considered`: known, and their errors are propagated.

    depth (k,) or one for all (m, infinite for deep water): the speed of a wave follows its unknown length as linear
    theory has it in such water; NaN: it stays, or where `steady` (k,) or for all is true, the period does.
    names (k,) of the waves; without, their numbers.
    """

    surface: Surface
    time: FloatArray
    origin: FloatArray
    sigma: FloatArray | None = None
    depth: FloatArray | float = np.nan
    steady: BoolArray | bool = False
    names: tuple[str, ...] = ()
    considered: bool = False
    observed: bool = True  # unknown parameters have the given values as observations

    @cached_property
    def trains(self) -> Trains:
        """The waves with their parameters. Raises `ValueError` where the surface is no sum of sinusoidal waves."""
        from musatpy.refraction.waves import Harmonic, Trains

        if not isinstance(self.surface, Harmonic):
            raise ValueError("only sinusoidal waves and sums of them can be unknown")
        return Trains.of(self.surface, self.depth, self.steady)

    @property
    def unknown(self) -> BoolArray:
        """(k, 4) the parameter is unknown; (0, 4) where all waves are known."""
        if self.sigma is None or self.considered:
            return np.zeros((0, 4), dtype=bool)
        return np.isfinite(self.sigma)


@dataclass(frozen=True, kw_only=True, eq=False)
class SeaIncidence(Incidence):
    """An incidence on waves: its partials (N, 3, w) by their w unknown parameters, wave by wave.

    place (N, 2): x and y of the incidence point about the origin of the waves; by_slope (N, 3, 2): partials by the
    gradient that the waves have there.
    """

    by_waves: FloatArray
    by_slope: FloatArray
    place: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkingSea:
    """A sea in the working frame of a job: origin (3,) and axes (3, 3), rows east, north, up there.

    trains: of unknown waves, where they stand now; None where they are known.
    """

    sea: Sea
    frame: Frame
    origin: FloatArray
    axes: FloatArray
    trains: Trains | None = None

    @classmethod
    def of(cls, sea: Sea, frame: Frame) -> WorkingSea:
        """Return the sea in a frame, its waves as they were given."""
        origin = np.asarray(frame.working(sea.origin))
        trains = sea.trains if sea.unknown.any() else None
        return cls(sea=sea, frame=frame, origin=origin, axes=np.asarray(frame.axes(origin)), trains=trains)

    def at(self, waves: FloatArray) -> WorkingSea:
        """Return the sea with the parameters (k, 4) of its waves as they are; (0, 4) where they are known."""
        if self.trains is None:
            return self
        trains = self.trains.with_values(waves)
        return replace(self, sea=replace(self.sea, surface=trains.surface), trains=trains)

    @property
    def known(self) -> WorkingSea:
        """The sea with its waves taken for known."""
        return replace(self, sea=replace(self.sea, sigma=None), trains=None)

    @property
    def unknown(self) -> WorkingSea:
        """The sea with its considered waves as unknowns that nothing observes."""
        return replace(self, sea=replace(self.sea, considered=False, observed=False), trains=self.sea.trains)

    @property
    def waves(self) -> FloatArray:
        """(k, 4) the parameters of the waves; (0, 4) where they are known."""
        return np.zeros((0, 4)) if self.trains is None else self.trains.values

    def likeliest(self, waves: FloatArray) -> FloatArray:
        """Return parameters (k, 4) of the same waves, as near to those given as their sigmas have it.

        A crest a length on is as good, and so is one half a length on of the opposite height.
        """
        sigma = self.sea.sigma
        if self.trains is None or sigma is None:
            return waves
        prior, weight = self.waves, np.nan_to_num(1.0 / np.square(sigma))
        free = self.sea.unknown
        best = waves
        for halves in range(-_HALVES, _HALVES + 1):
            allowed = free[:, CREST] & (free[:, HEIGHT] | (halves % 2 == 0))
            same = waves.copy()
            same[:, HEIGHT] *= (-1.0) ** halves
            same[:, CREST] += 0.5 * halves * waves[:, LENGTH]
            squares = [np.sum(weight * np.square(values - prior), axis=1) for values in (same, best)]
            best = np.where((allowed & (squares[0] < squares[1] - _NEARER))[:, None], same, best)
        return best

    @property
    def sensible(self) -> bool:
        """Whether these are waves: a step may have led astray."""
        return self.trains is None or self.trains.sensible

    def incidence(
        self, photo: IntArray, camera: FloatArray, ground: FloatArray, tide: FloatArray, index: float
    ) -> SeaIncidence:
        """Return the incidence points of rays (N,) from ground points to cameras (N, 3), with partials as `flat`.

        A point above its wave keeps its straight ray. Raises `AdjustmentError`.
        """
        from musatpy.refraction import fermat

        R, lift = self._local(ground)
        start, time = self._place(R, lift - tide, camera, ground), self.sea.time[photo]
        bent = _refracted(
            lambda: fermat.incidence(
                self.sea.surface, start, self._place(R, lift - tide, ground, ground), index, time
            )
        )
        Rt, place = np.swapaxes(R, -1, -2), (start + bent.v)[:, :2]
        return SeaIncidence(
            v=_turned(Rt, bent.v),
            by_camera=Rt @ bent.by_camera @ R,
            by_ground=Rt @ bent.by_ground @ R,
            by_level=_turned(Rt, bent.by_level),
            by_index=_turned(Rt, bent.by_index),
            by_waves=Rt @ self._by_waves(bent, place, time),
            by_slope=Rt @ bent.by_slope,
            place=place,
        )

    def elevations(self, photo: IntArray, ground: FloatArray) -> FloatArray:
        """Return how high (N,) m the waves stand above the tides, straight over ground points (N, 3)."""
        R, lift = self._local(ground)
        xy = self._place(R, lift, ground, ground)[:, :2]
        return self.sea.surface.relief(xy, self.sea.time[photo]).height

    def _by_waves(self, bent: WaveIncidence, xy: FloatArray, time: FloatArray) -> FloatArray:
        """Return the partials (N, 3, w) of incidence points at places (N, 2) by the unknown parameters, local axes.

        The waves act through the height and the gradient that they have there (see `WaveIncidence`).
        """
        if self.trains is None:
            return np.zeros((len(xy), 3, 0))
        height, gradient = (partials[..., self.sea.unknown] for partials in self.trains.by_parameters(xy, time))
        return bent.by_level[..., None] * height[:, None] + bent.by_slope @ gradient

    def refracted_ray(
        self,
        photo: IntArray,
        camera: FloatArray,
        direction: FloatArray,
        ground: FloatArray,
        tide: FloatArray,
        index: float,
    ) -> tuple[RefractedRay, FloatArray]:
        """Return where image rays (N,) enter the water, and the partials (N, 3, 3) of their direction by camera.

        The ground points (N, 3) only say where the vertical is. Raises `AdjustmentError`.
        """
        from musatpy.refraction import bending

        R, lift = self._local(ground)
        start = self._place(R, lift - tide, camera, ground)
        bent: WaveRay = _refracted(
            lambda: bending.refracted_ray(
                self.sea.surface, start, _turned(R, direction), index, self.sea.time[photo]
            )
        )
        Rt = np.swapaxes(R, -1, -2)
        ray = RefractedRay(
            origin=camera + _turned(Rt, bent.origin - start),
            direction=_turned(Rt, bent.direction),
            origin_by_camera=Rt @ bent.origin_by_camera @ R,
            origin_by_direction=Rt @ bent.origin_by_direction @ R,
            direction_by_direction=Rt @ bent.direction_by_direction @ R,
            origin_by_level=_turned(Rt, bent.origin_by_level),
            direction_by_index=_turned(Rt, bent.direction_by_index),
        )
        return ray, Rt @ bent.direction_by_camera @ R

    def _local(self, ground: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the axes (N, 3, 3) at ground points, rows x, y, up, and the heights (N,) of these points."""
        up, height = self.frame.vertical(ground)
        up = np.broadcast_to(up, ground.shape)
        old = self.axes[2]
        # the shortest turn from the vertical at the origin to that at the ground point
        lean = np.einsum("ni,ki->nk", up, self.axes[:2]) / (1.0 + up @ old)[:, None]
        rows = self.axes[:2] - lean[:, :, None] * (up + old)[:, None, :]
        return np.concatenate([rows, up[:, None, :]], axis=1), height

    def _place(self, R: FloatArray, lift: FloatArray, point: FloatArray, ground: FloatArray) -> FloatArray:
        """Return local coordinates (N, 3) of points: x, y about the origin of the waves, z above the tide."""
        plan = _turned(R, point - self.origin)[:, :2]
        z = np.einsum("ni,ni->n", R[:, 2], point - ground) + lift
        return np.concatenate([plan, z[:, None]], axis=1)


def wave_names(sea: Sea) -> tuple[str, ...]:
    """Return names of the unknown parameters of the waves, in their order."""
    if not sea.unknown.any():
        return ()
    from musatpy.model.solution import WAVE_VALUES

    ids = names_of_waves(sea)
    return tuple(f"wave {ids[wave]} {WAVE_VALUES[of]}" for wave, of in np.argwhere(sea.unknown).tolist())


def names_of_waves(sea: Sea) -> tuple[str, ...]:
    """Return the names of unknown waves: as given, else their numbers."""
    return sea.names or tuple(str(wave + 1) for wave in range(len(sea.unknown)))


def sea_of(block: Block, given: Sea | None) -> Sea | None:
    """Return the waves that stand on the water of a block: those of its cards, or those `given` beside it.

    The only place that makes a sea of cards. Raises `AdjustmentError` with every reason why it cannot be adjusted
    with.
    """
    waves, origin = block.waves, block.wave_origin
    if not len(waves.ids):
        if given is not None:
            require_sea(block, given)
        return given
    reasons = []
    if given is not None:
        reasons.append("the cards of the job have waves, but other waves are given too")
    if origin is None:
        reasons.append("waves need the place from which their crests count")
    if reasons or origin is None:
        raise AdjustmentError([Problem(message=reason) for reason in reasons])
    from musatpy.sea import deck_waves  # most jobs have none

    sigma = np.stack([getattr(waves, name) for name in WAVE_SIGMAS], axis=1)
    known = not np.isfinite(sigma).any()
    try:
        surface = deck_waves.surface_of(waves)
        if not known:
            deck_waves.require_sinusoidal(waves)
    except ValueError as error:
        raise AdjustmentError([Problem(message=f"waves: {error}")]) from error
    sea = Sea(
        surface=surface,
        time=block.photos.time,
        origin=np.array(origin.position),
        sigma=None if known else sigma,
        depth=np.nan if known else deck_waves.depths_of_theory(waves),
        steady=np.isfinite(waves.period),
        names=tuple(waves.ids.tolist()),
        considered=not known and block.options.program is not Program.IIIA,
    )
    require_sea(block, sea)
    return sea


def require_sea(block: Block, sea: Sea) -> None:
    """Raise `AdjustmentError` where a block cannot be adjusted with waves, with every reason."""
    options, water = block.options, block.water
    reasons = []
    if options.program is not Program.IIIA and options.refraction is not Refraction.RIGOROUS:
        reasons.append("waves need the refraction RIGOROUS, or the program IIIA")
    if options.water_tilt is Treatment.ADJUST or (water and (water.tilt_east or water.tilt_north)):
        reasons.append("waves need level water: they cannot be combined with a tilt")
    if np.shape(sea.time) != block.photos.tide.shape:
        reasons.append("waves need the time of every exposure above water")
    else:
        seen = np.unique(block.plates.photo[np.isfinite(block.photos.tide)[block.plates.photo]])
        lacking = ", ".join(block.photos.ids[seen[~np.isfinite(sea.time[seen])]])
        if lacking:
            reasons.append(f"waves need the time of every exposure above water; there is none of photo {lacking}")
    if sea.sigma is not None:
        reasons += _why_not_unknown(block, sea, sea.sigma)
    if reasons:
        raise AdjustmentError([Problem(message=reason) for reason in reasons])


def _why_not_unknown(block: Block, sea: Sea, sigma: FloatArray) -> list[str]:
    """Return why the waves of a sea with sigmas cannot be adjusted."""
    reasons = []
    try:
        count = len(sea.trains.values)
    except ValueError as error:
        return [f"waves: {error}"]
    if np.shape(sigma) != (count, 4):
        reasons.append(f"unknown waves need sigmas of height, length, azimuth and crest, shape ({count}, 4)")
    elif not (np.isnan(sigma) | ((sigma > 0.0) & np.isfinite(sigma))).all():
        reasons.append("the sigma of a wave parameter is positive, or not given: then the parameter is known")
    if block.options.program is not Program.IIIA and not sea.considered:
        reasons.append("unknown waves need the simultaneous adjustment, the program IIIA")
    if block.options.datum is Datum.FREE:
        reasons.append("unknown waves need control: they cannot be combined with a free network")
    return reasons


def _refracted(trace: Callable[[], Result]) -> Result:
    try:
        return trace()
    except ValueError as error:
        raise AdjustmentError([Problem(message=f"waves: {error}")]) from error


def _turned(R: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.einsum("nij,nj->ni", R, vectors)
