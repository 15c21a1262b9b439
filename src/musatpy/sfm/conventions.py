"""Whether a file means what its reader takes it to mean, proven by its own images; if not, what it seems to mean.

A file of the right convention has straight-ray residuals of a pixel or so, and reproduces the residuals that it
states. One of another convention is refused: what fits is named, never applied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import Problem
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.intersection import intersections
from musatpy.sfm.model import Model, ModelError, spread

Conventions = tuple[tuple[str, Callable[[Model], Model | None]], ...]  # names, and what each makes of a model
MOST = 3.0  # px, of the median residual
_IMAGES = 2000  # that are looked at
_BEHIND = 0.01  # of the images, at points behind their cameras
_SAME = 0.01  # px, between a stated residual and a computed one
_AGREEING = 0.95  # of the points, where the residuals that a file states are reproduced
_BETTER = 0.5  # of the residuals, under another convention
_WORTH = 0.3  # px, by which they must be less
_LIKE = 1.05  # of the least residuals: conventions that fit as well
_HALF = 0.15  # px, about the half one by which all images are off
_OUTSIDE = 0.01  # of the images, beyond the edges


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What the images of a model say of it."""

    images: int  # that were looked at
    median: float  # px, of their straight-ray residuals
    notes: tuple[str, ...] = ()  # residuals that are not what the file states


def prove(model: Model, source: str, images: Conventions | None = None) -> Proof:
    """Return the residuals of some 2,000 images spread over a model, which must have some.

    `source` is the file that messages name. `images` are what images mean that are no part of the model: their
    points are intersected then, under each convention anew. Raises `ModelError` that names the convention which
    fits where the median residual is above 3 px or more than a hundredth of the points lie behind their cameras,
    where the residuals are half as large under another convention, where all images are off by half a pixel, and
    where the residuals that the file states are those of another convention.
    """
    sample = _sample(model, _IMAGES)
    error = _residuals(sample, images)
    size = _sizes(error)
    median, behind = float(np.median(size)), float(np.mean(np.isinf(size)))
    agreement = _agreement(sample)
    if median > MOST or behind > _BEHIND:
        raise _refusal(sample, source, images, median, behind)
    if agreement is not None and agreement < _AGREEING:
        fitting = [name for name, other in _others(sample, images, 1) if (_agreement(other) or 0.0) >= _AGREEING]
        if fitting:
            message = "the residuals that the file states are not those of its images, but they are if "
            raise ModelError([Problem(message=message + " or ".join(fitting), file=source)])
    if agreement is None or agreement < _AGREEING:
        small = _small(sample, error, median, images)
        if small:
            raise ModelError([Problem(message=small, file=source)])
    return Proof(images=len(size), median=median, notes=_differences(model))


def _small(sample: Model, error: FloatArray, median: float, images: Conventions | None) -> str:
    """Return what is wrong with residuals that are not large, empty for nothing."""
    fits = _fitting(sample, images, _BETTER * median, 1)
    if fits and median - fits[0][1] > _WORTH:
        return _named(f"the median residual of {len(error):,} images is {median:.2f} px", fits)
    known = error[np.isfinite(error).all(axis=1)]
    shift, apart = np.median(known, axis=0), np.median(np.abs(known - np.median(known, axis=0)), axis=0)
    doubt = 1.9 * float(apart.max()) / np.sqrt(len(known))  # sigma of a median
    for name, half in ((_FIRST_AT_0, 0.5), (_FIRST_AT_1, -0.5)):
        if float(np.abs(shift - half).max()) < _HALF and 3.0 * doubt < _HALF:
            by = ", ".join(f"{value:.2f}" for value in shift.tolist())
            return f"all images are off by {by} px, as they are if {name}"
    return ""


def _refusal(sample: Model, source: str, images: Conventions | None, median: float, behind: float) -> ModelError:
    """Return why a model is refused, with what fits."""
    what = f"the median residual of {len(sample.photo):,} images is {median:,.2f} px"
    if behind > _BEHIND:
        what = f"{behind:.0%} of {len(sample.photo):,} images show no points ahead of their cameras"
    for changes in (1, 2):
        fits = _fitting(sample, images, min(MOST, _BETTER * median), changes)
        if fits:
            return ModelError([Problem(message=_named(what, fits), file=source)])
    message = f"{what}, and no other convention fits: its stations, points and images are not of one adjustment"
    return ModelError([Problem(message=message, file=source)])


def _named(what: str, fits: list[tuple[str, float]]) -> str:
    every = " or ".join(name for name, _ in fits)
    return f"{what}; it would be {fits[0][1]:.2f} px if {every}: export the model by its format's convention"


def _fitting(sample: Model, images: Conventions | None, most: float, changes: int) -> list[tuple[str, float]]:
    """Return the conventions of the least median residual (px), as several may have it; none above `most`."""
    scores = []
    for name, other in _others(sample, images, changes):
        size = _sizes(_residuals(other, images))
        if np.mean(np.isinf(size)) <= _BEHIND and np.median(size) <= most:
            scores.append((name, float(np.median(size))))
    least = min((score for _, score in scores), default=0.0)
    return sorted((fit for fit in scores if fit[1] <= _LIKE * least), key=lambda fit: fit[1])


def _others(sample: Model, images: Conventions | None, changes: int) -> Iterator[tuple[str, Model]]:
    """Yield the sample under other conventions, of so many changes each."""
    for several in combinations((_PIXELS if images is None else images) + _CAMERAS, changes):
        other: Model | None = sample
        for _, change in several:
            other = change(other) if other is not None else None
        if other is not None:
            yield " and ".join(name for name, _ in several), other


def _sample(model: Model, most: int) -> Model:
    """Return a model of points, spread over it, that have so many images together."""
    chosen = spread(len(model.points), max(4, int(len(model.points) * most / len(model.photo))))
    return model.of_points(chosen)


def _residuals(sample: Model, images: Conventions | None) -> FloatArray:
    """Return residuals (m, 2) px, of points that are intersected if they are not the file's own and can be."""
    if images is None:
        return sample.residuals()
    at = intersections(sample, sample.photo, sample.point, sample.pixel, len(sample.points))
    rows = np.flatnonzero(np.isfinite(at[sample.point, 0]))
    return replace(sample, position=at).residuals(rows) if len(rows) else np.full((1, 2), np.nan)


def _sizes(error: FloatArray) -> FloatArray:
    """Return the lengths (m,) of residuals, infinite where there is none."""
    size = np.linalg.norm(error, axis=1)
    return np.where(np.isfinite(size), size, np.inf)


def _means(sample: Model) -> FloatArray:
    """Return the mean residual (p,) px of each point."""
    size = _sizes(sample.residuals())
    return np.bincount(sample.point, size, len(sample.points)) / np.maximum(sample.counts, 1)


def _stated(sample: Model) -> IntArray:
    """Return the rows of points of which the file states a residual."""
    return np.flatnonzero(sample.stored > 0.0) if len(sample.stored) else np.zeros(0, dtype=np.int64)


def _agreement(sample: Model) -> float | None:
    """Return the share of the points whose stated residuals are reproduced, None where none is stated."""
    rows = _stated(sample)
    return float(np.mean(np.abs(_means(sample)[rows] - sample.stored[rows]) < _SAME)) if len(rows) else None


def _differences(model: Model) -> tuple[str, ...]:
    """Return where stated residuals are not reproduced, in a sentence."""
    sample = _sample(model, 100 * _IMAGES)
    rows = _stated(sample)
    computed = _means(sample)[rows]
    gap = np.abs(computed - sample.stored[rows])
    if not (gap >= _SAME).any():
        return ()
    worst = int(gap.argmax())
    return (
        f"the residuals that the file states of {np.count_nonzero(gap >= _SAME):,} of {len(rows):,} points are not "
        f"those of its images, most at point {sample.points[rows][worst]}: {sample.stored[rows][worst]:.3f} px "
        f"stated, {computed[worst]:.3f} px computed",
    )


def extent(model: Model) -> FloatArray:
    """Return width and height (m, 2) of the photo of each image."""
    size = np.array([(lens.width, lens.height) for lens in model.lenses], dtype=float)
    return size[model.camera[model.photo]]


def _beyond(model: Model) -> bool:
    """Tell whether images lie beyond the edges of their photos."""
    out = (model.pixel < -1.0) | (model.pixel > extent(model) + 1.0)
    return float(np.mean(out.any(axis=1))) > _OUTSIDE


def _moved(share: float) -> Callable[[Model], Model | None]:
    """Return the change of the origin by a share of the extent, where images lie beyond the edges without it."""
    return lambda model: replace(model, pixel=model.pixel + share * extent(model)) if _beyond(model) else None


def scaled(model: Model, factor: FloatArray) -> Model | None:
    """Return images scaled about the middle by factors (m, 1), where they lie beyond the edges without it."""
    middle = 0.5 * extent(model)
    return replace(model, pixel=middle + factor * (model.pixel - middle)) if _beyond(model) else None


def _shorter(model: Model) -> FloatArray:
    return extent(model).min(axis=1, keepdims=True) / extent(model).max(axis=1, keepdims=True)


def _lenses(change: Callable[[PixelLens], PixelLens | None]) -> Callable[[Model], Model | None]:
    """Return the change of every lens; None where one is not concerned."""

    def changed(model: Model) -> Model | None:
        lenses = [lens for lens in map(change, model.lenses) if lens is not None]
        return replace(model, lenses=tuple(lenses)) if len(lenses) == len(model.lenses) else None

    return changed


def _principal(share: float) -> Callable[[Model], Model | None]:
    """Return the change of the principal point by a share of the extent, where it is far from the middle."""

    def changed(lens: PixelLens) -> PixelLens | None:
        (cx, cy), (w, h) = lens.centre, (lens.width, lens.height)
        far = abs(cx / w - 0.5) > 0.25 or abs(cy / h - 0.5) > 0.25
        return replace(lens, centre=(cx + share * w, cy + share * h)) if far else None

    return _lenses(changed)


def _focal(factor: Callable[[PixelLens], float]) -> Callable[[Model], Model | None]:
    return _lenses(lambda lens: replace(lens, focal=(lens.focal[0] * factor(lens), lens.focal[1] * factor(lens))))


def _corrected(model: Model) -> Model:
    """Return the model if polynomials lead from images to rays: images without distortion, and such lenses."""
    pixel, camera = model.pixel.copy(), model.camera[model.photo]
    ideal = tuple(map(bare, model.lenses))
    for number, lens in enumerate(model.lenses):
        of = np.flatnonzero(camera == number)
        pixel[of] = lens.pixels(ideal[number].rays(pixel[of]))
    return replace(model, pixel=pixel, lenses=ideal)


def bare(lens: PixelLens) -> PixelLens:
    """Return a lens without its distortion."""
    return replace(lens, k=(), d=(), p=(0.0, 0.0), fisheye=False)


def _shift(model: Model) -> FloatArray:
    """Return t (n, 3)."""
    return -np.einsum("nij,nj->ni", model.rotation, model.centre)


def _turned(model: Model, R: FloatArray) -> Model:
    """Return the model with other rotations (n, 3, 3), and the place beside them as the file has it: t, or C."""
    if model.program == "metashape":
        return replace(model, rotation=R)
    return replace(model, rotation=R, centre=-np.einsum("nji,nj->ni", R, _shift(model)))


def _exchanged(model: Model) -> Model:
    """Return the model with t and C for each other."""
    if model.program == "metashape":
        return replace(model, centre=-np.einsum("nji,nj->ni", model.rotation, model.centre))
    return replace(model, centre=_shift(model))


def _quaternions(model: Model) -> Model:
    """Return the model if quaternions have their scalar last, which were read as though they had it first."""
    from scipy.spatial.transform import Rotation  # which few need

    last = Rotation.from_matrix(model.rotation).as_quat()
    return _turned(model, Rotation.from_quat(np.roll(last, 1, axis=1)).as_matrix())


_FIRST_AT_0 = "the middle of the first pixel is (0, 0), not (0.5, 0.5)"
_FIRST_AT_1 = "the middle of the first pixel is (1, 1), not (0.5, 0.5)"
_PIXELS: Conventions = (
    ("pixels count from the middle of the image", _moved(0.5)),
    ("pixels count from the corner of the image", _moved(-0.5)),
    (_FIRST_AT_0, lambda model: replace(model, pixel=model.pixel + 0.5)),
    (_FIRST_AT_1, lambda model: replace(model, pixel=model.pixel - 0.5)),
    (
        "y of pixels counts upward",
        lambda model: replace(model, pixel=model.pixel * [1.0, -1.0] + extent(model) * [0.0, 1.0]),
    ),
    ("x and y of pixels are exchanged", lambda model: replace(model, pixel=model.pixel[:, ::-1])),
    ("images are normalised by the shorter side", lambda model: scaled(model, _shorter(model))),
    ("images are normalised by half of the longer side", lambda model: scaled(model, np.full((1, 1), 0.5))),
)
_CAMERAS: Conventions = (
    (
        "focal lengths are normalised by the shorter side",
        _focal(lambda lens: min(lens.width, lens.height) / max(lens.width, lens.height)),
    ),
    ("focal lengths are normalised by half of the longer side", _focal(lambda lens: 0.5)),
    ("the principal point counts from the middle of the image", _principal(0.5)),
    ("the principal point counts from the corner of the image", _principal(-0.5)),
    (
        "y of the principal point counts upward",
        _lenses(lambda lens: replace(lens, centre=(lens.centre[0], lens.height - lens.centre[1]))),
    ),
    ("p1 and p2 are exchanged", _lenses(lambda lens: replace(lens, p=lens.p[::-1]) if any(lens.p) else None)),
    ("the distortion leads from images to rays", _corrected),
    ("rotations are transposed", lambda model: _turned(model, np.swapaxes(model.rotation, 1, 2))),
    (
        "rotations and places are those of the inverse",
        lambda model: replace(model, rotation=np.swapaxes(model.rotation, 1, 2), centre=_shift(model)),
    ),
    ("t and C stand for each other", _exchanged),
    ("quaternions have their scalar last", _quaternions),
    (
        "the camera has y up and z backward",
        lambda model: replace(model, rotation=model.rotation * np.array([1.0, -1.0, -1.0])[:, None]),
    ),
)
