"""Strips through water: truth without errors, joins, errors to first order, control, order of the photos."""

from dataclasses import replace

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.geometry.similarity import fit
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia import joins
from musatpy.orientation.twomedia.oriented import OrientationError, Verdict
from musatpy.orientation.twomedia.sights import Plane, Sights
from musatpy.orientation.twomedia.strip import Strip, control_tests, orient_strip
from musatpy.orientation.twomedia.strip_order import strip_order
from musatpy.orientation.twomedia.strip_triplets import triplets
from musatpy.orientation.twomedia.triplet_models import PLANE
from orientation.twomedia.geometries import Scene
from orientation.twomedia.strip_scenes import corners, strip_scene, strip_sights, strip_truth

LEVEL = Plane(treatment=PlaneTreatment.LEVEL)


def known(true: Scene) -> Plane:
    return Plane(treatment=PlaneTreatment.KNOWN, level=true.d)


def elements(strip: Strip) -> FloatArray:
    """Return all that a strip says of its photos, planes and points."""
    at = strip.orientation()
    return np.concatenate([at.attitude.ravel(), at.station.ravel(), strip.planes().ravel(), strip.points().ravel()])


def variances(strip: Strip) -> FloatArray:
    """Return their variances for unit weight."""
    parts = (*strip.photo_covariance(), strip.plane_covariance(), strip.point_covariance())
    return np.concatenate([np.diagonal(part, axis1=1, axis2=2).ravel() for part in parts])


def test_the_mismatch_of_the_planes_of_a_join_has_the_sigma_of_its_errors() -> None:
    """The plane goes with the points of the join: its change by errors of the images, and the sigma of that."""
    sights, _ = strip_sights(strip_scene("lab", 4, 30))
    before, after = triplets(sights, [Plane()] * 2)
    join = joins.joined(before, after)
    there = after.moved(join.move, np.array([PLANE]))
    by_image = np.zeros((2, 3, sights.image.size))
    for row, model, by in ((0, before, np.eye(3)), (1, after, there.by_old[0])):
        by_image[row][:, model.columns] = by @ model.influence(np.array([PLANE]))[0]
    moved_by = np.zeros((7, sights.image.size))
    moved_by[:, join.column : join.column + join.by_image.shape[1]] = join.by_image
    D = by_image[0] - by_image[1] - there.by_change[0] @ moved_by
    told = np.sqrt(np.square(D) @ np.square(sights.image_sigma).ravel())
    np.testing.assert_allclose(join.plane_sigma, told, rtol=1e-9)
    errors = 1e-7 * np.random.default_rng(5).normal(size=sights.image.shape)
    changed = joins.joined(*triplets(replace(sights, image=sights.image + errors), [Plane()] * 2))
    change = D @ errors.ravel()
    np.testing.assert_allclose(changed.plane - join.plane, change, rtol=0.0, atol=5e-3 * np.abs(change).max())


def test_a_wrong_point_is_left_out_of_a_join() -> None:
    sights, _ = strip_sights(strip_scene("lab", 4, 30), noise=1.0)
    first, second = triplets(sights, [Plane()] * 2)
    common = np.intersect1d(first.points, second.points)
    wrong = int(np.searchsorted(second.points, common[4]))
    second.value[7 + wrong] += [0.0, 0.05, 0.0]
    join = joins.joined(first, second)
    assert join.points[join.left_out].tolist() == [common[4]]
    assert 0.7 < join.sigma0 < 1.4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lab", "aerial"])
@pytest.mark.parametrize("plane", ["model", "free", "level", "known"])
def test_a_strip_without_errors_is_the_truth(name: str, plane: str) -> None:
    true = strip_scene(name, 6, 30)
    sights, rows = strip_sights(true, control=None if plane == "model" else corners(true))
    strip = orient_strip(sights, {"level": LEVEL, "known": known(true)}.get(plane, Plane()))
    at, points = strip_truth(true)
    station, place = strip.orientation().station, strip.points()
    if plane == "model":
        move = fit(place, points[rows], np.ones(len(rows)))
        station, place = move.apply(station), move.apply(place)
    assert np.abs(station - at.station).max() < 1e-9 * true.kind.H
    assert np.abs(place - points[rows]).max() < 1e-9 * true.kind.H
    assert strip.settled and not strip.outliers.any()


def small_strip(per_photo: int = 20) -> tuple[Scene, Sights]:
    """Return a strip of four photos on four control points with errors of their own."""
    true = strip_scene("lab", 4, per_photo)
    sights, _ = strip_sights(true, control=[*corners(true)[::2], corners(true)[1]])
    return true, replace(sights, control_sigma=np.full_like(sights.control_sigma, 1e-3))


def test_one_error_of_the_water_counts_once_however_many_planes_show_it() -> None:
    """What the planes say of the ground, against least squares with that error in the covariances of all of them.

    Errors of a triplet's own are about as large, and planes differ in them: the weights are near the best ones.
    """
    true, sights = small_strip(24)
    tide = Plane(treatment=PlaneTreatment.ADJUST, slope_sigma=3e-3, level=true.d, level_sigma=1e-2)
    strip = orient_strip(sights, tide, common_plane=False)
    assert strip.known is not None and strip.placed is not None
    known, count = strip.known, len(strip.known.row)
    assert known.plane.sum() == 2 and (known.shared > 0.0).all()
    G, V = np.zeros((count, 3, 7)), np.zeros((count, 3, count, 3))
    for number, (of, row) in enumerate(zip(known.model, known.row, strict=True)):
        model = strip.models[of]
        there = model.on_ground(strip.drift.moves[of], np.array([row]))
        J, G[number] = (there.by_old @ model.influence(np.array([row])))[0], there.by_change[0]
        V[number, :, number] = (J * model.variance) @ J.T + np.diag(known.variance[number])
    for one in np.flatnonzero(known.plane):
        for other in np.flatnonzero(known.plane):
            V[one, :, other] += np.diag(known.shared)
    given = np.isfinite(known.target).ravel()
    A = G.reshape(-1, 7)[given]
    W = np.linalg.inv(V.reshape(3 * count, -1)[np.ix_(given, given)])
    gain = np.zeros((7, 3 * count))
    gain[:, given] = np.linalg.solve(A.T @ W @ A, A.T @ W)
    best = gain.reshape(7, count, 3)[:, known.plane].sum(axis=1)
    found = strip.placed.gain[known.plane].sum(axis=0)
    np.testing.assert_allclose(found, best, rtol=0.0, atol=0.05 * np.abs(best).max())


@pytest.mark.slow
def test_errors_of_a_strip_by_chance() -> None:
    """Over a known plane; other waters are held to differences below."""
    true, sights = small_strip()
    water, tiny = known(true), 1e-3
    strip = orient_strip(sights, water, common_plane=False)
    draws, total, number = np.random.default_rng(2), 0.0, 16
    for _ in range(number):
        drawn = {
            name: getattr(sights, name) + tiny * sigma * draws.normal(size=sigma.shape)
            for name, sigma in (("image", sights.image_sigma), ("control", sights.control_sigma))
        }
        moved = elements(orient_strip(replace(sights, **drawn), water, common_plane=False)) - elements(strip)
        total = total + np.square(moved / tiny) / number
    told = variances(strip)
    loose = told > 1e-12 * told.max()
    loose[24:30] = False  # a plane that is known has no error
    ratio = np.sqrt(total[loose] / told[loose])
    assert 0.85 < np.sqrt(np.mean(np.square(ratio))) < 1.15  # 16 draws, of which one moves all elements together
    assert 0.4 < ratio.min() and ratio.max() < 1.7


@pytest.mark.slow
def test_errors_of_a_strip_against_differences() -> None:
    """Each image and each known number moved by itself: variances of all elements, to first order."""
    true, sights = small_strip()
    water = Plane(treatment=PlaneTreatment.ADJUST, slope_sigma=3e-4, level=true.d, level_sigma=1e-3)
    strip = orient_strip(sights, water)
    h, total = 1e-6, np.zeros(len(elements(strip)))

    def add(changed: Sights, sigma: float, plane: Plane = water) -> None:
        after = orient_strip(changed, plane)
        total[:] += np.square((elements(after) - elements(strip)) / h * sigma)

    for place in np.ndindex(sights.image.shape):
        image = sights.image.copy()
        image[place] += h
        add(replace(sights, image=image), float(sights.image_sigma[place]))
    for place in np.argwhere(np.isfinite(sights.control)):
        control = sights.control.copy()
        control[tuple(place)] += h
        add(replace(sights, control=control), 1e-3)
    add(sights, 1e-3, replace(water, level=true.d + h))
    add(sights, 3e-4, replace(water, slope=(h, 0.0)))
    add(sights, 3e-4, replace(water, slope=(0.0, h)))
    told = variances(strip)
    loose = told > 1e-12 * told.max()
    np.testing.assert_allclose(np.sqrt(total[loose]), np.sqrt(told[loose]), rtol=0.01)


@pytest.mark.slow
def test_one_plane_for_all_triplets_lowers_the_error_of_height_at_the_end() -> None:
    """In the axes of the first triplet, 12 photos: sigma of the last station .030 m over planes of their own."""
    sights, _ = strip_sights(strip_scene("lab", 12), noise=1.0)
    height = [orient_strip(sights, Plane(), common_plane=common) for common in (True, False)]
    common, free = (float(np.sqrt(strip.photo_covariance()[1][-1, 2, 2])) for strip in height)
    assert free == pytest.approx(0.030, abs=0.002) and common == pytest.approx(0.018, abs=0.002)


@pytest.mark.slow
def test_a_plane_from_the_air_is_not_determined() -> None:
    sights, _ = strip_sights(strip_scene("aerial", 5), noise=1.0)
    assert orient_strip(sights, Plane()).verdict(0.1)[0] is Verdict.NOT
    true = strip_scene("lab", 5)
    assert orient_strip(strip_sights(true, noise=1.0)[0], Plane()).verdict(0.1)[0] is Verdict.DETERMINED


@pytest.mark.slow
def test_wrong_control_and_wrong_images_are_left_out() -> None:
    true = strip_scene("lab", 6, 30)
    known = [*corners(true), *range(20, 26)]
    sights, rows = strip_sights(true, noise=1.0, control=known)
    control, image = sights.control.copy(), sights.image.copy()
    control[rows == known[2]] += [0.0, 0.1, 0.0]
    at = int(np.flatnonzero((np.bincount(sights.point)[sights.point] >= 3) & (sights.photo == 3))[5])
    image[at, 1] += 2e-3
    strip = orient_strip(replace(sights, control=control, image=image), LEVEL)
    out = rows[strip.outliers]
    assert known[2] in out and rows[sights.point[at]] in out and len(out) <= 3
    assert np.abs(strip.orientation().station - strip_truth(true)[0].station).max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_control_that_does_not_hold_a_strip(count: int) -> None:
    true = strip_scene("lab", 4, 30)
    sights, _ = strip_sights(true, control=corners(true)[:count])
    with pytest.raises(OrientationError, match=r"two control points|leave (tilt|heading|scale)"):
        orient_strip(sights, Plane())
    if count == 2:  # a level plane holds the tilts
        assert orient_strip(sights, LEVEL).settled


def test_the_order_of_the_photos_is_that_of_their_overlaps() -> None:
    sights, _ = strip_sights(strip_scene("lab", 9))
    shuffled = np.array([4, 0, 7, 2, 8, 1, 6, 3, 5])
    ids = sights.photos[np.argsort(shuffled)]
    order = strip_order(shuffled[sights.photo], sights.point, ids)
    assert ids[order].tolist() in (sights.photos.tolist(), sights.photos[::-1].tolist())
    assert order[0] < order[-1]  # from the end that comes first


def test_a_gap_and_a_block_are_named() -> None:
    sights, _ = strip_sights(strip_scene("lab", 9))
    left = (sights.photo < 4) | (sights.photo > 6)
    photo = np.where(sights.photo > 6, sights.photo - 3, sights.photo)
    with pytest.raises(OrientationError, match=r"a gap: .*P0, P1, P2, P3 \| P7, P8"):
        strip_order(photo[left], sights.point[left], sights.photos[[0, 1, 2, 3, 7, 8]])
    X, Y = np.meshgrid(np.arange(60.0), np.arange(30.0))
    stations = [(x, y) for y in (10.0, 20.0) for x in np.arange(10.0, 60.0, 5.0)]
    shown = [np.flatnonzero((np.abs(X - x) < 9) & (np.abs(Y - y) < 9)) for x, y in stations]
    photo = np.repeat(np.arange(len(stations)), [len(points) for points in shown])
    with pytest.raises(OrientationError, match="a block, or branches, is not for STRIP"):
        strip_order(photo, np.concatenate(shown), np.array([str(row) for row in range(len(stations))]))


def five_photos(noise: float = 0.0) -> Sights:
    return strip_sights(strip_scene("lab", 5, 24), noise=noise)[0]


@pytest.mark.slow
def test_tests_of_control_are_one_in_the_mean() -> None:
    """Squares of three coordinates over their covariances, of draws of images and control."""
    true = strip_scene("lab", 4, 24)
    sights, _ = strip_sights(true, control=corners(true))
    sights = replace(sights, control_sigma=np.full_like(sights.control_sigma, 2e-3))
    draws, squares = np.random.default_rng(3), []
    for _ in range(12):
        drawn = {
            name: getattr(sights, name) + sigma * draws.normal(size=sigma.shape)
            for name, sigma in (("image", sights.image_sigma), ("control", sights.control_sigma))
        }
        strip = orient_strip(replace(sights, **drawn), Plane())
        assert strip.known is not None and strip.placed is not None
        squares.append(control_tests(strip.known, strip.placed, strip.drift) / 3.0)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.3)  # 132 free squares: three deviations are 0.37


def test_points_are_those_of_the_triplets_that_show_them_most_often() -> None:
    sights = five_photos()
    strip = orient_strip(sights, Plane())
    rays = np.zeros((len(strip.models), len(sights.points)), dtype=int)
    for number in range(len(strip.models)):
        here = (sights.photo >= number) & (sights.photo < number + 3)
        rays[number] = np.bincount(sights.point[here], minlength=len(sights.points))
    assert (rays[strip.of_point, np.arange(len(sights.points))] == rays.max(axis=0)).all()
    assert rays.max(axis=0).min() == 2 and rays.max() == 3
