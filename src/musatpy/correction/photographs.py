"""The photographs that correct apparent points, with the errors of their stations: of a run, or of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
import pyproj

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.triangulation import of_record, of_stations
from musatpy.compilation.true_points import PointSigmas, ThroughWaves
from musatpy.correction.methods import REASON, S44, SIGMAS, CorrectedPoints, Method, ResultColumn, Tally
from musatpy.depth.cameras import CameraStations, read_run, system_of_points
from musatpy.depth.correction import Correction, attempted, require_sight
from musatpy.errors import CompilationError, DepthError, Problem, ProblemsError, RecordError
from musatpy.model import Water
from musatpy.refraction.apparent import REASONS, Fault
from musatpy.soundings.s44 import orders_by_sigmas
from musatpy.units import DEGREE

_WORD = 64  # cameras of one dimension of bits
_DEEPEST = 80.0  # m, beyond what light comes back from in the clearest water
_COLUMNS = {
    "depth": ResultColumn("below the mean tide, m"),
    "factor": ResultColumn("depth / apparent depth", "", decimals=5, in_layers=False),
    "cameras": ResultColumn("how many see the point", "", "u2"),
    "spread": ResultColumn("of the depths of each camera, m", in_layers=False),
    "incidence": ResultColumn("mean angle in air, degrees", "deg", decimals=2, in_layers=False),
    "largest_incidence": ResultColumn("largest angle in air, degrees", "deg", decimals=2, in_layers=False),
    "reason": REASON,
}
_SIGMAS = {**SIGMAS, "sigma_depth": ResultColumn("m"), "s44": S44}  # where the stations have any


@dataclass(frozen=True, kw_only=True, eq=False)
class Photographs:
    """The cameras, what makes sigmas of what they see, or why there are none, and the waves on their water.

    `caution`: what speaks against the run.
    """

    cameras: CameraStations
    errors: PointSigmas | None
    without: str = ""
    caution: str = ""
    through: ThroughWaves | None = None


def of_run(
    path: Path,
    *,
    photos: Sequence[str] = (),
    pointing: float | None = None,
    camera: tuple[float, float, float] | None = None,
    limit: float | None = None,
) -> Photographs:
    """Return the photographs of the record of a run, or some of them.

    `pointing` (mm): sigma of an image coordinate, by default that of the plates of the run; `camera` and `limit` as
    of `read_run`. Raises `DepthError` where the run cannot correct points, and `OSError`.
    """
    cameras = read_run(path, camera=camera, limit=limit, waves=True)
    rows = _rows(path, cameras, photos)
    try:
        run = of_record(path)
    except (CompilationError, RecordError) as error:
        read_run(path)  # without waves, which are not known then
        return Photographs(cameras=cameras.only(rows), errors=None, without=error.problems[0].message)
    sigma = run.block.options.plate_sigma * run.unit_sigma if pointing is None else pointing
    return Photographs(
        cameras=cameras.only(rows),
        errors=PointSigmas(run=run, photos=np.array(rows), pointing=sigma),
        caution=": ".join(part for part in (run.caution, run.because) if part),
        through=None if run.sea is None else ThroughWaves(run=run, photos=np.array(rows)),
    )


def of_table(
    path: Path, cameras: CameraStations, index: float, *, photos: Sequence[str] = (), pointing: float | None = None
) -> Photographs:
    """Return the photographs of a table of stations, or some of them.

    There are sigmas where the table has those of stations, and `pointing` (mm) is given. Raises `DepthError`.
    """
    rows = _rows(path, cameras, photos)
    some = cameras.only(rows)
    if some.sigma is None or pointing is None:
        lacking = "sigmas of stations" if some.sigma is None else "--pointing, the sigma of an image coordinate"
        return Photographs(cameras=some, errors=None, without=f"there is no column or option of {lacking}")
    assert some.rotation is not None and some.camera is not None  # without which a table has no sigmas
    run = of_stations(
        some.names, some.stations.position, some.rotation, some.camera, some.stations.level, some.sigma,
        Water(index=index),
    )  # fmt: skip
    return Photographs(cameras=some, errors=PointSigmas(run=run, photos=np.arange(len(rows)), pointing=pointing))


@dataclass(frozen=True, kw_only=True, eq=False)
class ByPhotographs(Method):
    """Apparent points corrected by all photographs that see them: of how these are, over water of an index."""

    photographs: Photographs
    index: float
    error: ClassVar[type[ProblemsError]] = DepthError
    blank: ClassVar[bool] = True
    of_records: ClassVar[bool] = False

    @property
    def correction(self) -> Correction:
        """What corrects arrays of points."""
        given = {name: getattr(self.photographs, name) for name in ("cameras", "errors", "through")}
        return Correction(index=self.index, system=self.system, **given)

    @property
    def columns(self) -> Mapping[str, ResultColumn]:
        """What is said of a point beside its places."""
        words = -(-len(self.photographs.cameras.names) // _WORD)
        bits = ResultColumn("which see it, in their order", "", "u8", in_table=False, in_layers=False)
        sigmas = {} if self.photographs.errors is None else _SIGMAS
        return {**_COLUMNS, **sigmas, **{f"camera_bits_{word}": bits for word in range(words)}}

    def placed_in(self, source: Path, stated: pyproj.CRS | None, crs: str | None, geoid: str | None) -> Self:
        """Return the method for the points of a file: by the system that is named, or stated, or of the cameras."""
        named = crs or (None if stated is None else stated.to_wkt())
        return replace(self, system=system_of_points(source, self.photographs.cameras.system, named, geoid))

    def __call__(
        self,
        source: str,
        points: FloatArray,
        covariance: FloatArray | None = None,
        classes: IntArray | None = None,
    ) -> CorrectedPoints | Problem:
        """Return what comes of points (n, 3); their own covariances and classes have no part in it."""
        done = attempted(self.correction, source, points)
        if isinstance(done, Problem):
            return done
        true, seen = done
        fault = true.fault.astype(np.int64)
        values = {name: getattr(true, name) for name in ("depth", "factor", "cameras", "spread")}
        values |= {name: getattr(true, name) / DEGREE for name in ("incidence", "largest_incidence")}
        order = orders_by_sigmas(true.depth, np.hypot(*true.sigma.T[:2]), true.sigma[:, 2])
        values |= zip(_SIGMAS, (*true.sigma.T, true.depth_sigma, order), strict=True)
        full = np.zeros((len(seen), -(-seen.shape[1] // _WORD) * _WORD), dtype=bool)
        full[:, : seen.shape[1]] = seen
        bits = np.packbits(full, axis=1, bitorder="little").view("<u8").T
        values |= {f"camera_bits_{word}": of_word for word, of_word in enumerate(bits)}
        return CorrectedPoints(true=true.position, fault=fault, values=values | {"reason": fault}, seen=seen)

    def without_sigmas(self, source: str, points: FloatArray) -> CorrectedPoints | Problem:
        """Return what comes of points (n, 3), of sigmas nothing."""
        return replace(self, photographs=replace(self.photographs, errors=None))(source, points)

    def in_words(self, name: str, points: CorrectedPoints) -> Sequence[str]:
        """Return the texts (n,) of a column in a table: of cameras their names."""
        if name != "cameras" or points.seen is None:
            return super().in_words(name, points)
        return _names(self.photographs.cameras.names, points.seen)

    def require_use(self, source: Path, tally: Tally, apparent: FloatArray) -> None:
        """Raise `DepthError` where there are points, and no camera sees any."""
        count = tally.counts.total() - tally.counts[REASONS[Fault.NOT_FINITE]]
        if count and not tally.seen:
            require_sight(self.correction, count, source, apparent)

    def lines(self, tally: Tally) -> list[str]:
        """Return what has come of points in words, why they have no sigmas, if so, and as what they were taken."""
        first, *lost = super().lines(tally)
        lines = [first]
        if tally.corrected:
            lines.append(
                f"mean factor {tally.mean('factor'):.4f}, deepest {tally.largest('depth'):.3f} m, "
                f"largest spread among cameras {tally.largest('spread'):.3f} m"
            )
            if not np.isnan(sigma := tally.rms("sigma_depth")):
                lines.append(f"sigma of a depth {sigma:.3f} m")
        lines += lost
        if self.photographs.without and tally.corrected:
            lines.append(f"no sigmas: {self.photographs.without}")
        if self.system.ellipsoid:
            lines.append(f"points taken as {self.system.text}")
        return lines

    def doubts(self, tally: Tally) -> list[str]:
        """Return what speaks against the result."""
        doubts = [self.photographs.caution] if self.photographs.caution else []
        if tally.largest("depth") > _DEEPEST:
            doubts.append(
                f"down to {tally.largest('depth'):.0f} m, where no photo shows the bottom: are there values of "
                "empty posts or points among the heights, or heights in another unit?"
            )
        return doubts

    def rejection(self, tally: Tally) -> str:
        """Return why the result is of no use; empty where a point is corrected."""
        if tally.corrected:
            return ""
        dry = 0 < tally.counts[REASONS[Fault.ABOVE_WATER]] == tally.seen
        return "no point is corrected" + (": nothing is under water: heights are positive up" if dry else "")


def _names(names: tuple[str, ...], seen: BoolArray) -> list[str]:
    """Return the names of the cameras that see each point, blanks between them."""
    bits = np.packbits(seen, axis=1)
    patterns = bits.view(f"V{bits.shape[1]}").ravel().tolist()
    texts: dict[bytes, str] = {}
    for pattern in set(patterns):
        chosen = np.unpackbits(np.frombuffer(pattern, dtype=np.uint8), count=len(names))
        texts[pattern] = " ".join(name for name, sees in zip(names, chosen.tolist(), strict=True) if sees)
    return [texts[pattern] for pattern in patterns]


def _rows(path: Path, cameras: CameraStations, photos: Sequence[str]) -> list[int]:
    """Return the rows of cameras by their names, of all without any. Raises `DepthError`."""
    missing = [name for name in photos if name not in cameras.names]
    if missing:
        raise DepthError([Problem(file=str(path), message=f"there is no photo {', '.join(missing)}")])
    return [cameras.names.index(name) for name in photos] or list(range(len(cameras.names)))
