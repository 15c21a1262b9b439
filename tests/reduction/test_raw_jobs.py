"""Jobs from comparator readings: the deck, the reduction that its cards ask for, the adjustment after it."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from altered import added, altered, put
from formats.deck_edits import in_system
from musatpy import adjust, listing, model, read_deck
from musatpy.errors import DeckError, PlatesError
from musatpy.formats.musat import deck_bytes
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model.tables import empty
from musatpy.reduction import displacements
from musatpy.reduction.readings_job import quantities, reduce
from musatpy.reduction.refined_block import reduction_of
from musatpy.units import MICROMETRE
from raw_plates import (
    COMPARATOR,
    DECK,
    MARKS,
    crosses,
    distances,
    raw_block,
    reduction_matrix,
    refined_block,
    reseau,
)

ROOT = Path(__file__).parents[2]
LAST_DIGIT = 1e-7  # mm, of readings on cards; rounding is half of it, in both coordinates, of one reading or two
EARTH = 6.4e6  # m for each radian of latitude; more than that of longitude


def again(block):
    """Return a block as its deck has it: readings rounded."""
    return read_deck(deck_bytes(block))


# --- the fixture ---


def test_the_fixture_is_what_its_generator_makes():
    assert deck_bytes(raw_block()) == DECK.read_bytes()


def test_a_run_from_readings_is_the_run_from_refined_coordinates():
    raw, plain = adjust(read_deck(DECK)), adjust(refined_block())
    np.testing.assert_array_equal(raw.block.plates.point, plain.block.plates.point)
    np.testing.assert_array_equal(raw.block.plates.photo, plain.block.plates.photo)
    np.testing.assert_array_equal(raw.block.plates.triangulated, plain.block.plates.triangulated)
    np.testing.assert_allclose(raw.block.plates.xy, plain.block.plates.xy, rtol=0.0, atol=LAST_DIGIT)
    # 1e-7 mm at a scale of 1 : 16 000 are 1.6e-6 m on the ground, three times as much in height and at a station
    metres = np.array([EARTH, EARTH, 1.0])
    assert np.abs((raw.points.position - plain.points.position) * metres).max() < 5e-6
    assert np.abs((raw.stations.position - plain.stations.position) * metres).max() < 5e-6
    assert raw.sigma0 == pytest.approx(plain.sigma0, abs=1e-6)  # 1e-7 mm of plate sigmas of 5e-3 mm
    assert raw.reduced is not None and plain.reduced is None
    assert not raw.block.raw and raw.reduced.given.raw


def test_refined_coordinates_written_to_a_deck_give_the_same_answer():
    """What a later job starts from: the deck of the adjusted block, with nothing of readings."""
    first = adjust(read_deck(DECK))
    written = again(first.block)
    assert not written.raw and written.comparator is None and not len(written.fiducial_measurements.photo)
    second = adjust(written)
    assert second.reduced is None
    np.testing.assert_allclose(second.block.plates.xy, first.block.plates.xy, rtol=0.0, atol=0.6 * LAST_DIGIT)
    assert np.abs(second.points.position - first.points.position)[:, 2].max() < 5e-6  # as above


def by_hand(block, photo):
    """Return the refined coordinates (m, 2) of a photo of the fixture, each step written out from the manual."""
    cards = block.fiducial_measurements
    own = cards.photo == photo
    matrix = reduction_matrix(COMPARATOR)
    marks, names = cards.xy[own] @ matrix.T, cards.ids[own]
    # All marks have the same sigmas and are read twice: all weigh alike in the least squares.
    target = np.array([MARKS[name] for name in names])
    design = np.column_stack([marks, np.ones(len(marks))])
    affine = np.linalg.lstsq(design, target, rcond=None)[0]
    points = block.plates.photo == photo
    order = list(dict.fromkeys(block.plates.point[points].tolist()))
    readings = np.array(
        [block.plates.xy[points][block.plates.point[points] == point].mean(axis=0) for point in order]
    )
    measured = np.column_stack([readings @ matrix.T, np.ones(len(readings))]) @ affine
    ideal = measured
    for _ in range(20):  # converges by 1e-3 a round
        ideal = measured - fixture_distortion(ideal)
    return straight(block, photo, ideal)


def fixture_distortion(xy):
    """Return the distortion (m, 2) mm of the fixture's camera; the coefficients of its cards are corrections."""
    x, y = (xy - [0.012, -0.004]).T
    r2 = x**2 + y**2
    r = np.sqrt(r2)
    table = np.interp(r, [0.0, 50.0, 100.0, 150.0], [0.0, 0.002, -0.001, -0.004]) / r
    radial = 2.4e-5 - 3.1e-9 * r2 + 1.2e-13 * r2**2 + table
    p1, p2 = -1.5e-7, 0.8e-7
    dx = p1 * (r2 + 2.0 * x**2) + 2.0 * p2 * x * y
    dy = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * y**2)
    return np.column_stack([x * radial + dx, y * radial + dy])


def straight(block, photo, xy):
    """Return images (m, 2) freed from refraction: each vector turned towards the nadir by K tan(angle)."""

    def air(height):
        T = 288.15 - 0.0065 * height
        p = 101325.0 * (T / 288.15) ** (9.80665 / (287.05287 * 0.0065))
        return p, p / (287.05287 * T)

    H = block.photos.position[photo, 2]
    (p, _), (p_camera, density) = air(20.0), air(H)
    K = 2.26e-4 * ((p - p_camera) / (9.80665 * (H - 20.0)) - density)
    nadir = attitude_matrix(block.photos.attitude[photo]) @ [0.0, 0.0, -1.0]
    v = np.column_stack([xy - [0.01, -0.005], np.full(len(xy), -152.25)])
    along = v @ nadir
    across = v - np.outer(along, nadir)
    tangent = np.linalg.norm(across, axis=1) / along
    turned = np.tan(np.arctan(tangent) - K * tangent)
    bent = np.outer(along, nadir) + across * (turned / tangent)[:, None]
    return np.array([0.01, -0.005]) - 152.25 * bent[:, :2] / bent[:, 2:]


@pytest.mark.parametrize("photo", range(3))
def test_the_fixture_by_hand(photo):
    given = read_deck(DECK)
    block, _ = reduce(given)
    own = block.plates.photo == photo
    # Turning by K tan(angle) is done to the first order in K: K^2 r is 1e-7 mm; all else is exact.
    np.testing.assert_allclose(block.plates.xy[own], by_hand(given, photo), rtol=0.0, atol=3e-7)


# --- every option of the cards ---

GEOGRAPHIC, LOCAL = model.CoordinateSystem.GEOGRAPHIC, model.CoordinateSystem.LOCAL
RAW = model.ReductionOptions(plates=model.Plates.RAW)
PHOTOS = in_system(LOCAL).photos.ids.tolist()


def options(**changes):
    return {"reduction": replace(RAW, **changes)}


FIRST = ["comparator", "fiducials", "lens"]
GROUND = options(atmosphere=model.Atmosphere.ARDC, curvature=model.Curvature.YES, ground_height=3.0)
CROSSES = {"reseau": reseau(), "cross_measurements": crosses(PHOTOS)}
VARIANTS = {
    "defaults": (options(), FIRST),
    "similarity": (options(transformation=model.Transformation.SIMILARITY), FIRST),
    "projective": (options(transformation=model.Transformation.PROJECTIVE), FIRST),
    "distances": (options(transformation=model.Transformation.DISTANCES) | {"mark_distances": distances()}, FIRST),
    "reseau": (
        options(side=model.DistortionSide.IDEAL) | CROSSES, ["comparator", "fiducials", "reseau", "lens"]
    ),
    "grid": (GROUND | {"lenses": empty(model.Lenses)}, [*FIRST, "refraction", "curvature"]),
}  # fmt: skip


@pytest.mark.parametrize(
    ("system", "changes", "steps"),
    [(LOCAL, *one) for one in VARIANTS.values()]
    + [(system, *VARIANTS["defaults"]) for system in model.CoordinateSystem if system is not LOCAL],
    ids=[*VARIANTS, "geographic", "geocentric"],
)
def test_readings_on_cards_come_back_refined(system, changes, steps):
    want = in_system(system)
    block, reduced = reduce(again(raw_block(want, **changes)))
    assert [step.name for step in reduced.plates[0].steps] == steps
    for name in ("photo", "point", "triangulated"):
        np.testing.assert_array_equal(getattr(block.plates, name), getattr(want.plates, name))
    np.testing.assert_allclose(block.plates.xy, want.plates.xy, rtol=0.0, atol=LAST_DIGIT)


def test_heights_are_the_same_in_every_system():
    """The strip is 1500 m up; local and geographic heights differ by the curvature over 1.4 km."""
    wanted = options(atmosphere=model.Atmosphere.ARDC, ground_height=0.0)
    moved = [
        [plate.step("refraction").largest for plate in reduction_of(raw_block(in_system(system), **wanted))]
        for system in model.CoordinateSystem
    ]
    np.testing.assert_allclose(moved[1:], [moved[0]] * 2, rtol=3e-4)  # 0.15 m in 1500


@pytest.mark.parametrize(
    ("kind", "rows", "message"),
    [("RADL", np.zeros((2, 3)), "camera RC8 has 2 RADL"), ("TABL", np.full((2, 3), 10.0), "camera RC8: the radii")],
)
def test_distortions_that_contradict_each_other(kind, rows, message):
    twice = model.Distortion(camera=np.zeros(2), kind=np.array([kind, kind]), values=rows)
    with pytest.raises(DeckError, match=message):
        raw_block(in_system(LOCAL), distortion=twice)


def test_a_table_in_any_order():
    table = model.Distortion(
        camera=np.zeros(2),
        kind=np.array(["TABL", "TABL"]),
        values=np.array([[150.0, 0.015, 0.0], [75.0, 0.0, 0.0]]),
    )
    lens = step_of("lens", **options(), distortion=table)
    np.testing.assert_array_equal([lens.radius, lens.radial], [[75.0, 150.0], [0.0, 0.015]])


def test_readings_in_the_fiducial_system_need_no_step():
    want = in_system(LOCAL)
    block, reduced = reduce(replace(want, **options(transformation=model.Transformation.NONE)))
    np.testing.assert_array_equal(block.plates.xy, want.plates.xy)
    assert all(not plate.steps and np.isnan(plate.sigma0) for plate in reduced.plates)


def step_of(name, **changes):
    """Return a step of the first plate of the local block, as its cards ask for it."""
    return reduction_of(again(raw_block(in_system(LOCAL), **changes)))[0].step(name).step


@pytest.mark.parametrize("side", model.DistortionSide)
@pytest.mark.parametrize(
    ("polynomials", "sign"), [(model.Polynomials.DISTORTION, 1.0), (model.Polynomials.CORRECTION, -1.0)]
)
def test_the_lens_is_that_of_the_cards(side, polynomials, sign):
    lens = step_of("lens", **options(side=side, polynomials=polynomials))
    assert lens.side.value == side.value
    np.testing.assert_array_equal(lens.centre, [0.012, -0.004])
    np.testing.assert_array_equal(sign * lens.k, [-2.4e-5, 3.1e-9, -1.2e-13, 0.0])
    np.testing.assert_array_equal(sign * lens.p, [1.5e-7, -0.8e-7, 0.0])
    np.testing.assert_array_equal(lens.radial, [0.002, -0.001, -0.004])  # never with another sign
    assert step_of("lens", **options(), lenses=empty(model.Lenses)).centre.tolist() == [
        0.0,
        0.0,
    ]  # of autocollimation


def test_refraction_and_curvature_are_those_of_the_cards():
    wanted = options(atmosphere=model.Atmosphere.ARDC, curvature=model.Curvature.YES, ground_height=300.0)
    H, h = 1.5, 0.3  # km
    K = 2410e-6 * (H / (H * H - 6.0 * H + 250.0) - h * h / (H * (h * h - 6.0 * h + 250.0)))
    assert step_of("refraction", **wanted).K == pytest.approx(K, rel=1e-12)  # rounding errors
    assert step_of("curvature", **wanted).height == pytest.approx(1200.0, abs=1e-9)


@pytest.mark.parametrize(("um", "told"), [(1.0, "0.0010"), (0.04, "0.00004"), (0.0025, "0.0000025")])
def test_a_limit_is_told_with_all_its_digits(um, told):
    block = again(raw_block(in_system(LOCAL), **options(residual_limit=um * MICROMETRE)))
    with pytest.raises(PlatesError, match=rf"is off by 0\.00\d+ mm, more than {told} mm"):
        reduce(block)


def test_the_spread_test_is_against_the_sigma_of_the_card():
    """Marks are read with 2 um: likely with the sigma of the card, hardly if that were 0.5 um."""
    for sigma, unlikely in ((0.002, False), (0.0005, True)):
        _, reduced = reduce(again(raw_block(in_system(LOCAL), comparator=replace(COMPARATOR, reading_sigma=sigma))))
        assert {plate.spreads[0].unlikely for plate in reduced.plates} == {unlikely}


def test_readings_in_a_job_of_another_system():
    """The fixture with its stations and control in UTM: the same refined coordinates, and the answer in feet."""
    utm = read_deck(ROOT / "fixtures" / "st_thomas_utm" / "st_thomas_utm.crd")
    stated = again(replace(read_deck(DECK), given_in=utm.given_in, stated_in=utm.stated_in))
    assert stated.given_in is not None and stated.options.system is model.CoordinateSystem.GEOGRAPHIC
    assert stated.reduction.ground_height == pytest.approx(20.0, abs=1e-6)
    block, _ = reduce(stated)
    # stations are rounded to 0.1 mm and attitudes to 1e-10 gon: nothing beside the rounding of the readings
    np.testing.assert_allclose(block.plates.xy, refined_block().plates.xy, rtol=0.0, atol=LAST_DIGIT)
    solution = adjust(stated)
    assert solution.block.answer_in == utm.stated_in and "Plate Reduction" in listing(solution)


# --- what a plate says of itself ---

BY_CROSSES = options(atmosphere=model.Atmosphere.US1976, ground_height=3.0) | CROSSES


def test_errors_of_readings_become_those_of_refined_coordinates():
    """Derivatives by all steps against differences; a point that is read twice is as much surer."""
    block = raw_block(in_system(LOCAL), **BY_CROSSES)
    ends = [
        [reduction_of(altered(block, plates={"xy": added(..., sign * axis)})) for sign in (1.0, -1.0)]
        for axis in 1e-4 * np.eye(2)
    ]
    for photo, plate in enumerate(reduction_of(block)):
        columns = [(there[photo].xy - back[photo].xy) / 2e-4 for there, back in ends]
        np.testing.assert_allclose(
            plate.by_reading, np.stack(columns, axis=-1), rtol=0.0, atol=1e-8
        )  # 1e-12 / 1e-4
        sigma = COMPARATOR.reading_sigma * np.linalg.norm(plate.by_reading, axis=2)
        np.testing.assert_allclose(plate.sigma, sigma / np.sqrt(plate.point_means.count)[:, None], rtol=1e-12)
        assert plate.point_means.count.tolist() == [2] + [1] * (len(plate.xy) - 1)


def test_a_reading_of_its_own_sigma_counts_by_it():
    block = raw_block(in_system(LOCAL), **options(residual_limit=0.1))
    sigma = put(1, [0.001, np.nan])(np.full_like(block.plates.sigma, np.nan))
    marks = np.full_like(block.fiducial_measurements.sigma, 0.004)
    marks[[0, 8]] = 5.0  # both readings of the first mark, which is off by 0.05 mm
    off = {"xy": added(([0, 8], 0), 0.05), "sigma": marks}
    plate = reduction_of(altered(block, plates={"sigma": sigma}, fiducial_measurements=off))[0]
    variance = np.square([0.001, COMPARATOR.reading_sigma]) @ np.square(plate.by_reading[1]).T
    np.testing.assert_allclose(plate.sigma[1], np.sqrt(variance), rtol=1e-12)
    assert np.abs(plate.marks.residuals[0]).max() == pytest.approx(0.05, abs=0.01)  # the others pay nothing for it
    assert np.abs(plate.marks.residuals[1:]).max() < 0.012  # as they are read


def test_parameters_of_every_step_have_names():
    plate = reduction_of(raw_block(in_system(LOCAL), **(BY_CROSSES | GROUND)))[0]
    named = {step.name: {one.name: one for one in quantities(plate, step.name)} for step in plate.steps}
    assert named["comparator"]["scale u"].value == COMPARATOR.scale_u
    fit = plate.marks.fit
    assert named["fiducials"]["tx"].value == fit.plane.parameters[4]
    assert named["fiducials"]["tx"].sigma == pytest.approx(np.sqrt(fit.covariance[4, 4]), rel=1e-15)
    of_u = fit.plane.matrix()[:2, 0]  # the u rail
    assert named["fiducials"]["rotation"].value == pytest.approx(np.arctan2(of_u[1], of_u[0]), abs=1e-12)
    assert named["reseau"]["crosses measured"].value == 49
    assert named["reseau"]["largest deformation"].value == pytest.approx(0.03, abs=0.002)  # of `crosses`
    assert named["lens"]["distortion at 50.000 mm"].value == 0.002
    height = float(in_system(LOCAL).photos.position[0, 2])
    assert named["refraction"]["K"].value == displacements.constant(displacements.Model.ARDC, height, 3.0)
    assert named["curvature"]["height above ground"].value == height - 3.0


def test_distances_of_a_mirrored_plate_are_refused():
    wanted = options(transformation=model.Transformation.DISTANCES) | {"mark_distances": distances()}
    block = raw_block(in_system(LOCAL), **wanted)
    with pytest.raises(PlatesError, match="too few, in one direction, or a mirrored plate"):
        reduce(altered(block, comparator={"left_handed": False}))


# --- refused plates ---


def without_marks(block: model.Block, photo: int, marks: str = "45678") -> model.Block:
    """Return a block without some of the marks of a photo."""
    table = block.fiducial_measurements
    kept = ~((table.photo == photo) & np.isin(table.ids, list(marks)))
    rows = {one.name: getattr(table, one.name)[kept] for one in fields(table)}
    return replace(block, fiducial_measurements=replace(table, **rows))


def test_a_photo_without_points_is_not_refused():
    block = raw_block(in_system(LOCAL))
    kept = block.plates.photo != 2
    plates = {one.name: getattr(block.plates, one.name)[kept] for one in fields(block.plates)}
    block = without_marks(replace(block, plates=replace(block.plates, **plates)), 2, "12345678")
    done, reduced = reduce(block)
    assert done.photos.ids.tolist() == PHOTOS and [plate.photo for plate in reduced.plates] == PHOTOS[:2]


def test_only_cameras_with_plates_need_distances():
    block = raw_block(
        in_system(LOCAL), **options(transformation=model.Transformation.DISTANCES), mark_distances=distances()
    )
    cameras = {one.name: np.repeat(getattr(block.cameras, one.name), 2, axis=0) for one in fields(block.cameras)}
    spare = replace(block.cameras, **(cameras | {"ids": np.array(["RC8", "RC9"])}))
    assert len(reduce(replace(block, cameras=spare))[1].plates) == 3
    with pytest.raises(DeckError, match="no distances along both axes"):
        reduce(replace(block, mark_distances=replace(block.mark_distances, axis=np.array(["X", "", "", ""]))))
