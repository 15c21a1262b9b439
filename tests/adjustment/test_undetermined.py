"""What no observation determines has no number: water without a wet image, points whose rays do not meet well."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import musatpy
from altered import altered, with_options
from musatpy import adjust, read_deck, verdict
from musatpy.geometry.rotations import attitude_matrix
from musatpy.model import Block, Concern, PointStatus, Program, Refraction, Solution, Treatment, WaterLevel
from musatpy.pipeline import doubtful
from musatpy.runs import run_deck
from reference import networks

FIXTURES = Path(__file__).parents[2] / "fixtures"
UNKNOWN = {"water_level": WaterLevel.PHOTO, "water_index": Treatment.ADJUST, "water_tilt": Treatment.ADJUST}


def st_thomas(flagged: tuple[str, ...] | None = None, **options: object) -> Block:
    """Return St. Thomas as a job of IIIA, some of its points flagged as submerged: as on its cards, or these."""
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    if flagged is not None:
        block = altered(block, points={"bathymetric": np.isin(block.points.ids, flagged)})
    return with_options(block, program=Program.IIIA, refraction=Refraction.RIGOROUS, **options)


def undetermined(solution: Solution) -> list[str]:
    return [reason.text for reason in verdict(solution).reasons if reason.concern is Concern.UNDETERMINED]


def test_water_without_an_image_has_no_number_and_is_a_note(tmp_path: Path) -> None:
    solution = adjust(st_thomas((), **UNKNOWN))
    water = solution.water
    for values in (water.correction, water.correction_sigma, water.tilt_sigma, water.index_sigma):
        assert np.isnan(values).all()
    assert not undetermined(solution)
    assert any("not determined, and no image depends on it" in note for note in verdict(solution).notes)
    # it is neither observed nor estimated: sigma0 is that of the job without water
    dry = adjust(altered(st_thomas(()), water=None))
    assert solution.degrees_of_freedom == dry.degrees_of_freedom
    assert solution.sigma0 == pytest.approx(dry.sigma0, rel=1e-9)


def test_the_listing_and_the_record_say_so(tmp_path: Path) -> None:
    deck = tmp_path / "job.crd"
    musatpy.write_deck(st_thomas((), **UNKNOWN), deck)
    run_deck(deck, tmp_path)
    listing, record = (tmp_path / "job.lst").read_text(), json.loads((tmp_path / "job.json").read_text())
    assert "Refractive index ................................. not determined\n" in listing
    assert "Tilt towards north ............................... not determined\n" in listing
    assert "\n21\n22\n23\n\nBlank: not determined" in listing
    water = record["adjusted_water"]
    assert water["corrections"]["correction"] == water["corrections"]["correction_sigma"] == [None] * 3
    assert water["index_sigma"] is None and water["tilt_sigma"] == [None, None]
    assert "the refractive index" in water["undetermined"]


def test_what_cards_give_a_sigma_is_known_by_it() -> None:
    block = altered(
        st_thomas((), **UNKNOWN), photos={"tide_sigma": np.full(3, 0.1)}, water={"sigma": 3e-3, "tilt_sigma": 1e-5}
    )
    water = adjust(block).water
    assert not water.undetermined
    assert np.isfinite(water.correction_sigma).all() and np.isfinite(water.index_sigma)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flagged", "sigmas"),
    [
        (("ROCK",), [False, False]),  # dry: no image is wet, and its images would be if the water were higher
        (("206",), [False, True]),  # one wet point: a slope of .3 east to west says nothing, north to south .03
        (("206", "218"), [True, True]),
    ],
)
def test_a_tilt_that_images_depend_on_is_doubtful(flagged: tuple[str, ...], sigmas: list[bool]) -> None:
    solution = adjust(st_thomas(flagged, water_tilt=Treatment.ADJUST))
    assert solution.converged
    assert np.isfinite(solution.water.tilt_sigma).tolist() == sigmas
    assert bool(undetermined(solution)) is not all(sigmas)
    for text in undetermined(solution):
        assert text.startswith("the tilt of the water: the images that depend on it do not determine it")
        assert not doubtful(solution)  # no cause is looked for


def test_determined_water_is_as_before() -> None:
    solution = adjust(st_thomas(water_level=WaterLevel.ONE))
    assert not solution.water.undetermined
    assert np.isfinite(solution.water.correction_sigma).all()


def with_rays_apart(seed: int, heights: float, *, kept_out: bool = False) -> tuple[Block, int]:
    """Return a strip, and a pass point of two photos of it whose images are those of a place so far off.

    A base b and a distance d determine it to d^2/b of the angle of an image: a sixth of a height at 40.
    """
    block = networks.simulate(networks.Plan(seed=seed)).block
    solution, plates = adjust(block), block.plates
    free = ~np.isin(np.arange(len(block.points.ids)), [*block.control.point, *block.equal_elevations.point])
    point = int(np.flatnonzero(free & (np.bincount(plates.point) == 2) & ~block.points.bathymetric)[0])
    rows = np.flatnonzero(plates.point == point)
    stations = solution.stations.position[plates.photo[rows]]
    ray = solution.points.position[point] - stations[0]
    place = stations[0] + ray * heights
    R = attitude_matrix(solution.stations.attitude[plates.photo[rows]])
    u = np.einsum("kij,kj->ki", R, place - stations)
    camera = block.photos.camera[plates.photo[rows]]
    f = block.cameras.focal_length[camera]
    xy = plates.xy.copy()
    xy[rows] = block.cameras.principal_point[camera] - f[:, None] * u[:, :2] / u[:, 2:]
    taken = plates.triangulated & ~((plates.point == point) & kept_out)
    return replace(block, plates=replace(plates, xy=xy, triangulated=taken)), point


@pytest.mark.parametrize("kept_out", [False, True])
def test_a_point_that_its_rays_do_not_determine_is_named_and_not_stated(kept_out: bool, tmp_path: Path) -> None:
    block, point = with_rays_apart(3, 60.0, kept_out=kept_out)
    solution = adjust(block)
    points, name = solution.points, str(block.points.ids[point])
    assert points.status[point] == PointStatus.NOT_DETERMINED
    assert np.isnan(points.position[point]).all() and np.isnan(points.covariance[point]).all()
    assert points.reasons[point].startswith("its rays do not determine it: its ellipsoid is ")
    assert (points.status == PointStatus.NOT_DETERMINED).sum() == 1
    assert bool(undetermined(solution)) is not kept_out
    deck = tmp_path / "job.crd"
    musatpy.write_deck(block, deck)
    run_deck(deck, tmp_path)
    listing, record = (tmp_path / "job.lst").read_text(), json.loads((tmp_path / "job.json").read_text())
    row = record["points"]["point"].index(name)
    assert record["points"]["position"][row] == [None] * 3
    assert record["points"]["status"][row] == "not_determined"
    assert "its rays do not determine it" in listing


@pytest.mark.parametrize("heights", [1.0, 5.0, 15.0])
def test_weak_points_are_stated_with_their_sigmas(heights: float) -> None:
    solution = adjust(with_rays_apart(3, heights)[0])
    assert not undetermined(solution)
    assert (solution.points.status != PointStatus.NOT_DETERMINED).all()


def test_a_weak_datum_is_no_matter_of_rays() -> None:
    """Stations and control known to a kilometre: all points are, and their rays meet as well as before."""
    block = networks.simulate(networks.Plan(seed=3, station_sigma=2.0)).block
    weak = altered(
        block, control={"sigma": block.control.sigma * 1e4}, photos={"position_sigma": lambda s: s * 1e3}
    )
    solution = adjust(weak)
    size = np.sqrt(np.einsum("kii->k", solution.points.covariance))
    assert np.nanmedian(size) > 0.1 * networks.Plan().height
    assert all(
        np.sum(block.plates.point == point) == 1 for point in solution.points.lost
    )  # held by that control alone
    assert (solution.points.status == PointStatus.TRIANGULATED).sum() > 10
