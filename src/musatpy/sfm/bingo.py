"""Images of points in BINGO's image coordinates, as Metashape exports them beside cameras.xml.

Metashape writes what it measured, with the distortion of its adjusted lenses: millimetres about the middle of the
photo, x right, y up, by the size of a pixel that cameras.xml states; photos by their labels ("Use item labels"). By
its options x points elsewhere, or images are those of the initial calibration: such files are named, not read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from musatpy.errors import Problem
from musatpy.formats.families import agencies
from musatpy.formats.records.files import read_records
from musatpy.formats.records.frames import JobFrame
from musatpy.formats.records.rows import parts_of_file
from musatpy.sfm.conventions import MOST, Conventions, bare, extent, scaled
from musatpy.sfm.intersection import intersections
from musatpy.sfm.model import Model, ModelError, refused
from musatpy.sfm.times import matched, unmatched
from musatpy.units import MICROMETRE

IMAGES = "image.dat"  # as Metashape calls it
_APART = 10.0  # times the usual median residual of photos


def with_images(model: Model, path: Path, size: float | None) -> Model:
    """Return a model with the images of a file, and the points that they have: NaN where their rays do not meet.

    `size` is that of a pixel, mm; None: as the model states it. Images on photos that the model does not have are
    left out, and said. Raises `ModelError` with file and line, and `OSError`.
    """
    sizes = model.pixel_size if size is None else np.full((len(model.lenses), 2), size)
    if not np.isfinite(sizes).all():
        message = "images in millimetres need the size of a pixel, which the model does not state: --pixel-size"
        raise ModelError.of(message, path)
    (spec,) = (file for file in agencies()["bingo"].files if file.file == IMAGES)
    read = read_records(path.read_bytes(), spec, str(path))
    tables, faults = parts_of_file(read, JobFrame(None, None, None))
    problems = [*read.problems, *faults]
    refused([problem for problem in problems if problem.severity == "error"])
    if "plates" not in tables:
        raise ModelError.of("it has no images of points", path)
    of_photo, of_point, xy = (tables["plates"][f"plates.{name}"] for name in ("photo", "point", "xy"))
    names, first, row = np.unique(of_photo, return_index=True, return_inverse=True)
    fits = matched(names.tolist(), model.photos.tolist())
    wrong = unmatched(names.tolist(), fits, model.photos)
    lines = dict(zip(names.tolist(), read.lines["point"][first].tolist(), strict=True))
    off = names[fits == -1].tolist()
    refused([Problem(message=wrong[n], file=str(path), line=lines[n]) for n in wrong if n not in off])
    notes = [f"photos of {path.name} that the model does not have: {' '.join(off)}"] * bool(off)
    if len(off) == len(names):
        expected = f"expected: names as {model.photos[0]}, by Metashape's option 'Use item labels'"
        raise ModelError.of(f"{notes[0]}; {expected}", path)
    used = np.flatnonzero(fits[row] >= 0)
    photo = fits[row[used]]
    points, point = np.unique(of_point[used], return_inverse=True)
    pixel = xy[used] / sizes[model.camera[photo]] * [1.0, -1.0]
    notes += [problem.headline() for problem in problems]
    model = replace(model, pixel_size=sizes, points=points, photo=photo, point=point, notes=(*model.notes, *notes))
    model = replace(model, pixel=pixel + 0.5 * extent(model))
    model = replace(model, position=intersections(model, photo, point, model.pixel, len(points)))
    if misfits := _misfits(model):
        raise ModelError.of(f"most of the images are not those of these photos: {misfits}", path)
    return model


def _misfits(model: Model) -> str:
    """Return the photos, and by how much, whose images mostly miss their points as those of others do not."""
    size = np.linalg.norm(model.residuals(), axis=1)
    photo, size = model.photo[np.isfinite(size)], size[np.isfinite(size)]
    ends = np.cumsum(np.bincount(photo, minlength=len(model.photos)))
    parts = np.split(size[np.argsort(photo, kind="stable")], ends[:-1])
    medians = np.array([np.median(part) if len(part) else 0.0 for part in parts])
    usual = float(np.median(medians))
    off = np.flatnonzero((usual < MOST) & (medians > max(MOST, _APART * usual)))
    return ", ".join(f"{model.photos[n]} ({medians[n]:,.1f} px)" for n in off.tolist())


def _turned(model: Model, matrix: Sequence[Sequence[float]]) -> Model:
    """Return a model whose images are turned by a matrix, in millimetres about the middle, x right, y down."""
    middle, size = 0.5 * extent(model), model.pixel_size[model.camera[model.photo]]
    return replace(model, pixel=((model.pixel - middle) * size) @ np.array(matrix).T / size + middle)


def _about_principal_point(model: Model) -> Model:
    centre = np.array([lens.centre for lens in model.lenses])[model.camera[model.photo]]
    return replace(model, pixel=model.pixel + centre - 0.5 * extent(model))


CONVENTIONS: Conventions = (
    ("y points down", lambda model: _turned(model, [[1.0, 0.0], [0.0, -1.0]])),
    ("x points up", lambda model: _turned(model, [[0.0, 1.0], [-1.0, 0.0]])),
    ("x points left", lambda model: _turned(model, [[-1.0, 0.0], [0.0, -1.0]])),
    ("x points down", lambda model: _turned(model, [[0.0, -1.0], [1.0, 0.0]])),
    ("x and y are micrometres", lambda model: scaled(model, np.full((1, 1), MICROMETRE))),
    ("x and y are pixels", lambda model: scaled(model, model.pixel_size[model.camera[model.photo]])),
    ("x and y are about the principal point", _about_principal_point),
    ("images have no distortion", lambda model: replace(model, lenses=tuple(map(bare, model.lenses)))),
    ("images are those of the initial calibration", lambda model: replace(model, lenses=model.initial)),
)
