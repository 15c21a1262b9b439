"""Blocks made call by call: those of decks again, and every slip named with the call that made it."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from musatpy import BlockBuilder, adjust, read_deck
from musatpy.errors import DeckError
from musatpy.formats import system_rows
from musatpy.formats.parts import parts_of
from musatpy.model import Options, WaterConditions
from musatpy.model.tables import Table, columns

FIXTURES = Path(__file__).parents[2] / "fixtures"
# Of every kind of card: land and water, raw plates, waves, IIIA with its observations, many groups.
# three_photos is for "musat orient": it has no datum, and is no block.
DECKS = sorted(path for path in FIXTURES.glob("*/*.crd") if path.stem != "three_photos" and path.parent.name in (
    "st_thomas", "cayman", "st_thomas_raw", "waves", "verdict", "orientation",
))  # fmt: skip


def of_parts(block):
    """Return the builder to which everything was added that a block says."""
    options = {field.name: getattr(block.options, field.name) for field in fields(Options)}
    builder = BlockBuilder(*block.titles, **options)
    for role, table in parts_of(block).items():
        if role not in ("titles", "options", "more_options", *system_rows.TABLES):
            builder.add(role, **{path.rpartition(".")[2]: values for path, values in table.items()})
    return builder


def assert_same(block, other):
    for name, table in block.tables().items():
        for column in columns(type(table)):
            ours, theirs = getattr(table, column), getattr(other.tables()[name], column)
            equal_nan = ours.dtype.kind == "f"
            assert np.array_equal(ours, theirs, equal_nan=equal_nan), (name, column)
    for field in fields(block):
        if not isinstance(getattr(block, field.name), Table):
            assert getattr(block, field.name) == getattr(other, field.name), field.name


@pytest.mark.parametrize("deck", DECKS, ids=lambda path: path.stem)
def test_a_block_can_be_made_again_of_what_it_says(deck):
    block = read_deck(deck)
    assert_same(block, of_parts(block).build())


def test_a_pair_is_made_by_calls():
    """Its images are exact: what a call would put elsewhere would leave residuals."""
    builder = small(photos={"1": {"tide": 0.5}, "2": {"tide": -0.5}})
    builder.water(1.34)
    for photo in "12":
        builder.add_images(photo, ["Y"], [[5.0, 6.0]], triangulated=[False], submerged=[True])
    block = builder.build()
    assert block.points.ids[block.points.bathymetric].tolist() == ["Y"]
    assert (~block.plates.triangulated).sum() == 2 and block.photos.tide.tolist() == [0.5, -0.5]
    solution = adjust(block)
    taken = solution.plates.triangulated
    assert solution.converged and np.abs(solution.plates.residual[taken]).max() < 1e-9  # mm, rounding
    assert taken.sum() == 18 and len(block.control.point) == 4


def test_all_else_that_is_measured_has_its_call():
    builder = small()
    builder.add_air_base(("1", "2"), 100.0, 0.1)
    builder.add_distance(["A", "B"], 12.5, 0.01)
    builder.add_height_difference(["B", "A"], -0.5, 0.02)
    builder.add_equal_elevations("L", ["A", "B"], 0.1)
    builder.add_equal_elevations("M", ["C", "D", "E", "F", "G", "H", "I"], 0.2)
    block = builder.build()
    ids = block.points.ids
    assert block.air_bases.photo.tolist() == [[0, 1]] and block.air_bases.length.tolist() == [100.0]
    assert ids[block.distances.point].tolist() == [["A", "B"]]
    assert ids[block.height_differences.point].tolist() == [["B", "A"]]
    groups = block.equal_elevations
    assert ids[groups.point].tolist() == list("ABCDEFGHI") and groups.sigma.tolist() == [0.1, 0.2]
    assert groups.group.tolist() == [0, 0, 1, 1, 1, 1, 1, 1, 1]


def small(photos=None, **options):
    """Return the builder of a stereopair of nine points."""
    builder = BlockBuilder("pair", **{"system": "LOCL", "program": "IIIA", "refraction": "RIGOROUS", **options})
    builder.add_camera("K", 150.0, principal_point=(0.01, -0.005), format_size=(300.0, 300.0))
    ground = np.array([(x, y, 3.0 * x % 7) for x in (-40.0, 40.0, 120.0) for y in (-60.0, 0.0, 60.0)])
    for photo, station in (("1", [0.0, 0.0, 150.0]), ("2", [80.0, 0.0, 150.0])):
        away = ground - station
        builder.add_photo(photo, "K", station, [0.0, 0.0, 0.0], **(photos or {}).get(photo, {}))
        builder.add_images(photo, list("ABCDEFGHI"), [0.01, -0.005] + 150.0 * away[:, :2] / -away[:, 2:])
    for row, name in ((0, "A"), (2, "C"), (6, "G"), (8, "I")):
        builder.add_control(name, ground[row], sigma=0.1)
    return builder


def test_names_may_be_long():
    builder = BlockBuilder(system="LOCL", program="IIIA", initial="COMPUTE")
    builder.add_camera("DJI_FC6310S_0123456789", 150.0 / 7.0)
    builder.add_images("nadir/102MEDIA/DJI_0002.JPG", ["a" * 40], [[1.0 / 3.0, 2.0 / 3.0]])
    builder.add_control("a" * 40, (1.0 / 3.0, 2.0, 3.0), "C")
    errors = [problem for problem in builder.check() if problem.severity == "error"]
    assert [problem.message[:9] for problem in errors] == ["photo nad"]  # it has too few rays, and no more is wrong


def test_water_may_be_said_by_what_its_index_comes_from():
    builder = small()
    builder.water(conditions=WaterConditions(temperature=20.0, wavelength=550.0, salinity=35.0), tilt=(1e-5, 2e-5))
    water = builder.build().water
    assert water.conditions.salinity == 35.0 and (water.tilt_east, water.tilt_north) == (1e-5, 2e-5)
    assert water.index == pytest.approx(1.34, abs=0.01)


def spoilt(edit, **options):
    builder = small(**options)
    edit(builder)
    with pytest.raises(DeckError) as caught:
        builder.build()
    return [problem.headline() for problem in caught.value.problems]


SLIPS = [
    (
        lambda b: b.add_photo("2", "K", (0, 0, 99.0), (0, 0, 0)),
        "station of photo 2 is already given by add_photo('2')",
    ),
    (lambda b: b.add_photo("3", "Q", (0, 0, 99.0), (0, 0, 0)), "add_photo('3').camera: camera Q has no add_camera"),
    (lambda b: b.add_images("9", ["A"], [[1.0, 2.0]]), "photo 9 has no station card (add_photo)"),
    (
        lambda b: b.add_images("1", "YZ", [1.0, 2.0, 3.0]),
        "add_images: xy: has the shape (3,); expected (2,) and (k, 2)",
    ),
    (
        lambda b: b.add_images("1", ["Y", "Z"], np.zeros((2, 2)), submerged=[True, False, True]),
        "not as many rows of each: photo 1, point 2, xy 2, triangulated 1, bathymetric 3",
    ),
    (lambda b: b.water(1.34, tilt=(0.0, 0.0, 1.0)), "water: tilt: has the shape (3,); expected (2,)"),
    (
        lambda b: b.add_control("D", (1.0, 2.0, 3.0)),
        "add_control('D'): the east, north, up components are known and not",
    ),
    (lambda b: b.add_control("D", (1.0, 2.0, 3.0), "Q"), "add_control: kind: 'Q' is not one of F, H, V, C"),
    (lambda b: b.add_control("D", (1.0, 2.0, 3e9), "C"), "add_control('D').z: 3e+09 is beyond 1e+08 m"),
    (lambda b: b.add_equal_elevations("E", ["A", "B"], 1e-12), "('E').sigma: 1e-12 is next to nothing: 1e-09 m at"),
    (lambda b: b.add_air_base(("1", "1"), 1.0, 1.0), "add_air_base('1'): an air base needs two different photos"),
    (lambda b: b.add("fiducial", ids="A"), "add('fiducial'): nothing is called so; did you mean fiducials?"),
    (lambda b: b.add("fiducials", name="A"), "add('fiducials'): no 'name' here; did you mean camera?"),
]


@pytest.mark.parametrize(("edit", "problem"), SLIPS)
def test_a_slip_is_named_with_its_call(edit, problem):
    problems = spoilt(edit)
    assert any(problem in text for text in problems), problems


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"program": "IIIB"}, "BlockBuilder: program: 'IIIB' is no Program; did you mean IIIA?"),
        ({"plate_sigm": 0.1}, "BlockBuilder: no option 'plate_sigm'; did you mean plate_sigma?"),
        ({"plate_sigma": -1.0}, "BlockBuilder.plate_sigma: a standard deviation must be greater than zero"),
        ({"system": "GEOG"}, "a job of system GEOG needs an ellipsoid (BlockBuilder)"),
        ({"program": "IIA", "water_level": "ONE"}, "BlockBuilder.water_level: 'ONE' needs program IIIA"),
    ],
)
def test_options_that_cannot_be_are_named(options, problem):
    assert problem in spoilt(lambda builder: None, **options)


def test_every_problem_is_said_at_once_in_the_order_of_the_calls():
    def edit(builder):
        builder.add_camera("K", 152.0)
        builder.add_images("7", ["A"], [[0.1, 2.0]])
        builder.add_control("A", (1.0, 2.0, 3.0), "Q")
        builder.add_distance(["A", "A"], 1.0, 1.0)

    found = spoilt(edit, plate_sigma=-1.0, order="NAMES")
    calls = [text.partition(":")[0].partition(".")[0].partition("(")[0] for text in found]
    errors = ["BlockBuilder", "BlockBuilder", "add_camera", "add_images", "add_control", "add_distance"]
    assert [call for call in calls if call in errors] == errors


def test_nothing_at_all_is_said_too():
    with pytest.raises(DeckError) as caught:
        BlockBuilder(system="LOCL").build()
    text = str(caught.value)
    assert "the block needs a camera: add_camera" in text and "the block needs images: add_images" in text
    assert "the block has no exposure stations (no add_photo)" in text


def test_warnings_do_not_keep_a_block_from_being_built():
    builder = small()
    builder.add_control("FAR", (1.0, 2.0, 3.0), "C")
    builder.add("fiducials", camera="K", ids=["1", "2"], xy=[[-100.0, 0.0], [100.0, 0.0]])
    headlines = [problem.headline() for problem in builder.check()]
    far = "add_control('FAR').point: warning: control point FAR is measured on no photo: it cannot be used"
    marks = "add('fiducials', 'K', '1'): warning: plate coordinates are taken as refined"
    assert len(headlines) == 2 and far in headlines and any(text.startswith(marks) for text in headlines)
    block = builder.build()
    assert block.control.count == 5 and block.fiducials.xy.tolist() == [[-100.0, 0.0], [100.0, 0.0]]


def test_photos_may_have_nothing_but_images():
    builder = BlockBuilder(system="LOCL", program="IIIA", initial="COMPUTE", refraction="RIGOROUS")
    made = small().build()
    builder.add_camera("K", 150.0)
    plates = made.plates
    builder.add_images(made.photos.ids[plates.photo], made.points.ids[plates.point], plates.xy)
    for row, name in enumerate(made.points.ids[made.control.point]):
        builder.add_control(name, made.control.position[row], sigma=made.control.sigma[row])
    block = builder.build()
    assert block.photos.camera.tolist() == [0, 0] and np.isnan(block.photos.position).all()
