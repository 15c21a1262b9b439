"""The photographs that correct apparent points, with the errors of their stations: of a run, or of a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.compilation.triangulation import of_record, of_stations
from musatpy.compilation.true_points import PointSigmas, ThroughWaves
from musatpy.depth.cameras import CameraStations, read_run
from musatpy.errors import CompilationError, DepthError, Problem, RecordError
from musatpy.model import Water


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


def _rows(path: Path, cameras: CameraStations, photos: Sequence[str]) -> list[int]:
    """Return the rows of cameras by their names, of all without any. Raises `DepthError`."""
    missing = [name for name in photos if name not in cameras.names]
    if missing:
        raise DepthError([Problem(file=str(path), message=f"there is no photo {', '.join(missing)}")])
    return [cameras.names.index(name) for name in photos] or list(range(len(cameras.names)))
