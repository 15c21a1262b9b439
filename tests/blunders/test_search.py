"""The search for blunders on simulated blocks whose errors are known."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from altered import added, altered, put
from benchmarks.large_blocks import FOCAL_LENGTH, INDEX, Truth, simulated
from blocks import with_plate_blunders
from musatpy.geometry.collinearity import attitude_matrix, image
from musatpy.model import (
    Action,
    Block,
    CauseKind,
    Editing,
    Finding,
    ObservationKind,
    Program,
    Refraction,
    Solution,
    Treatment,
)
from musatpy.pipeline import adjust
from musatpy.refraction import flat

PHOTOS = 18
NOISE = 0.010  # mm


@lru_cache
def clean() -> tuple[Block, Truth]:
    return simulated(PHOTOS, submerged=0.3, seed=4)


@lru_cache
def clean_solution() -> Solution:
    return adjust(clean()[0])


def edited(block: Block) -> Solution:
    return adjust(altered(block, options={"editing": Editing.EDIT}))


def rays(block: Block) -> np.ndarray:
    """Return (p,) the number of images of every point."""
    return np.bincount(block.plates.point, minlength=len(block.points.ids))


def image_of(block: Block, row: int) -> tuple[str, str]:
    """Return photo and point of an image."""
    return str(block.photos.ids[block.plates.photo[row]]), str(block.points.ids[block.plates.point[row]])


def of(solution: Solution, *blunders: CauseKind) -> list[Finding]:
    return [one for one in solution.findings if one.kind in blunders]


def flagged(block: Block, points: np.ndarray, submerged: bool) -> Block:
    """Return the block with some points flagged as submerged, or as dry."""
    return altered(block, points={"bathymetric": put(points, submerged)})


def well_seen(block: Block, images: int = 5) -> np.ndarray:
    """Return the images of points with so many of them and without control."""
    seen = rays(block) >= images
    seen[block.control.point] = False
    return np.flatnonzero(seen[block.plates.point])


def agrees_with_clean(solution: Solution) -> None:
    """The stations are those of the block without blunders, but for what the lost observations cost.

    Four sigmas: the few observations that went out move no station by more than a part of its sigma.
    """
    sigma = np.sqrt(np.einsum("nii->ni", clean_solution().stations.covariance))
    difference = solution.stations.position - clean_solution().stations.position
    assert np.abs(difference / sigma[:, :3]).max() < 4.0
    assert solution.converged
    assert solution.sigma0 == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_wrong() -> None:
    solution = edited(clean()[0])
    assert solution.findings == ()
    assert solution.edited is not None
    # the same equations, their points in another order
    np.testing.assert_allclose(solution.stations.position, clean_solution().stations.position, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "axis"), [(0.15, 0), (10.0, 1), (0.15, 1), (1.0, 0), (10.0, 0)])
def test_gross_errors_of_images_are_found_with_their_sizes(size: float, axis: int) -> None:
    """A fifth of a percent of the images, one in each of three points that are well seen."""
    block, _ = clean()
    hit = well_seen(block)[[0, 8, 24]]
    assert len(set(block.plates.point[hit])) == 3
    solution = edited(altered(block, plates={"xy": added((hit, axis), size)}))
    found = of(solution, CauseKind.IMAGE)
    assert {(one.photo, one.point) for one in found} == {image_of(block, row) for row in hit}
    assert len(solution.findings) == len(hit)
    for one in found:
        # the estimate has the noise of the image and of its prediction
        assert one.size[axis] == pytest.approx(1000.0 * size, abs=5e3 * NOISE)
        assert one.test > 4.0
        assert one.action is Action.KEPT_OUT
    agrees_with_clean(solution)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_many_blunders_do_not_hide_each_other(seed: int) -> None:
    """One image in twenty is wrong by 50 um to 10 mm; what is beyond ten sigmas and checked goes out."""
    block, truth = clean()
    spoilt, error = with_plate_blunders(block, 0.05, np.random.default_rng(seed))
    solution = edited(spoilt)
    out = ~solution.edited.plates.triangulated
    wrong = error.any(axis=1)
    observed = clean_solution().observed
    redundancy, plate = np.zeros(error.shape), observed.kind == ObservationKind.PLATE
    redundancy[observed.row[plate], observed.component[plate]] = observed.redundancy[plate]
    with np.errstate(divide="ignore"):
        detectable = (np.abs(error) > 6.0 * NOISE / np.sqrt(redundancy)).any(axis=1)
    number = np.bincount(block.plates.point, weights=wrong)
    detectable &= (number == 1)[block.plates.point]  # a second one in a point may hide behind the first
    assert not (detectable & ~out).any()  # two sigmas beyond the limit of the test
    assert detectable.sum() > 20
    sound = ~np.isin(block.plates.point, block.plates.point[wrong])
    assert not (out & sound).any()
    sigma = np.sqrt(np.einsum("nii->ni", solution.stations.covariance))
    errors = np.concatenate(
        [solution.stations.position - truth.station, solution.stations.attitude - truth.attitude], axis=1
    )
    # 108 parameters: one of normal deviates lies beyond 3.5 in one block of 20; the seeds are fixed
    assert np.abs(errors / sigma).max() < 3.5


@pytest.mark.slow
def test_the_images_of_a_strip_that_cannot_be_told_apart_go_out_together() -> None:
    block, _ = clean()
    three = rays(block) == 3
    three[block.control.point] = False
    for point in np.flatnonzero(three):
        rows = np.flatnonzero(block.plates.point == point)
        if np.ptp(block.plates.photo[rows]) == 2:  # of one strip
            break
    solution = edited(altered(block, plates={"xy": added((rows[0], 0), 2.0)}))
    found = of(solution, CauseKind.IMAGE)
    assert {one.photo for one in found} == set(block.photos.ids[block.plates.photo[rows]])
    assert all("nor from photos" in one.note for one in found)
    assert all(np.isnan(one.size).all() for one in found)
    agrees_with_clean(solution)


@pytest.mark.slow
def test_exchanged_names_are_put_right() -> None:
    block, _ = clean()
    rows = well_seen(block)
    first = int(rows[0])
    second = int(next(r for r in rows[1:] if block.plates.photo[r] == block.plates.photo[first]))
    solution = edited(altered(block, plates={"point": put([first, second], block.plates.point[[second, first]])}))
    found = of(solution, CauseKind.NAME)
    assert len(found) == len(solution.findings) == 2
    ids = block.points.ids[block.plates.point[[first, second]]].tolist()
    assert {one.point for one in found} == set(ids)
    assert all(one.action is Action.RENAMED for one in found)
    edited_points, points = solution.edited.points.ids, block.points.ids
    np.testing.assert_array_equal(edited_points[solution.edited.plates.point], points[block.plates.point])
    np.testing.assert_allclose(solution.stations.position, clean_solution().stations.position, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_a_mistaken_name_is_put_right(known: bool) -> None:
    """The image bears the name of a point elsewhere, or one that no other image has."""
    block, _ = clean()
    row = int(well_seen(block)[40])
    photo = block.plates.photo[row]
    if known:
        there = np.isin(np.arange(len(block.points.ids)), block.plates.point[block.plates.photo == photo])
        name = int(np.flatnonzero(~there & (rays(block) >= 4))[0])
    else:
        name = len(block.points.ids)
        flags = {flag: np.append(getattr(block.points, flag), False) for flag in ("bathymetric", "dry")}
        block = altered(block, points={"ids": np.append(block.points.ids, "TYPO"), **flags})
    solution = edited(altered(block, plates={"point": put(row, name)}))
    (found,) = solution.findings
    assert found.kind is CauseKind.NAME
    assert found.point == block.points.ids[name]
    assert found.note.startswith(f"it is point {block.points.ids[block.plates.point[row]]},")
    np.testing.assert_allclose(solution.stations.position, clean_solution().stations.position, atol=1e-6)


@pytest.mark.parametrize(
    ("error", "blunder", "known"),
    [
        ((1000.0, -300.0, 0.0), CauseKind.HORIZONTAL, [False, False, True]),
        ((2.5, 0.0, 0.0), CauseKind.HORIZONTAL, [False, False, True]),
        ((0.0, 0.0, 300.0), CauseKind.VERTICAL, [True, True, False]),
        ((0.0, 0.0, 5.0), CauseKind.VERTICAL, [True, True, False]),
    ],
)
@pytest.mark.slow
def test_wrong_control_is_found_by_component(
    error: tuple[float, float, float], blunder: CauseKind, known: list[bool]
) -> None:
    """From a few metres to a kilometre: ten times the ground sigma of an image, and more than the block is wide."""
    block, _ = clean()
    row = int(np.argmax(rays(block)[block.control.point]))
    solution = edited(altered(block, control={"position": added(row, error)}))
    (found,) = solution.findings
    assert found.kind is blunder
    assert found.point == block.points.ids[block.control.point[row]]
    components = list(error[:2]) if blunder is CauseKind.HORIZONTAL else [error[2]]
    np.testing.assert_allclose(found.size, components, atol=2.0)  # the prediction has some decimetres
    assert solution.edited.control.known[row].tolist() == known
    agrees_with_clean(solution)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("photos", "size", "named", "within"),
    [
        (np.array([5]), 6.0, "5", 2.0),  # the images give it to half a metre or so
        (slice(None), 6.0, "all", 2.0),
        (slice(0, None, 2), 4.0, "group EVEN", 1.5),
    ],
    ids=["of one photo", "of all", "of a group"],
)
def test_wrong_tides_are_found(photos: slice | np.ndarray, size: float, named: str, within: float) -> None:
    """That of a photo goes out with its submerged images; what many have in common is named, and left."""
    block, _ = clean()
    if named.startswith("group"):
        block = altered(block, photos={"tide_group": np.resize(["EVEN", "ODD"], PHOTOS)})
    solution = edited(altered(block, photos={"tide": added(photos, size)}))
    (found,) = of(solution, CauseKind.TIDE)
    alone = named == block.photos.ids[5]
    assert found.photo == named
    assert found.size[0] == pytest.approx(size, abs=within)
    assert found.action is (Action.KEPT_OUT if alone else Action.NONE)
    submerged = block.points.bathymetric[block.plates.point] & (block.plates.photo == 5) & alone
    np.testing.assert_array_equal(~solution.edited.plates.triangulated, submerged)
    if alone:
        agrees_with_clean(solution)


@pytest.mark.slow
def test_blunders_are_found_where_tilt_and_index_are_unknown() -> None:
    """Both with priors, which are observations of no photo and no point."""
    block, _ = clean()
    (row,) = well_seen(block)[:1]
    block = altered(
        block,
        plates={"xy": added((row, 1), 0.5)},
        water={"sigma": 0.005, "tilt_sigma": 1e-4},
        options={"water_tilt": Treatment.ADJUST, "water_index": Treatment.ADJUST},
    )
    (found,) = edited(block).findings
    assert (found.photo, found.point) == image_of(block, row)
    # the noise of the image and of its prediction
    assert found.size[1] == pytest.approx(500.0, abs=5e3 * NOISE)


def deep(points: int = 4) -> tuple[Block, np.ndarray]:
    """A block with some points at the bottom of a 150 m sea, where refraction shows in the images themselves."""
    block, truth = simulated(PHOTOS, submerged=0.3, seed=4, depth=150.0)
    wet = block.points.bathymetric & (rays(block) >= 5) & (truth.ground[:, 2] < -100.0)
    return block, np.flatnonzero(wet)[:points]


@pytest.mark.slow
def test_points_that_should_be_flagged_are_found_by_their_images() -> None:
    block, wet = deep()
    solution = edited(flagged(block, wet, False))
    found = of(solution, CauseKind.DRY_FLAG)
    assert {one.point for one in found} == set(block.points.ids[wet])
    assert all(one.action is Action.FLAGGED for one in found)
    assert not of(solution, CauseKind.IMAGE)
    flags = dict(zip(solution.edited.points.ids, solution.edited.points.bathymetric, strict=True))
    assert [flags[name] for name in block.points.ids] == block.points.bathymetric.tolist()


@pytest.mark.slow
def test_dry_points_below_the_water_that_are_flagged_are_found_by_their_images() -> None:
    """Land that lies lower than the water: behind a dike, say."""
    block, wet = deep()
    truth = simulated(PHOTOS, submerged=0.3, seed=4, depth=150.0)[1]
    rows = np.flatnonzero(np.isin(block.plates.point, wet))
    camera, ground = truth.station[block.plates.photo[rows]], truth.ground[block.plates.point[rows]]
    up = np.broadcast_to([0.0, 0.0, 1.0], ground.shape)
    M, f = attitude_matrix(truth.attitude)[block.plates.photo[rows]], np.full(len(rows), FOCAL_LENGTH)
    bent = flat.incidence(camera, ground, up, -ground[:, 2], INDEX).v
    off = image(ground - camera, M, f, np.zeros(2)) - image(bent, M, f, np.zeros(2))
    solution = edited(altered(block, plates={"xy": added(rows, off)}))
    found = of(solution, CauseKind.WET_FLAG)
    assert {one.point for one in found} == set(block.points.ids[wet])
    assert all(one.action is Action.UNFLAGGED for one in found)


def test_shallow_points_below_the_water_without_flag_are_listed() -> None:
    block, truth = clean()
    wet = block.points.bathymetric & (rays(block) >= 4) & (truth.ground[:, 2] < -8.0)
    points = np.flatnonzero(wet)[:3]
    solution = edited(flagged(block, points, False))
    found = {one.point: one for one in of(solution, CauseKind.DRY_FLAG)}
    assert set(found) == set(block.points.ids[points])
    for point in points:
        one = found[block.points.ids[point]]
        assert one.action is Action.NONE
        # taken as dry it seems to be at three quarters of its depth
        assert one.size[0] == pytest.approx(-truth.ground[point, 2] / 1.36, abs=2.0)


@pytest.mark.slow
def test_points_above_the_water_with_a_flag_are_listed() -> None:
    block, truth = clean()
    high = ~block.points.bathymetric & (rays(block) >= 4) & (truth.ground[:, 2] > 20.0)
    points = np.flatnonzero(high)[:3]
    solution = edited(flagged(block, points, True))
    found = of(solution, CauseKind.WET_FLAG)
    assert {one.point for one in found} == set(block.points.ids[points])
    np.testing.assert_allclose(solution.stations.position, clean_solution().stations.position, atol=1e-6)


@pytest.mark.parametrize(
    ("program", "refraction"),
    [(Program.IIA, Refraction.WATPT), (Program.IIA, Refraction.RIGOROUS), (Program.IIA, Refraction.NONE)],
)
@pytest.mark.slow
def test_jobs_of_program_iia_are_searched_too(program: Program, refraction: Refraction) -> None:
    block, _ = clean()
    block = altered(block, options={"program": program, "refraction": refraction})
    row = int(well_seen(block)[10])
    solution = edited(altered(block, plates={"xy": added(row, 0.5)}))
    found = of(solution, CauseKind.IMAGE)
    assert image_of(block, row) in {(one.photo, one.point) for one in found}
    assert solution.block.options.program is program
    assert not of(solution, CauseKind.TIDE) or refraction is not Refraction.NONE


@pytest.mark.slow
def test_a_search_that_has_spent_its_effort_is_given_up_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("musatpy.blunders.search.LEAST", 0.0)
    monkeypatch.setattr("musatpy.blunders.search._EFFORT", 3)
    monkeypatch.setattr("musatpy.blunders.search._FOR_PHOTO", 0)
    block, _ = with_plate_blunders(clean()[0], 0.02, np.random.default_rng(5))
    solution = edited(block)
    assert not solution.findings
    assert any("given up: it did not end" in warning for warning in solution.warnings)
