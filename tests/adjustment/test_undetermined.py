"""What nothing determines, what is lost, and which control makes a datum."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import musatpy
from altered import added, altered, put, with_options
from blocks import FIXTURES, simulation
from musatpy import listing, model, read_deck, verdict
from musatpy.adjustment import adjust
from musatpy.adjustment.iteration import Linearisation, iterate
from musatpy.formats import musat
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.pipeline import doubtful
from musatpy.runs import run_deck
from musatpy.statistics import Statistics, metric_differences
from musatpy.units import ARC_SECOND
from reference import compare, dense_bundle, networks
from reference.networks import Plan

UNKNOWN = {
    "water_level": model.WaterLevel.PHOTO,
    "water_index": model.Treatment.ADJUST,
    "water_tilt": model.Treatment.ADJUST,
}


def st_thomas(flagged: tuple[str, ...] | None = None, **options: object) -> model.Block:
    """Return St. Thomas as a job of IIIA, some of its points flagged as submerged: as on its cards, or these."""
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    if flagged is not None:
        block = altered(block, points={"bathymetric": np.isin(block.points.ids, flagged)})
    return with_options(block, program=model.Program.IIIA, refraction=model.Refraction.RIGOROUS, **options)


def listing_and_record(block: model.Block, folder: Path) -> tuple[str, dict[str, Any]]:
    """Return what a run of the block leaves."""
    musatpy.write_deck(block, folder / "job.crd")
    run_deck(folder / "job.crd", folder)
    return (folder / "job.lst").read_text(), json.loads((folder / "job.json").read_text())


def undetermined(solution: model.Solution) -> list[str]:
    return [reason.text for reason in verdict(solution).reasons if reason.concern is model.Concern.UNDETERMINED]


def test_water_without_an_image_has_no_number_and_is_a_note(tmp_path: Path) -> None:
    solution = musatpy.adjust(st_thomas((), **UNKNOWN))
    water = solution.water
    for values in (water.correction, water.correction_sigma, water.tilt_sigma, water.index_sigma):
        assert np.isnan(values).all()
    assert not undetermined(solution)
    assert any("not determined, but no image depends on it" in note for note in verdict(solution).notes)
    # it is neither observed nor estimated: sigma0 is that of the job without water
    dry = musatpy.adjust(altered(st_thomas(()), water=None))
    assert solution.degrees_of_freedom == dry.degrees_of_freedom
    assert solution.sigma0 == pytest.approx(dry.sigma0, rel=1e-9)


def test_the_listing_and_the_record_say_so(tmp_path: Path) -> None:
    listing, record = listing_and_record(st_thomas((), **UNKNOWN), tmp_path)
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
    water = musatpy.adjust(block).water
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
    solution = musatpy.adjust(st_thomas(flagged, water_tilt=model.Treatment.ADJUST))
    assert solution.converged
    assert np.isfinite(solution.water.tilt_sigma).tolist() == sigmas
    assert bool(undetermined(solution)) is not all(sigmas)
    for text in undetermined(solution):
        assert text.startswith("the tilt of the water: the images that depend on it do not determine it")
        assert not doubtful(Statistics(solution))  # no cause is looked for


def with_rays_apart(
    seed: int, heights: float, *, kept_out: bool = False, noise: float = 1.0
) -> tuple[model.Block, int]:
    """Return a strip, and a pass point of two photos of it whose images are those of a place so far off.

    A base b and a distance d determine it to d^2/b of the angle of an image: a sixth of a height at 40.
    """
    block = networks.simulate(networks.Plan(seed=seed, noise=noise)).block
    solution, plates = musatpy.adjust(block), block.plates
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


@pytest.mark.parametrize(("kept_out", "noise"), [(False, 0.0), (True, 1.0)])  # residuals have no part in it
def test_a_point_that_its_rays_do_not_determine_is_named_and_not_stated(
    kept_out: bool, noise: float, tmp_path: Path
) -> None:
    block, point = with_rays_apart(3, 60.0, kept_out=kept_out, noise=noise)
    solution = musatpy.adjust(block)
    points, name = solution.points, str(block.points.ids[point])
    assert points.status[point] == model.PointStatus.NOT_DETERMINED
    assert np.isnan(points.position[point]).all() and np.isnan(points.covariance[point]).all()
    assert points.reasons[point].startswith("its rays do not determine it: its ellipsoid is ")
    assert (points.status == model.PointStatus.NOT_DETERMINED).sum() == 1
    assert bool(undetermined(solution)) is not kept_out
    listing, record = listing_and_record(block, tmp_path)
    row = record["points"]["point"].index(name)
    assert record["points"]["position"][row] == [None] * 3
    assert record["points"]["status"][row] == "not_determined"
    assert "its rays do not determine it" in listing


@pytest.mark.parametrize("heights", [1.0, 5.0, 15.0])
def test_weak_points_are_stated_with_their_sigmas(heights: float) -> None:
    solution = musatpy.adjust(with_rays_apart(3, heights)[0])
    assert not undetermined(solution)
    assert (solution.points.status != model.PointStatus.NOT_DETERMINED).all()


def test_a_weak_datum_is_no_matter_of_rays() -> None:
    """Stations and control known to a kilometre: all points are, and their rays meet as well as before."""
    block = networks.simulate(networks.Plan(seed=3, station_sigma=2.0)).block
    weak = altered(
        block, control={"sigma": block.control.sigma * 1e4}, photos={"position_sigma": lambda s: s * 1e3}
    )
    solution = musatpy.adjust(weak)
    size = np.sqrt(np.einsum("kii->k", solution.points.covariance))
    assert np.nanmedian(size) > 0.1 * networks.Plan().height
    assert all(
        np.sum(block.plates.point == point) == 1 for point in solution.points.lost
    )  # held by that control alone
    assert (solution.points.status == model.PointStatus.TRIANGULATED).sum() > 10


E, N, U, X_TILT, Y_TILT, HEADING = range(6)
WHOLE = tuple((0, component) for component in range(6))
LOCAL, GEOGRAPHIC = model.CoordinateSystem.LOCAL, model.CoordinateSystem.GEOGRAPHIC
# The strip flies at a heading of 0.4 rad: a base is long to the east and to the north, and level.
FIXED = {
    "one station, and east of the next": (*WHOLE, (1, E)),
    "one station, and north of the last": (*WHOLE, (2, N)),
    "components of three stations": ((0, E), (0, N), (0, U), (1, U), (2, E), (2, N), (0, X_TILT), (1, Y_TILT)),
    "seven components": ((0, E), (1, N), (2, U), (1, X_TILT), (2, Y_TILT), (0, HEADING), (2, N)),
}
FREE = {
    "scale": (*WHOLE, (1, X_TILT), (1, Y_TILT), (2, HEADING)),
    "scale, for the base is level": (*WHOLE, (0, U)),
    "heading": ((0, E), (0, N), (0, U), (0, X_TILT), (0, Y_TILT), (1, U)),
    "shift north": ((0, E), (1, E), (2, E), (0, U), *((photo, angle) for photo in range(3) for angle in (3, 4, 5))),
    "shift up": ((0, E), (0, N), (1, E), (2, N), (0, X_TILT), (1, Y_TILT), (2, HEADING)),
}


@cache
def strip(
    system: model.CoordinateSystem, observed: tuple[tuple[int, int], ...], program: model.Program
) -> model.Block:
    """Return a strip of three photos without control, of whose stations some components are observed."""
    refraction = model.Refraction.NONE if program is model.Program.IIA else model.Refraction.RIGOROUS
    plan = Plan(system=system, station_sigma=0.05, attitude_sigma=20 * ARC_SECOND, plate_sigma=0.004)
    block = networks.simulate(plan).block
    known = np.zeros((3, 6), dtype=bool)
    known[tuple(np.array(observed).T)] = True
    return altered(
        block,
        options={"program": program, "refraction": refraction},
        photos={
            "position_sigma": lambda sigma: np.where(known[:, :3], sigma, np.nan),
            "attitude_sigma": lambda sigma: np.where(known[:, 3:], sigma, np.nan),
        },
        control={"kind": put(slice(None), model.ControlKind.CHECK), "sigma": put(slice(None), np.nan)},
    )


def errors(block: model.Block) -> list[str]:
    return [one.message for one in musat.check_deck(musat.deck_bytes(block))[1] if one.severity == "error"]


@pytest.mark.slow
@pytest.mark.parametrize("program", list(model.Program))
@pytest.mark.parametrize("system", [LOCAL, GEOGRAPHIC])
@pytest.mark.parametrize("name", list(FIXED))
def test_what_holds_all_seven_motions_is_a_datum(
    name: str, system: model.CoordinateSystem, program: model.Program
) -> None:
    block = strip(system, FIXED[name], program)
    assert errors(block) == []
    solution = adjust(block)
    result = dense_bundle.solve(block, compare.beside(solution), refraction=False)
    assert solution.converged
    assert solution.sigma0 == pytest.approx(result.sigma0, rel=1e-6)
    assert np.abs(compare.station_difference(solution, result)).max() < 1e-3
    assert np.nanmax(np.abs(compare.covariance_difference(solution.stations.covariance, result.covariance))) < 1e-4


@pytest.mark.parametrize("system", [LOCAL, GEOGRAPHIC])
@pytest.mark.parametrize("name", list(FREE))
def test_what_leaves_a_motion_free_is_none(name: str, system: model.CoordinateSystem) -> None:
    (message,) = errors(strip(system, FREE[name], model.Program.IIA))
    assert "its datum needs" in message


DEGREE = np.radians(1.0)
BLOCK = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
# 104 a degree north of its place, 101 one west; photo 23 north, and called known to a metre
NORTH, WEST = ({"control": {"position": added(at, sign * DEGREE)}} for at, sign in (((3, 0), 1.0), ((0, 1), -1.0)))
STATION = {"photos": {"position": added((2, 0), DEGREE)}}
KNOWN = {"photos": STATION["photos"] | {"position_sigma": lambda sigma: np.full_like(sigma, 1.0)}}


def long_distance() -> dict[str, model.Distances]:
    """A distance between the points 204 and 219, ten times too long."""
    ends = np.flatnonzero(np.isin(BLOCK.points.ids, ["204", "219"]))
    places = Ellipsoid(BLOCK.ellipsoid.name).geocentric(musatpy.adjust(BLOCK).points.position[ends])
    length = 10.0 * float(np.linalg.norm(places[1] - places[0]))
    return {"distances": model.Distances(point=[ends], length=[length], sigma=[0.05])}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoilt", "options", "named"),
    [
        (lambda: NORTH, {}, "point 104 on photo"),
        (lambda: WEST, {"refraction": "RIGOROUS", "max_iterations": 10}, "point 101 on photo"),
        (lambda: NORTH, {"program": "IIIA", "max_iterations": 10}, "point 104 on photo"),
        (long_distance, {"program": "IIIA", "max_iterations": 5}, "the distance of points 204 and 219 is off by"),
        (lambda: KNOWN, {"program": "IIIA", "max_iterations": 6}, "on photo 23 is"),
    ],
    ids=["control north", "control west", "control north, IIIA", "distance, IIIA", "station, IIIA"],
)
def test_a_hopeless_job_ends_as_not_converged_and_names_the_culprit(spoilt, options, named):
    enums = {"refraction": model.Refraction, "program": model.Program}
    options = {name: enums[name](value) if name in enums else value for name, value in options.items()}
    solution = adjust(with_options(altered(BLOCK, **spoilt()), **options))
    assert not solution.converged
    # whichever is above its limit; a step that is damped heavily can be below both
    assert re.search("still (moves|turns|damped)|no step lowers the sum of squares", solution.reason)
    assert "; what fits worst: " in solution.reason
    assert "NOT CONVERGED" in listing(solution)
    at_start = [
        text for text in solution.warnings if text.startswith("what fitted worst at the start of the run: ")
    ]
    assert named in at_start[0].split(", ")[0]  # the worst comes first


@pytest.mark.slow
def test_points_behind_cameras_end_the_run():
    solution = adjust(altered(BLOCK, **KNOWN))
    assert solution.reason.startswith("points stay behind their cameras")
    assert solution.passes == ()  # nothing is built on a lost triangulation


@pytest.mark.slow
@pytest.mark.parametrize("program", list(model.Program))
def test_a_start_a_degree_off_is_found_back(program):
    """A given station without sigma is a start only: the images and the control know better."""
    rigorous = with_options(BLOCK, program=program, refraction=model.Refraction.RIGOROUS)
    found, usual = adjust(altered(rigorous, **STATION)), adjust(rigorous)
    assert found.converged
    off = metric_differences(BLOCK, found.points.position, usual.points.position)
    assert np.nanmax(np.abs(off)) < 0.02  # m: the limits of the steps leave millimetres


def test_normal_equations_without_sense_end_the_run():
    """Where linearising gives what is no number, the run ends like any other that has lost its points."""

    class Senseless:
        def linearise(self, state):
            matrix = SimpleNamespace(sensible=lambda: False)
            return Linearisation(matrix=matrix, rhs=np.zeros(1), objective=1.0, context=None, redundancy=1)

    outcome = iterate(Senseless(), "first", 5, lambda step: None)
    assert outcome.lost
    assert outcome.state == "first"


@pytest.mark.slow
def test_a_run_that_falls_short_does_not_follow_the_water_line_for_long():
    """One iteration is not enough for any triangulation, and points change their sides of the water after each."""
    made = simulation(
        1,
        flight={"photos": 6, "height": 1500.0},
        water={"tide_scatter": 0.3},
        shoal=[{"share": 0.6, "depth": [0.1, 1.0]}],
        points={"extra": [{"number": 40}]},
        control=[{"kind": "full", "number": 6, "sigma": 0.1}],
        stations={"position_error": 300.0, "attitude_error": 3.0},
        options={"program": "IIIA", "max_iterations": 1},
    )
    solution = musatpy.adjust(made.block)
    assert not solution.converged
    assert solution.reason.startswith("limits not reached in 1 iteration")
    assert [one.outer_pass for one in solution.iterations] == [1, 2]
