"""What came of an orientation: in the system of the job, or of its model, with sigmas, tests and a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import numerics
from musatpy.model import Block, OrientationMethod, Weights
from musatpy.model.findings import Concern, Grade, Reason
from musatpy.orientation.twomedia.oriented import Oriented, PlaneVerdict, orient
from musatpy.orientation.twomedia.rays import PHOTO, WATER, Orientation, paper_partials, paper_vector
from musatpy.orientation.twomedia.strip import orient_strip
from musatpy.orienting.placement import Placement, doubt, left_out, misfit
from musatpy.orienting.scene import scene_of
from musatpy.orienting.strip_answer import StripAnswer, strip_answer

_HOUSE = ("omega", "phi", "kappa", "X", "Y", "Z")
_HOUSE_PLANE = ("slope X", "slope Y", "level", "index")


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer(Placement):
    """The orientation of one photo, two or three. Arrays have n images."""

    oriented: Oriented

    @property
    def at(self) -> Orientation:
        """The photos over the water, in the axes of the scene."""
        return self.oriented.at

    @property
    def inside(self) -> FloatArray:
        """(p, 3) the points in these axes, NaN for those without a place."""
        return self.oriented.points

    @property
    def outliers(self) -> BoolArray:
        """(p,) points that are left out, as they do not fit."""
        return self.oriented.outliers

    @property
    def sigma0(self) -> float:
        """Standard deviation of unit weight, NaN without redundancy."""
        return self.oriented.sigma0

    @property
    def summary(self) -> str:
        """The plane of water in a few words."""
        if self.scene.dry:
            return "no point under water: straight rays"
        plane, share = self.plane
        return f"plane of water {plane} ({share:.3g} of the depth)"

    @cached_property
    def scale(self) -> float:
        """Sigma0, by which sigmas are scaled; 1 without redundancy."""
        return self.oriented.sigma0 if self.oriented.redundancy else 1.0

    @cached_property
    def covariance(self) -> FloatArray:
        """(6 m + 4, 6 m + 4)."""
        return self.scale**2 * self.oriented.covariance

    @cached_property
    def sigma(self) -> FloatArray:
        """(6 m + 4,) NaN for what is held."""
        sigma = self.scale * self.oriented.sigma
        return np.where(self.unknown, sigma, np.nan)

    @cached_property
    def unknown(self) -> BoolArray:
        """(6 m + 4,)."""
        return self.oriented.problem.unknown

    @property
    def position_sigma(self) -> FloatArray:
        """(m, 3) m, NaN for what is held."""
        return self._by_photo(self.sigma)[:, 3:]

    @property
    def attitude_sigma(self) -> FloatArray:
        """(m, 3) rad, NaN for what is held."""
        return self._by_photo(self.sigma)[:, :3]

    @cached_property
    def paper(self) -> FloatArray:
        """(6 m + 4,) the elements of the paper, about the middle of the axes."""
        return paper_vector(self.oriented.at)

    @cached_property
    def paper_sigma(self) -> FloatArray:
        """(6 m + 4,) NaN for what is held."""
        J = paper_partials(self.oriented.at)
        variance = np.diagonal(J @ self.covariance @ J.T)
        return np.where(variance > 0.0, np.sqrt(np.maximum(variance, 0.0)), np.nan)

    def _by_photo(self, vector: FloatArray) -> FloatArray:
        return vector[:-WATER].reshape(-1, PHOTO)

    @property
    def paper_photos(self) -> FloatArray:
        """(m, 6) phi, omega, kappa, X0, Y0, Z0."""
        return self._by_photo(self.paper)

    @property
    def paper_photo_sigmas(self) -> FloatArray:
        """(m, 6)."""
        return self._by_photo(self.paper_sigma)

    @cached_property
    def water(self) -> FloatArray:
        """(4,) slopes towards X and Y, level at the origin of the axes (m), index."""
        water = self.oriented.at.vector[-WATER:]
        return np.full_like(water, np.nan) if self.scene.dry else water

    @property
    def water_sigma(self) -> FloatArray:
        """(4,)."""
        return self.sigma[-WATER:]

    @cached_property
    def plane(self) -> tuple[PlaneVerdict, float]:
        """Whether the plane is determined, and the sigma of its level over the mean depth."""
        return self.oriented.verdict(self.scene.spec.limit)

    @cached_property
    def depth(self) -> FloatArray:
        """(p,) m, of the points below the water; negative above it."""
        points = self.oriented.points
        depth = self.oriented.at.water_at(points[:, :2]) - points[:, 2]
        return np.full_like(depth, np.nan) if self.scene.dry else depth

    @cached_property
    def point_sigma(self) -> FloatArray:
        """(p, 3) m, of points without control; NaN for the others."""
        variance = np.diagonal(self.oriented.point_covariance(), axis1=1, axis2=2)
        return self.scale * np.sqrt(variance)

    @property
    def rays(self) -> IntArray:
        """(p,) images that took part."""
        return self.oriented.rays

    @cached_property
    def focal(self) -> FloatArray:
        """(n, 1) mm, of the images that took part."""
        camera = self.block.photos.camera[self.scene.photos[self.oriented.sights.photo]]
        return self.block.cameras.focal_length[camera][:, None]

    @property
    def residuals(self) -> FloatArray:
        """(n, 2) mm, of the images that took part."""
        return self.oriented.image_residuals * self.focal

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The unknowns, in the order of the correlations."""
        every = [f"{name} of {photo}" for photo in self.photos for name in _HOUSE]
        every += [f"water {name}" for name in _HOUSE_PLANE]
        return tuple(name for name, unknown in zip(every, self.unknown, strict=True) if unknown)

    @cached_property
    def correlations(self) -> FloatArray:
        """(u, u) of the unknowns."""
        return self.oriented.correlations[np.ix_(self.unknown, self.unknown)]

    @property
    def inflation(self) -> FloatArray:
        """(u,) variance inflation factors of the unknowns."""
        return self.oriented.inflation[self.unknown]

    @cached_property
    def roots(self) -> Orientation:
        """The other exact solutions (r,) of a minimum set; none of one with redundancy."""
        return self.oriented.other_roots()

    @property
    def root_photos(self) -> tuple[IntArray, IntArray]:
        """(r m,) numbers of the solutions, from 1, and rows of the photos in each."""
        roots, photos = self.roots.station.shape[:2]
        return np.repeat(np.arange(1, roots + 1), photos), np.tile(np.arange(photos), roots)

    @property
    def root_stations(self) -> FloatArray:
        """(r m, 3) in the system of the job, or of the model."""
        return self.scene.axes.system(self.roots.station.reshape(-1, 3))

    def reasons(self) -> list[Reason]:
        """Return what speaks against the answer, besides points on the wrong side of the water."""
        oriented, (plane, share) = self.oriented, self.plane
        reasons = [] if oriented.fits else [misfit(oriented.sigma0)]
        if plane is PlaneVerdict.NOT:
            size = f"{share:.3g} of the mean depth" if np.isfinite(share) else "without limit"
            text = (
                f"the plane of water is not determined: the sigma of its level is {size} (limit "
                f"{self.scene.spec.limit:g}); depths and heights are not to be used"
            )
            reasons.append(doubt(Concern.STATION, text))
        if not oriented.adjusted.converged[0]:
            words = oriented.weakest[0].words
            text = (
                f"not determined: the adjustment does not come to rest, and the images fit all along {words}; "
                "points above the water, or a tide and a tilt that are known, hold it"
            )
            reasons.append(Reason(grade=Grade.REJECTED, concern=Concern.CONVERGENCE, text=text, section=""))
        for direction in oriented.free:
            grade = Grade.REJECTED if direction.moves_photos else Grade.DOUBTFUL
            text = f"nothing determines {direction.words}: other values fit as well"
            reasons.append(Reason(grade=grade, concern=Concern.STATION, text=text, section=""))
        if not oriented.redundancy:
            count = len(self.roots.level)
            text = f"no redundancy: nothing checks the images; other exact solutions: {count}"
            reasons.append(doubt(Concern.REDUNDANCY, text))
        return reasons + left_out(self.scene.sights.points, oriented.outliers)


def answer_of(block: Block) -> Answer | StripAnswer:
    """Return the orientation that the ORI card of a block asks for; raw plates are reduced first.

    Raises `OrientationError` where the deck does not suffice, `PlatesError` and `DeckError` as the reduction does,
    and `NumericalError`.
    """
    if block.raw:
        from musatpy.reduction.readings_job import reduce  # most jobs come refined

        block, _ = reduce(block)
    scene = scene_of(block)
    equal = scene.spec.weights is Weights.EQUAL
    with numerics("the orientation"), np.errstate(all="ignore"):  # trial planes are met that no ray reaches
        if scene.spec.method is OrientationMethod.STRIP:
            strip = orient_strip(scene.sights, scene.plane, base=scene.base, equal=equal)
            return strip_answer(scene, strip)
        return Answer(scene=scene, oriented=orient(scene.sights, scene.method, scene.plane, scene.base, equal))
