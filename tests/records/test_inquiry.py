"""One point or photo of a run: what the record says of it, and what would happen without its observations."""

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from altered import altered, put, with_options
from cli.commands import musat
from musatpy import adjust, read_deck
from musatpy.errors import MusatError
from musatpy.model import ControlKind, ObservationKind, Program, Refraction, WaterLevel
from musatpy.records.inquiry import TABLES, inquire
from musatpy.records.json_files import read_record
from musatpy.reports.inquiry import inquiry_text
from musatpy.reports.record import dumps, record, record_of
from musatpy.statistics import Statistics, metric_differences

FIXTURES = Path(__file__).parents[2] / "fixtures"
ST_THOMAS, CAYMAN = FIXTURES / "st_thomas/st_thomas.crd", FIXTURES / "cayman/cayman_clean.crd"


@cache
def run_of(deck, simultaneous=False):
    block = read_deck(deck)
    if simultaneous:
        block = with_options(block, program=Program.IIIA, refraction=Refraction.RIGOROUS)
    return adjust(block)


@cache
def record_of_run(deck, simultaneous=False):
    return record_of(Statistics(run_of(deck, simultaneous)), TABLES)


def ask(solution, name):
    return inquire(record_of(Statistics(solution), TABLES), name)


def change_of(solution, point, **block):
    """Return how a point moves where the block is adjusted anew with something else."""
    again = adjust(altered(solution.block, **block))
    row = int(np.flatnonzero(solution.block.points.ids == point)[0])
    places = (one.points.position[row : row + 1] for one in (solution, again))
    return metric_differences(solution.block, *places)[0]


# --- what would happen without an observation, held against a new adjustment ---


def predicted_and_true(deck, simultaneous, step):
    """Yield what is predicted without images of points with three rays or more, and what comes out without them."""
    solution = run_of(deck, simultaneous)
    plates, points = solution.block.plates, solution.block.points
    rows = np.flatnonzero(solution.plates.triangulated & (solution.points.rays[plates.point] >= 3))
    for row in rows[::step].tolist():
        point, photo = points.ids[plates.point[row]], solution.block.photos.ids[plates.photo[row]]
        (about,) = inquire(record_of_run(deck, simultaneous), point)
        (image,) = np.flatnonzero(about.images.photo == photo)
        true = change_of(solution, point, plates={"triangulated": put(row, False)})
        yield about.images.change[image], true, np.array(about.row["sigma"])


@pytest.mark.parametrize(
    ("deck", "simultaneous", "step"),
    [
        (ST_THOMAS, False, 3),
        pytest.param(ST_THOMAS, True, 2, marks=pytest.mark.slow),
        pytest.param(CAYMAN, False, 40, marks=pytest.mark.slow),
        pytest.param(CAYMAN, True, 40, marks=pytest.mark.slow),
    ],
    ids=lambda value: getattr(value, "stem", str(value)),
)
def test_what_would_happen_without_an_image_is_predicted(deck, simultaneous, step):
    """To 15 % of change and sigma: x and y are taken one by one, and the adjustment is not linear."""
    found = list(predicted_and_true(deck, simultaneous, step))
    assert len(found) >= 4
    for predicted, true, sigma in found:
        assert np.linalg.norm(predicted - true) < 0.15 * (np.linalg.norm(true) + np.linalg.norm(sigma))
    moved = np.array([np.linalg.norm(true) for _, true, _ in found])
    error = np.array([np.linalg.norm(predicted - true) for predicted, true, _ in found])
    assert error.sum() < 0.2 * moved.sum()


@pytest.mark.parametrize(("point", "kind"), [("101", ControlKind.HORIZONTAL), ("104", ControlKind.HORIZONTAL)])
def test_without_one_component_of_control_the_prediction_is_exact(point, kind):
    """To a fiftieth: what is left is what is not linear."""
    solution = run_of(ST_THOMAS, True)
    control, ids = solution.block.control, solution.block.points.ids
    (row,) = np.flatnonzero(ids[control.point] == point)
    true = change_of(solution, point, control={"kind": put(row, kind)})
    (about,) = inquire(record_of_run(ST_THOMAS, True), point)
    (up,) = (n for n, component in enumerate(about.others.component) if component == "Up")
    assert about.others.change[up] == pytest.approx(true, abs=0.02 * np.linalg.norm(true))
    assert np.linalg.norm(true) > 0.01


def test_a_point_of_two_rays_has_no_place_without_one_of_them():
    (about,) = inquire(record_of_run(ST_THOMAS), "203")
    assert about.row["rays"] == 2 and np.isnan(about.images.change).all()
    assert "Without one of its images it would have no position" in inquiry_text(record_of_run(ST_THOMAS), about)
    (held,) = inquire(record_of_run(ST_THOMAS), "101")  # full control holds it
    assert held.row["rays"] == 2 and np.isfinite(held.images.change).all()


def test_points_that_only_a_photo_gives_are_named():
    solution = run_of(ST_THOMAS)
    (about,) = (one for one in ask(solution, "22") if one.is_photo)
    plates = solution.block.plates
    again = adjust(altered(solution.block, plates={"triangulated": plates.triangulated & (plates.photo != 1)}))
    lost = again.points.status != 0
    only = lost & (solution.points.status == 0)
    assert set(about.alone) == set(solution.block.points.ids[only]) and len(about.alone) > 10


# --- what is said is what the solution says ---


def test_images_of_a_point_are_those_of_the_solution():
    solution = run_of(ST_THOMAS)
    quality, plates = Statistics(solution), solution.block.plates
    (about,) = ask(solution, "206")
    rows = np.flatnonzero(solution.block.points.ids[plates.point] == "206")
    assert about.images.photo.tolist() == solution.block.photos.ids[plates.photo[rows]].tolist()
    assert about.images.residual == pytest.approx(solution.plates.residual[rows], rel=1e-9)
    assert about.images.refraction == pytest.approx(
        np.linalg.norm(solution.plates.correction[rows], axis=1), rel=1e-9
    )
    of_images = [
        np.flatnonzero((quality.observed.kind == ObservationKind.PLATE) & (quality.observed.row == row))
        for row in rows
    ]
    assert about.images.redundancy == pytest.approx(quality.observed.redundancy[of_images], rel=1e-9)
    assert about.images.detectable == pytest.approx(quality.detectable[of_images], rel=1e-9)
    moves = np.linalg.norm(quality.effect[of_images], axis=2).max(axis=1)
    assert about.images.hidden == pytest.approx(moves, rel=1e-9)
    assert about.images.tide.tolist() == solution.block.photos.tide[plates.photo[rows]].tolist()


def test_neighbours_are_the_nearest_on_the_same_photos():
    solution = run_of(ST_THOMAS)
    block = solution.block
    (about,) = ask(solution, "206")
    place = {name: solution.points.position[row] for row, name in enumerate(block.points.ids)}
    others = [name for name in block.points.ids if name != "206"]
    shift = metric_differences(block, np.array([place["206"]] * len(others)), np.array([place[n] for n in others]))
    distance = dict(zip(others, np.linalg.norm(shift, axis=1), strict=True))
    assert about.neighbours.ids.tolist() == sorted(others, key=distance.__getitem__)
    assert about.neighbours.distance[0] == pytest.approx(min(distance.values()), abs=1e-3)
    photos = {
        name: set(block.plates.photo[block.points.ids[block.plates.point] == name]) for name in block.points.ids
    }
    common = [len(photos[name] & photos["206"]) for name in about.neighbours.ids]
    assert about.neighbours.common.tolist() == common


def test_neighbours_of_a_photo_have_its_points():
    block = run_of(ST_THOMAS).block
    (about,) = (one for one in ask(run_of(ST_THOMAS), "21") if one.is_photo)
    points = [set(block.plates.point[block.plates.photo == photo]) for photo in range(3)]
    assert about.neighbours.ids.tolist() == ["22", "23"]
    assert about.neighbours.common.tolist() == [len(points[0] & points[1]), len(points[0] & points[2])]
    base = metric_differences(block, *(run_of(ST_THOMAS).stations.position[n : n + 1] for n in (0, 1)))
    assert about.neighbours.distance[0] == pytest.approx(np.linalg.norm(base), abs=1e-3)


def test_a_name_of_both_a_point_and_a_photo_shows_both():
    solution = run_of(ST_THOMAS)
    ids = solution.block.points.ids.copy()
    ids[0] = "21"
    both = ask(altered(solution, block={"points": {"ids": ids}}), "21")
    assert [about.is_photo for about in both] == [False, True]


def test_other_observations_are_those_of_the_name():
    block = run_of(ST_THOMAS).block
    sigma = np.full((3, 3), 30.0)
    observed = altered(block, photos={"position_sigma": sigma, "attitude_sigma": np.full((3, 3), 0.01)})
    solution = adjust(with_options(observed, program=Program.IIIA, refraction=Refraction.RIGOROUS))
    (about,) = (one for one in ask(solution, "21") if one.is_photo)
    assert [kind.name for kind in about.others.kind] == ["STATION_POSITION"] * 3 + ["STATION_ATTITUDE"] * 3
    (shore,) = ask(solution, "202")
    assert [(kind.name, of) for kind, of in zip(shore.others.kind, shore.others.of, strict=True)] == [
        ("EQUAL_ELEVATION", "202")
    ]


def test_the_tide_of_a_photo_that_is_unknown_is_one_of_them():
    block = altered(run_of(ST_THOMAS).block, photos={"tide_sigma": np.full(3, 0.1)})
    options = {"program": Program.IIIA, "refraction": Refraction.RIGOROUS, "water_level": WaterLevel.PHOTO}
    solution = adjust(with_options(block, **options))
    (about,) = (one for one in ask(solution, "22") if one.is_photo)
    assert [kind.name for kind in about.others.kind] == ["WATER_LEVEL"]
    assert about.images.tide[0] == pytest.approx(solution.water.tide[1], rel=1e-9)


def test_of_nothing_the_nearest_name_is_said():
    with pytest.raises(MusatError, match=r"no point and no photo 'ROCKS'; did you mean ROCK\?"):
        inquire(record_of_run(ST_THOMAS), "ROCKS")
    with pytest.raises(MusatError, match=r"no point and no photo 'zzzz'$"):
        inquire(record_of_run(ST_THOMAS), "zzzz")


# --- the screen ---


@pytest.mark.parametrize(
    "deck",
    ["st_thomas/st_thomas.crd", "cayman/cayman_clean.crd", "st_thomas_raw/st_thomas_raw.crd", "waves/strip.crd"],
)
def test_every_screen_fits(deck):
    solution = run_of(FIXTURES / deck)
    said = record_of_run(FIXTURES / deck)
    names = [*solution.block.photos.ids[:4].tolist(), *solution.block.points.ids[::3].tolist()]
    for about in itertools.chain.from_iterable(inquire(said, name) for name in names):
        lines = inquiry_text(said, about).splitlines()
        assert len(lines) <= 55 and max(map(len, lines)) <= 132, about.name
        assert lines[0].startswith(f"{'PHOTO' if about.is_photo else 'POINT'} {about.name}")


def test_a_screen_says_what_was_asked_for():
    said = record_of_run(ST_THOMAS)
    text = inquiry_text(said, inquire(said, "206")[0])
    for line in (
        "Submerged point, triangulated; its position is that of 3 images",
        "Latitude 18 19 38.90989, Longitude -64 55 52.31798, Height -6.360 m",
        "  sigma: East .115, North .158, Up .423 m",
        "  depth 6.477 m, sigma .423",
        "  straight rays: 4.256, times the index: 5.703; mean water level .117, incidence 36.6 degrees",
        "An error of one observation that the verdict does not see may move it by 1.695 m (3.7 sigmas)",
        "Points Nearby, and 15 more",
    ):
        assert line in text.splitlines(), line
    check = inquiry_text(said, inquire(said, "106")[0])
    assert (
        "  check point, adjusted minus given: East .018, North -.037, Up .338 m; as much by chance: .3516" in check
    )
    photo = inquiry_text(said, next(one for one in inquire(said, "22") if one.is_photo))
    assert "Without this photo 11 points would have no position: ROCK, 203, 209," in photo
    assert "  8.888 m from the given station" in photo and "  water at .310 m, 8 wet rays" in photo


@pytest.mark.slow
def test_points_without_a_position_and_images_kept_out_are_shown():
    block = run_of(ST_THOMAS).block
    row = int(np.flatnonzero(block.points.ids == "203")[0])
    kept_out = altered(block, plates={"triangulated": block.plates.point != row})
    said = record_of(Statistics(adjust(kept_out)), TABLES)
    text = inquiry_text(said, inquire(said, "203")[0])
    assert "Submerged point, intersected: " in text
    assert all(f"{photo}        WN" in text for photo in ("21", "22"))
    lone = replace(block.plates, point=block.plates.point.copy(), triangulated=block.plates.triangulated)
    some = np.ones(len(lone.point), dtype=bool)
    some[np.flatnonzero(lone.point == row)[0]] = False
    one_ray = altered(
        block,
        plates={name: getattr(lone, name)[some] for name in ("photo", "point", "xy", "sigma", "triangulated")},
    )
    said = record_of(Statistics(adjust(one_ray)), TABLES)
    assert "Submerged point, without a position: " in inquiry_text(said, inquire(said, "203")[0])


@pytest.mark.slow
def test_causes_that_name_a_point_are_said():
    said = record_of_run(FIXTURES / "verdict/edit_point_206_420m.crd")
    named = [point for cause in said["causes"] for point in cause["points"]]
    assert named[0] == "206"
    text = inquiry_text(said, inquire(said, named[0])[0])
    assert "possible cause of what does not fit: image" in text


def test_hostile_names_are_escaped():
    solution = run_of(ST_THOMAS)
    hostile = altered(solution, block={"titles": ("\x1b[2J",)})
    said = record_of(Statistics(hostile), TABLES)
    assert "\\x1b[2J" in inquiry_text(said, inquire(said, "206")[0]).splitlines()[0]


# --- the command ---


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "st_thomas.json"
    path.write_text(dumps(record(run_of(ST_THOMAS))))
    return path


def test_a_record_and_a_deck_say_the_same(written):
    assert read_record(written, TABLES)["points"]["point"]
    ran = [musat("explain", "206", path) for path in (written, ST_THOMAS)]
    assert [one.exit_code for one in ran] == [0, 0]
    assert ran[0].stdout == ran[1].stdout
    assert ran[0].stdout.startswith("POINT 206: ST THOMAS USVI")


def test_faults_are_one_line_each(written, tmp_path):
    slip = musat("explain", "2066", written)
    assert slip.exit_code == 1 and slip.stderr == "musat: no point and no photo '2066'; did you mean 206?\n"
    gone = musat("explain", "206", tmp_path / "none.json")
    assert gone.exit_code == 1 and "none.json" in gone.stderr


def test_a_record_without_images_says_why(tmp_path):
    assert musat("run", "-q", ST_THOMAS, "-o", tmp_path, "--record", "tables").exit_code == 0
    ran = musat("explain", "206", tmp_path / "st_thomas.json")
    assert ran.exit_code == 1 and "the record was written with --record tables" in ran.stderr
