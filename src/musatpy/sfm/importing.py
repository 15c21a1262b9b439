"""From a model and what lies beside it to a job: proven, put in place, with its water, and thinned."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import DeckError, Problem, SystemsError, count_of
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block
from musatpy.model.tables import finite_rows
from musatpy.pointfiles.gauges import read_tide, stamp
from musatpy.sfm import bingo, colmap, metashape, opensfm
from musatpy.sfm.block import Beside, Placement, block_of
from musatpy.sfm.control import ImagedControl, read_control
from musatpy.sfm.conventions import MOST, prove
from musatpy.sfm.georeference import Georeference, georeferenced, level_positions
from musatpy.sfm.intersection import of_good_images, of_placed_points
from musatpy.sfm.model import Model, ModelError
from musatpy.sfm.source import FileCameras
from musatpy.sfm.thinning import thinned
from musatpy.sfm.tides import PhotoLevels, datum_heights, given_levels, tide_levels
from musatpy.sfm.times import SOURCES, Exposures, clock_offset, read_exposures
from musatpy.sfm.wet import LIMIT, METRE, Wet, Wetness, read_flags, read_water, wetness

_METRIC = 1e-9  # by which the scale of a file in metres may miss 1
_PIXEL = 0.0024  # mm
NONE = Path("none")
_GROSS = 10.0  # medians: what images that a bundle has used do not miss their points by
_LEAST_DOUBT = 0.05  # m, of the height of a point of a model that was put in place


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the user says of a model; paths are None, numbers NaN where nothing is said."""

    form: str  # colmap, opensfm, metashape
    path: Path
    component: int = 0
    images: Path | None = None  # of a model of Metashape, in BINGO's form; None: image.dat beside it
    gcp: Path | None = None
    gcp_sigma: float = 0.05  # m, of control whose file states none
    gnss: Path | None = None  # None: positions that the model states; NONE: none of these either
    heights: bool = False  # those of positions without RTK too
    lever_arm: tuple[float, ...] = ()  # m, of antennas; empty: positions are those of the projection centres
    crs: str = ""
    geoid: str = ""  # grid of the heights of control
    time_zone: str = ""
    tide: Path | None = None
    tide_datum: str = ""
    tide_zone: str = ""
    tide_sigma: float = np.nan
    level: float = np.nan
    level_sigma: float = np.nan
    water: Path | None = None
    side: str = ""  # of a shoreline, where the water is
    flags: Path | None = None
    per_photo: int = 120
    held: bool = False
    pixel_size: float | None = None  # mm; None: as the file states it, else 2.4 um
    image_sigma: float = 0.5  # px
    index: float = 1.34
    index_sigma: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Imported:
    """A job, what is kept of what it was made from, what there is to say, and the table of its photos."""

    block: Block
    source: dict[str, Any]  # the cameras of its file, and the tide, as the job keeps them
    inputs: dict[str, str]  # SHA-256 of files by their names
    lines: tuple[str, ...]
    warnings: tuple[str, ...]
    photos_csv: bytes


def read_model(asked: Asked) -> Model:
    """Return the model of a path. Raises `ModelError` where there is none of the format."""
    path = asked.path
    if asked.form == "colmap":
        return colmap.read_model(path)
    if asked.form == "opensfm":
        reconstruction = path if path.is_file() else opensfm.reconstruction_of(path)
        if reconstruction is None:
            raise ModelError.of("it has no reconstruction.json", path)
        return opensfm.read_model(reconstruction, asked.component)
    model = metashape.read_model(path, asked.component)
    return model if asked.images is None else bingo.with_images(model, asked.images, asked.pixel_size)


def _completed(asked: Asked) -> Asked:
    """Return what is asked with the folder of a component of COLMAP, or the two files of a model of Metashape."""
    if asked.form == "colmap":
        return replace(asked, path=colmap.component_of(asked.path, asked.component))
    if asked.form == "opensfm":
        return asked
    path = asked.path / "cameras.xml" if asked.path.is_dir() else asked.path
    beside = path.with_name(bingo.IMAGES)
    return replace(asked, path=path, images=asked.images or (beside if beside.is_file() else None))


def imported(asked: Asked, title: str) -> Imported:
    """Return the job of a model. Raises `ModelError`, `DeckError`, `SystemsError` and `OSError`."""
    asked = _completed(asked)
    model = read_model(asked)
    if not len(model.photo):
        message = "it has no images of points, which an adjustment needs"
        message += f": {bingo.IMAGES} of a BINGO export beside it, or --images" * (asked.form == "metashape")
        raise ModelError.of(message, asked.path)
    proof = prove(model, str(asked.images or asked.path), bingo.CONVENTIONS if asked.images else None)
    model = of_placed_points(model)
    lines, warnings = [_size(model)], [*model.notes, *proof.notes]
    lines.append(f"straight rays miss images by {proof.median:.2f} px (median of {proof.images})")
    exposures = _exposures(asked, model)
    if asked.lever_arm and (exposures is None or not np.isfinite(exposures.sigma).all(axis=1).any()):
        raise ModelError.of(
            "a lever arm is of positions with heights: --gnss with those of fixed RTK, or --heights"
        )
    control = None if asked.gcp is None else read_control(asked.gcp, model)
    geo, control_level = _placed(asked, model, control, exposures)
    if geo.placement.ellipsoid is None:  # nothing local leads to what the file says of the earth
        model = replace(model, to_geocentric=None)
    warnings += [*geo.wrong, *geo.notes, *(control.notes if control else ())]
    lines += list(_places(geo))
    levels = _levels(asked, model, geo.placement, exposures)
    if exposures is not None:
        lines += clock_lines(exposures)
        if flat := np.count_nonzero(np.isfinite(exposures.sigma[:, 0]) & np.isnan(exposures.sigma[:, 2])):
            lines.append(f"{flat} photos have positions without heights of use: --heights takes them, with 10 m")
        warnings += clock_offset(exposures).warnings()
    wet = _wetness(asked, model, geo, levels)
    lines += [f"{count_of(count, 'point')} {words}" for words, count in wet.counts().items()]
    warnings += _of_water(model, levels, wet)
    model, gross = of_good_images(model, max(MOST, _GROSS * proof.median), wet.code == Wet.DRY)
    warnings += gross
    kept = thinned(model, wet.code, asked.per_photo)
    used = kept.kept & (wet.code < Wet.UNDECIDED)
    lines.append(f"{np.count_nonzero(used)} of {len(model.points)} points are taken into the job")
    if kept.double.any():
        lines.append(f"{np.count_nonzero(kept.double)} points with two images in one photo are left out")
    warnings += [] if asked.held else _of_lens(wet.code[used])
    beside = _beside(asked, model, exposures, levels, wet, control, control_level)
    tide = {} if levels is None or exposures is None else levels.kept(exposures.time)
    stated = model.pixel_size[np.isfinite(model.pixel_size)].tolist()
    size = asked.pixel_size or next(iter(stated), _PIXEL)
    try:
        block = block_of(
            model, geo.placement, beside, used, size=size, image_sigma=asked.image_sigma * size,
            index=asked.index, index_sigma=asked.index_sigma, held=asked.held, title=title,
        )  # fmt: skip
    except DeckError as error:  # whose fields are those of a deck that is built
        wrong = [problem for problem in error.problems if problem.severity == "error"]
        raise ModelError([replace(problem, card=None, field=None) for problem in wrong]) from None
    return Imported(
        block=block,
        source=FileCameras.of(model, geo.placement, size, asked.held).arrays() | tide,
        inputs=_digests(asked),
        lines=tuple(lines),
        warnings=tuple(warnings),
        photos_csv=_table(model, exposures, levels),
    )


def _of_water(model: Model, levels: PhotoLevels | None, wet: Wetness) -> Iterator[str]:
    """Yield what is to be warned of, where nothing says how high the water is, or heights say another thing."""
    if levels is None:
        yield "no level of the water is given (--tide, --level): all points are taken as dry"
    if wet.against.any():
        names = ", ".join(model.points[wet.against][:5].tolist())
        yield (
            f"{np.count_nonzero(wet.against)} of {len(model.points)} points are wet or dry against their heights: "
            f"{names}; look at the level of the water (unit, sign, datum), and at what says where it is"
        )


def _of_lens(code: IntArray) -> Iterator[str]:
    """Yield what is to be warned of, where the adjustment estimates a lens anew by points with codes (k,)."""
    if (code == Wet.WET).any():
        yield (
            "the lens was estimated over water by a program that knew of none: its focal length is off by pixels, "
            "as a rule short; the adjustment estimates it anew"
        )
        if not (code == Wet.DRY).any():
            yield (
                "no point is dry: control and positions alone tell focal length, heights of stations and the level "
                "of the water from one another; look at their sigmas"
            )


def clock_lines(exposures: Exposures) -> list[str]:
    """Return what is to be said of times, by their sources, and of the camera's clock."""
    counts = np.bincount(exposures.source, minlength=len(SOURCES)).tolist()
    lines = [
        f"times of {count} photos by {name}" for name, count in zip(SOURCES, counts, strict=True) if name and count
    ]
    clock = clock_offset(exposures)
    if clock.photos > 1:
        lines.append(f"camera clock {clock.offset:+.1f} s off GPS time, {clock.drift:+.2f} s a day")
    return lines


def _size(model: Model) -> str:
    counts = len(model.photos), len(model.cameras), len(model.points), len(model.photo)
    return ", ".join(map(count_of, counts, ("photo", "camera", "point", "image")))


def _exposures(asked: Asked, model: Model) -> Exposures | None:
    """Return times and positions of the photos by a table, else positions that the model states; None without."""
    if asked.gnss == NONE or (asked.gnss is None and not np.isfinite(model.reference).any()):
        return None
    if asked.gnss is None:
        position, ellipsoid = level_positions(model.reference, model.reference_system, asked.crs, asked.geoid)
        return None if ellipsoid is None else Exposures.stated(model.photos, position, heights=asked.heights)
    every = read_exposures(asked.gnss, asked.time_zone, heights=asked.heights)
    return every.of(model.photos.tolist(), str(asked.gnss))


def _placed(
    asked: Asked, model: Model, control: ImagedControl | None, exposures: Exposures | None
) -> tuple[Georeference, FloatArray]:
    """Return where the model stands, and the positions (k, 3) of control as the block has them."""
    level, ellipsoid = np.zeros((0, 3)), cast("Ellipsoid | None", Ellipsoid("WGS84"))
    if control is not None:
        try:
            level, of_control = level_positions(control.position, control.system, asked.crs, asked.geoid)
        except SystemsError as error:
            raise SystemsError.of(error, asked.gcp) from None
        if of_control is None and exposures is not None:
            message = "control in local metres and positions of GNSS do not go together: --gnss none, or a system"
            raise ModelError.of(message, asked.gcp)
        ellipsoid = of_control
    stations, sigma = (None, None) if exposures is None else (exposures.position, exposures.sigma)
    # metres of a model are those of its positions: without RTK they are no better than these
    fixed = exposures is not None and bool(exposures.rtk.all())
    to_metres = model.to_geocentric
    metric = fixed and to_metres is not None and bool(abs(np.linalg.det(to_metres[:3, :3]) - 1.0) < _METRIC)
    return georeferenced(model, ellipsoid, control, level, stations, sigma, metric=metric), level


def _places(geo: Georeference) -> Iterator[str]:
    """Yield the RMS of the residuals of first values, east, north, up."""
    for what, off in (("control points", geo.control), ("positions of photos", geo.photos)):
        known = np.isfinite(off).all(axis=1)
        if known.any():
            rms = ", ".join(f"{value:.3f}" for value in np.sqrt(np.mean(np.square(off[known]), axis=0)).tolist())
            yield f"placed by {np.count_nonzero(known)} {what}: RMS east, north, up {rms} m"


def _levels(asked: Asked, model: Model, placement: Placement, exposures: Exposures | None) -> PhotoLevels | None:
    """Return the water at the exposures, None where nothing is said of it."""
    count = len(model.photos)
    time = np.full(count, np.nan) if exposures is None else exposures.time
    stations = placement.positions(model.centre)
    if asked.tide is None:
        if np.isnan(asked.level):
            return None
        sigma = 0.05 if np.isnan(asked.level_sigma) else asked.level_sigma
        levels = given_levels(asked.level, sigma, time)
    elif not np.isfinite(time).any():
        raise ModelError.of("a tide needs the times of the photos: --gnss with a table of exiftool", asked.tide)
    else:
        tide = read_tide(asked.tide, ModelError, asked.tide_zone, asked.tide_sigma)
        datum = datum_heights(asked.tide_datum, stations)
        levels = tide_levels(tide, model.photos.tolist(), time, datum)
    if (levels.level >= stations[:, 2]).any():
        message = (
            f"the water at {levels.level.max():.2f} m is above the lowest photo, at {stations[:, 2].min():.2f} m: "
            "is its level in metres, and --tide-datum the height of its zero above the ellipsoid?"
        )
        raise ModelError([Problem(message=message, file=str(asked.tide or asked.path))])
    return levels


def _wetness(asked: Asked, model: Model, geo: Georeference, levels: PhotoLevels | None) -> Wetness:
    """Return what the points of a model are, by default dry where nothing is said of water."""
    count = len(model.points)
    position = geo.placement.positions(model.position)
    if levels is None:
        dry = np.full(count, Wet.DRY, dtype=np.int64)
        return Wetness(code=dry, source=dry, against=dry > Wet.DRY)
    rays = np.maximum(model.counts, 1)
    level, sigma = (np.bincount(model.point, of[model.photo], count) / rays for of in (levels.level, levels.sigma))
    off = np.concatenate([geo.control, geo.photos])
    off = off[finite_rows(off)]
    doubt = np.fmax(_LEAST_DOUBT, np.sqrt(np.square(off).sum(axis=0) / max(len(off), 1)))
    areas = None
    if asked.water is not None:
        geographic = geo.placement.ellipsoid is not None
        plan, metre = position[:, :2], 1.0
        if geographic:
            plan, metre = np.degrees(position[:, 1::-1]), METRE
        stations = geo.placement.positions(model.centre)
        water = read_water(asked.water, asked.side, geographic=geographic, stations=stations)
        areas = water.codes(plan, LIMIT * float(doubt[:2].max()) * metre)
    flags = None if asked.flags is None else read_flags(asked.flags, model.points)
    return wetness(position[:, 2], np.full(count, doubt[2]), level, sigma, flags=flags, areas=areas)


def _beside(
    asked: Asked,
    model: Model,
    exposures: Exposures | None,
    levels: PhotoLevels | None,
    wet: Wetness,
    control: ImagedControl | None,
    control_level: FloatArray,
) -> Beside:
    """Return what is known besides the model."""
    beside = Beside.nothing(len(model.photos), len(model.points))
    beside = replace(beside, wet=wet.code == Wet.WET)
    if exposures is not None:
        beside = replace(
            beside,
            position=exposures.position,
            position_sigma=exposures.sigma,
            lever_arm=asked.lever_arm,
            time=exposures.time - np.nanmin(np.append(exposures.time, np.inf)),
        )
    if levels is not None:
        beside = replace(beside, tide=levels.level, tide_sigma=levels.sigma, tide_group=levels.group)
    if control is None:
        return beside
    known = np.flatnonzero(finite_rows(control_level))
    number: IntArray = np.full(len(control.ids), -1)
    number[known] = np.arange(len(known))
    images = np.flatnonzero(number[control.point] >= 0)
    sigma = control.sigma[known]
    return replace(
        beside,
        control=control.ids[known],
        control_position=control_level[known],
        control_sigma=np.where(np.isfinite(sigma), sigma, asked.gcp_sigma),
        check=control.check[known],
        control_photo=control.photo[images],
        control_of=number[control.point[images]],
        control_pixel=control.pixel[images],
    )


def _digests(asked: Asked) -> dict[str, str]:
    """Return the SHA-256 of all files that went into a job."""
    given = (asked.images, asked.gcp, asked.gnss, asked.tide, asked.water, asked.flags)
    files = [path for path in given if path not in (None, NONE)]
    files += (
        sorted(path for path in asked.path.iterdir() if path.is_file()) if asked.path.is_dir() else [asked.path]
    )
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in files}


def _table(model: Model, exposures: Exposures | None, levels: PhotoLevels | None) -> bytes:
    """Return the table of the photos: time, where it comes from, the level of the water and its sigma."""
    rows = ["photo,utc,source,level,sigma,flight"]
    for row, name in enumerate(model.photos.tolist()):
        time, source = "", ""
        if exposures is not None and np.isfinite(exposures.time[row]):
            time, source = stamp(float(exposures.time[row])), SOURCES[int(exposures.source[row])]
        of = ["", "", ""]
        if levels is not None:
            of = [f"{levels.level[row]:.4f}", f"{levels.sigma[row]:.4f}", str(levels.group[row])]
        rows.append(",".join([f'"{name}"', time, source, *of]))
    return ("\n".join(rows) + "\n").encode()
