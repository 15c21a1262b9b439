"""Thinned tracks: how many a photo, a cell and a pair keep, which ones, and that no order of a file matters."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.colmap import read_model
from musatpy.sfm.model import Model
from musatpy.sfm.thinning import COLUMNS, COMMON, ROWS, Thinned, ranked, thinned, widest_angles
from musatpy.sfm.wet import Wet

SCEAUX = Path(__file__).parents[3] / "shared/cases/sfm/sceaux/colmap_bin"
LENS = PixelLens(width=4000, height=3000, focal=(3600.0, 3600.0), centre=(2000.0, 1500.0))


def block(strips: int = 4, each: int = 6, density: float = 12.0, noise: float = 0.5) -> Model:
    """Return photos 80 m above a plane, 60 % and 40 % over each other, with points of `density` in 10 m squares."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(35.0 * np.arange(each), 40.0 * np.arange(strips))
    centre = np.column_stack([x.ravel(), y.ravel(), np.full(strips * each, 80.0)])
    low, high = centre[:, :2].min(axis=0) - 45.0, centre[:, :2].max(axis=0) + 45.0
    count = int(density * np.prod((high - low) / 10.0))
    position = np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(-2.0, 2.0, count)])
    R = np.diag([1.0, -1.0, -1.0])
    photos, points, pixels = [], [], []
    for photo, station in enumerate(centre):
        rays = (position - station) @ R.T
        pixel = LENS.pixels(rays[:, :2] / rays[:, 2:])
        seen = ((pixel > 0.0) & (pixel < (4000.0, 3000.0))).all(axis=1) & (rng.random(count) < 0.8)
        photos.append(np.full(seen.sum(), photo))
        points.append(np.flatnonzero(seen))
        pixels.append(pixel[seen] + rng.normal(0.0, noise, (seen.sum(), 2)))
    return Model(
        program="test",
        cameras=("1",),
        lenses=(LENS,),
        photos=np.array([f"{number:04d}.jpg" for number in range(len(centre))]),
        camera=np.zeros(len(centre), dtype=np.int64),
        rotation=np.broadcast_to(R, (len(centre), 3, 3)),
        centre=centre,
        points=np.array([f"t{number}" for number in range(count)]),
        position=position,
        photo=np.concatenate(photos),
        point=np.concatenate(points),
        pixel=np.concatenate(pixels),
    )


def dry(model: Model) -> np.ndarray:
    return np.zeros(len(model.points), dtype=np.int64)


def per_cell(model: Model, kept: np.ndarray) -> np.ndarray:
    """Return the images (n, 6, 8) of kept tracks in the cells of photos, all of one size along x."""
    size = np.array([(lens.width, lens.height) for lens in model.lenses])[model.camera[model.photo]]
    cell = np.minimum((model.pixel * (COLUMNS, ROWS) / size).astype(int), (COLUMNS - 1, ROWS - 1))
    out = np.zeros((len(model.photos), ROWS, COLUMNS), dtype=int)
    rows = kept[model.point]
    np.add.at(out, (model.photo[rows], cell[rows, 1], cell[rows, 0]), 1)
    return out


def common(model: Model, kept: np.ndarray) -> np.ndarray:
    """Return the kept tracks (n, n) that photos have in common."""
    seen = np.zeros((len(model.photos), len(model.points)), dtype=int)
    seen[model.photo, model.point] = 1
    return seen[:, kept] @ seen[:, kept].T


def require_pairs_and_cells(model: Model, result: Thinned, per_photo: int) -> None:
    """Each pair has 12 in common or all it has; each photo its images, in all cells that have some in turn."""
    usable = ~result.double & (model.counts > 1)
    every, kept = common(model, usable), common(model, result.kept)
    assert (kept >= np.minimum(every, COMMON)).all()
    full, cells = per_cell(model, usable), per_cell(model, result.kept)
    assert (cells.sum(axis=(1, 2)) >= np.minimum(full.sum(axis=(1, 2)), per_photo)).all()
    level = per_photo // (COLUMNS * ROWS)
    assert (cells >= np.minimum(full, level)).all()


@pytest.mark.skipif(not SCEAUX.is_dir(), reason="the model is not beside the checkout")
def test_a_real_model_keeps_its_best_tracks_over_the_whole_photo() -> None:
    model = read_model(SCEAUX)
    result = thinned(model, dry(model))
    require_pairs_and_cells(model, result, 120)
    images = np.bincount(model.photo[result.kept[model.point]], minlength=len(model.photos))
    assert result.kept.sum() < 0.25 * len(model.points) and images.mean() < 400
    assert model.counts[result.kept].mean() > 1.2 * model.counts.mean()
    every = thinned(model, dry(model), per_photo=0)
    assert (every.kept == ~every.double & (model.counts > 1)).all()
    pairs = np.unique(np.stack([model.photo, model.point]), axis=1, return_counts=True)
    assert every.double.sum() == len(np.unique(pairs[0][1][pairs[1] > 1]))


def test_photos_cells_and_pairs_have_their_numbers() -> None:
    model = block()
    result = thinned(model, dry(model))
    require_pairs_and_cells(model, result, 120)
    images = np.bincount(model.photo[result.kept[model.point]], minlength=len(model.photos))
    assert images.mean() < 200 and len(model.photo) / len(model.photos) > 400
    few = thinned(model, dry(model), per_photo=48)
    require_pairs_and_cells(model, few, 48)
    assert few.kept.sum() < result.kept.sum()
    every = thinned(model, dry(model), per_photo=0)
    assert (every.kept == (model.counts > 1)).all()


@pytest.mark.parametrize("seed", range(3))
def test_no_order_of_photos_points_and_images_matters(seed: int) -> None:
    rng, model = np.random.default_rng(seed), block(strips=3, each=4, noise=0.0)  # with ties, which ids decide
    wet = (model.position[:, 0] > 30.0).astype(np.int64)
    result = thinned(model, wet)
    n, p, m = (rng.permutation(len(of)) for of in (model.photos, model.points, model.photo))
    place_n, place_p = np.argsort(n), np.argsort(p)
    other = replace(
        model,
        photos=model.photos[n],
        camera=model.camera[n],
        rotation=model.rotation[n],
        centre=model.centre[n],
        points=model.points[p],
        position=model.position[p],
        photo=place_n[model.photo[m]],
        point=place_p[model.point[m]],
        pixel=model.pixel[m],
    )
    shuffled = thinned(other, wet[p])
    assert (shuffled.kept == result.kept[p]).all() and (shuffled.double == result.double[p]).all()


def test_a_third_is_wet_and_a_third_dry_where_there_are() -> None:
    model = block(density=24.0)
    wet = np.full(len(model.points), Wet.WET, dtype=np.int64)
    wet[::20] = Wet.DRY
    undecided = np.arange(len(wet)) % 20 == 7
    wet[undecided] = Wet.UNDECIDED
    wet[np.arange(len(wet)) % 20 == 9] = Wet.SURFACE
    result = thinned(model, wet)
    assert not result.kept[wet > Wet.WET].any()
    for code in (Wet.WET, Wet.DRY):
        usable = (model.counts > 1) & (wet == code)
        of = [np.bincount(model.photo[rows[model.point]], minlength=24) for rows in (usable, usable & result.kept)]
        assert (of[1] >= np.minimum(of[0], 40)).all()
    assert (wet[result.kept] == Wet.DRY).mean() > 0.25


def test_tracks_with_two_images_in_a_photo_or_one_in_all_are_left_out() -> None:
    model = block(strips=2, each=3)
    double, single = np.split(np.flatnonzero(model.counts > 2)[:3], [2])
    twice = np.flatnonzero(np.isin(model.point, double))
    _, first = np.unique(model.point[twice], return_index=True)
    rows = np.concatenate([np.arange(len(model.photo)), twice[first]])
    rows = rows[(model.point[rows] != single) | (np.cumsum(model.point[rows] == single) < 2)]
    model = replace(model, photo=model.photo[rows], point=model.point[rows], pixel=model.pixel[rows])
    for per_photo in (0, 10, 120):
        result = thinned(model, dry(model), per_photo)
        assert np.flatnonzero(result.double).tolist() == double.tolist()
        assert not result.kept[[*double, *single]].any()


def test_the_best_have_most_rays_then_the_widest_angle_then_the_least_residual() -> None:
    centre = np.array([[0.0, 0.0, 10.0], [4.0, 0.0, 10.0], [8.0, 0.0, 10.0]])
    position = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 1.0, 0.0], [4.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    photo, point = np.array([0, 1, 2, 0, 1, 0, 2, 0, 2, 1]), np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4])
    R = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (3, 3, 3))
    rays = np.einsum("rij,rj->ri", R[photo], position[point] - centre[photo])
    pixel = LENS.pixels(rays[:, :2] / rays[:, 2:])
    pixel[5, 0] += 3.0
    model = replace(block(1, 3), centre=centre, position=position, photo=photo, point=point, pixel=pixel)
    model = replace(model, points=np.array(list("abcde")))
    angles = np.degrees(widest_angles(model))
    half = np.degrees(np.arctan2(4.0, np.hypot(10.0, 1.0)))
    expected = [np.degrees(np.arctan2(8.0, 10.0)), np.degrees(np.arctan2(4.0, 10.0)), 2 * half, 2 * half, 0.0]
    np.testing.assert_allclose(angles, expected, atol=1e-9)
    assert [model.points[row] for row in ranked(model)] == ["a", "d", "c", "b", "e"]


def test_nothing_gives_nothing() -> None:
    model = block(1, 2)
    empty = np.zeros(0, dtype=np.int64)
    model = replace(model, photo=empty, point=empty, pixel=np.zeros((0, 2)))
    assert not thinned(model, dry(model)).kept.any()
    model = replace(model, points=model.points[:0], position=model.position[:0])
    assert len(thinned(model, dry(model)).kept) == 0
