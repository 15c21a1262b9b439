"""What came of an orientation of one photo, two or three, with sigmas, tests and a verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import numerics
from musatpy.model import Block, OrientationMethod, Weights
from musatpy.model.findings import Concern, Reason
from musatpy.orientation.twomedia.oriented import Oriented, PlaneVerdict, orient
from musatpy.orientation.twomedia.precision import inflation
from musatpy.orientation.twomedia.rays import PHOTO, WATER, Orientation, paper_partials, paper_vector
from musatpy.orientation.twomedia.strip import orient_strip
from musatpy.orienting.placement import Placement, doubt, left_out, misfit, rejection
from musatpy.orienting.strip_answer import StripAnswer, strip_answer
from musatpy.orienting.task import OrientationTask, task_of

_HOUSE = ("omega", "phi", "kappa", "X", "Y", "Z")
_HOUSE_PLANE = ("slope X", "slope Y", "level", "index")


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer(Placement):
    """The orientation of one photo, two or three, of n images and u unknowns.

    paper (6 m + 4,) has the elements of the paper, about the middle of the axes, with sigmas. residuals (n, 2) mm
    of the images that took part. names, correlations (u, u) and variance inflation factors (u,) are those of the
    unknowns. `roots` are the other exact solutions (r,) of a minimum set, none of one with redundancy, with
    root_photos (r m,), numbers of the solutions, from 1, and rows of the photos in each, and root_stations (r m, 3)
    in the system of the job, or of the model.
    """

    oriented: Oriented
    paper: FloatArray
    paper_sigma: FloatArray
    residuals: FloatArray
    names: tuple[str, ...]
    correlations: FloatArray
    inflation: FloatArray
    roots: Orientation
    root_photos: tuple[IntArray, IntArray]
    root_stations: FloatArray


def answer_of(block: Block) -> Answer | StripAnswer:
    """Return the orientation that the ORI card of a block asks for; raw plates are reduced first.

    Raises `OrientationError` where the deck does not suffice, `PlatesError` and `DeckError` as the reduction does,
    and `NumericalError`.
    """
    if block.raw:
        from musatpy.reduction.readings_job import reduce  # most jobs come refined

        block, _ = reduce(block)
    task = task_of(block)
    equal = task.spec.weights is Weights.EQUAL
    with numerics("the orientation"), np.errstate(all="ignore"):  # trial planes are met that no ray reaches
        if task.spec.method is OrientationMethod.STRIP:
            return strip_answer(task, orient_strip(task.sights, task.plane, base=task.base, equal=equal))
        return _answer(task, orient(task.sights, task.method, task.plane, task.base, equal))


def _answer(task: OrientationTask, oriented: Oriented) -> Answer:
    """Return an orientation with its sigmas, scaled by sigma0 where there is redundancy, and what follows."""
    at, points, unknown, photos = oriented.at, oriented.points, oriented.problem.unknown, task.sights.photos
    scale = oriented.sigma0 if oriented.redundancy else 1.0
    sigma = np.where(unknown, scale * oriented.sigma, np.nan)
    error = oriented.sigma[unknown]
    by_photo = sigma[:-WATER].reshape(-1, PHOTO)
    J = paper_partials(at)
    variance = np.diagonal(J @ (scale**2 * oriented.covariance) @ J.T)
    paper, paper_sigma = paper_vector(at), np.where(variance > 0.0, np.sqrt(np.maximum(variance, 0.0)), np.nan)
    depth = at.water_at(points[:, :2]) - points[:, 2]
    camera = task.block.photos.camera[task.photos[oriented.sights.photo]]
    names = [f"{name} of {photo}" for photo in photos for name in _HOUSE]
    names += [f"water {name}" for name in _HOUSE_PLANE]
    roots = oriented.other_roots()
    plane = oriented.verdict(task.spec.limit)
    return Answer(
        task=task,
        at=at,
        inside=points,
        depth=np.full_like(depth, np.nan) if task.dry else depth,
        outliers=oriented.outliers,
        rays=oriented.rays,
        sigma0=oriented.sigma0,
        redundancy=oriented.redundancy,
        fits=oriented.fits,
        plane=plane,
        position_sigma=by_photo[:, 3:],
        attitude_sigma=by_photo[:, :3],
        point_sigma=scale * np.sqrt(np.diagonal(oriented.point_covariance(), axis1=1, axis2=2)),
        paper_photos=paper[:-WATER].reshape(-1, PHOTO),
        paper_photo_sigmas=paper_sigma[:-WATER].reshape(-1, PHOTO),
        water=np.full(WATER, np.nan) if task.dry else at.vector[-WATER:],
        water_sigma=sigma[-WATER:],
        misgivings=tuple(_misgivings(task, oriented, plane, len(roots.level))),
        oriented=oriented,
        paper=paper,
        paper_sigma=paper_sigma,
        residuals=oriented.image_residuals * task.block.cameras.focal_length[camera][:, None],
        names=tuple(name for name, varied in zip(names, unknown, strict=True) if varied),
        correlations=oriented.covariance[np.ix_(unknown, unknown)] / np.outer(error, error),
        inflation=inflation(oriented.adjusted, unknown)[unknown],
        roots=roots,
        root_photos=(
            np.repeat(np.arange(1, len(roots.level) + 1), len(photos)),
            np.tile(np.arange(len(photos)), len(roots.level)),
        ),
        root_stations=task.axes.system(roots.station.reshape(-1, 3)),
    )


def _misgivings(
    task: OrientationTask, oriented: Oriented, plane: tuple[PlaneVerdict, float], roots: int
) -> list[Reason]:
    """Return what speaks against an orientation with so many other roots."""
    reasons = [] if oriented.fits else [misfit(oriented.sigma0)]
    if plane[0] is PlaneVerdict.NOT:
        size = f"{plane[1]:.3g} of the mean depth" if np.isfinite(plane[1]) else "without limit"
        text = (
            f"the plane of water is not determined: the sigma of its level is {size} (limit "
            f"{task.spec.limit:g}); depths and heights are not to be used"
        )
        reasons.append(doubt(Concern.STATION, text))
    if not oriented.adjusted.converged[0]:
        text = (
            f"not determined: the adjustment does not come to rest, and the images fit all along "
            f"{oriented.weakest[0].words}; points above the water, or a tide and a tilt that are known, hold it"
        )
        reasons.append(rejection(Concern.CONVERGENCE, text))
    for direction in oriented.free:
        grade = rejection if direction.moves_photos else doubt
        text = f"nothing determines {direction.words}: other values fit as well"
        reasons.append(grade(Concern.STATION, text))
    if not oriented.redundancy:
        text = f"no redundancy: nothing checks the images; other exact solutions: {roots}"
        reasons.append(doubt(Concern.REDUNDANCY, text))
    return reasons + left_out(task.sights.points, oriented.outliers)
