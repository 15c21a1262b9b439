"""Photos out of a deck: everything that belongs to them comes along, and nothing else."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from formats.deck_edits import in_system
from jobs.decks import cards, cayman, photos, reread, rich, st_thomas
from musatpy.errors import DeckError, MusatError
from musatpy.formats.musat import deck_bytes
from musatpy.geometry.areas import Area, area_of
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import frame_of
from musatpy.jobs.extract import extracted, photos_above, photos_named, photos_showing
from musatpy.jobs.plan_positions import ground_level, images_on_ground, plan
from musatpy.model import Block, CoordinateSystem
from musatpy.units import DEGREE
from raw_plates import raw_block


def measurements(block: Block) -> set[tuple[object, ...]]:
    plates = block.plates
    return {
        (block.photos.ids[p], block.points.ids[q], block.points.bathymetric[q], *xy, flag)
        for p, q, xy, flag in zip(plates.photo, plates.point, plates.xy.tolist(), plates.triangulated, strict=True)
    }


@pytest.mark.parametrize("make", [rich, cayman, raw_block])
@pytest.mark.parametrize("number", range(1, 8))
def test_the_measurements_of_the_photos_and_no_others(make: Callable[[], Block], number: int) -> None:
    """Of the first photos by the bits of a number, and of every third one behind them."""
    block = make()
    wanted = np.array([number >> min(row, row % 3) & 1 > 0 for row in range(len(block.photos.ids))])
    found = extracted(block, wanted)
    part, names = found.block, set(block.photos.ids[wanted].tolist())
    assert part.photos.ids.tolist() == block.photos.ids[wanted].tolist()
    assert measurements(part) == {one for one in measurements(block) if one[0] in names}
    assert set(part.cameras.ids[part.photos.camera]) == set(part.cameras.ids)
    bases = {tuple(pair) for pair in part.photos.ids[part.air_bases.photo].tolist()}
    assert bases == {tuple(pair) for pair in block.photos.ids[block.air_bases.photo].tolist() if set(pair) <= names}
    measured = set(part.points.ids[part.plates.point].tolist())
    for name in ("control", "distances", "height_differences", "equal_elevations"):
        kept, before = getattr(part, name), getattr(block, name)
        rows = [set(np.atleast_1d(ids).tolist()) for ids in block.points.ids[before.point]]
        stays = [ids <= measured for ids in rows]
        if name == "equal_elevations":  # a group of one member is no group
            sizes = np.bincount(before.group[stays], minlength=len(before.ids))
            stays = [stay and sizes[group] > 1 for stay, group in zip(stays, before.group, strict=True)]
        assert len(kept.point) == sum(stays)


def test_everything_that_belongs_to_the_photos_comes_along() -> None:
    block = reread(rich())
    found = extracted(block, photos(block, "21", "22"))
    assert found.left_out == {
        "photos": ("23",),
        "air bases": ("23-22",),
    }
    assert not cards(found.block) - cards(block)
    lost = {card[:3] for card in cards(block) - cards(found.block)}
    assert lost == {"STA", "ATT", "TID", "FMS", "PLT", "BAS"}
    assert reread(found.block).points.ids.tolist() == found.block.points.ids.tolist()


def test_what_is_left_out_is_named() -> None:
    block = reread(rich())
    with pytest.raises(DeckError):
        extracted(block, photos(block))
    found = extracted(block, photos(block, "21"))
    assert found.left_out["photos"] == ("22", "23")
    assert found.left_out["control points"] == ("101", "104", "105", "106")
    assert found.left_out["distances"] == found.left_out["height differences"] == ("101-102", "104-103")
    assert found.left_out["members of groups"] == ("208",)
    assert set(found.left_out["points"]) == set(block.points.ids) - set(found.block.points.ids)
    # all points of the photo have one ray left; control and members of the group are known for all that
    assert set(found.single) == set(found.block.points.ids) - {"102", "103", "202", "205"}


def test_single_rays_are_dropped_when_asked_for() -> None:
    block = cayman()
    whole = extracted(block, photos_named(block, ["837-841"]))
    found = extracted(block, photos_named(block, ["837-841"]), drop_single=True)
    assert found.dropped == whole.single
    assert set(whole.block.points.ids) - set(found.block.points.ids) == set(found.dropped)
    rays = np.bincount(found.block.plates.point, minlength=len(found.block.points.ids))
    known = np.isin(np.arange(len(rays)), found.block.control.point)
    assert (known | (rays > 1)).all()


def test_a_camera_that_took_none_of_the_photos_stays_behind() -> None:
    block = reread(rich())
    two = replace(
        block,
        cameras=replace(
            block.cameras,
            ids=["RC8", "RMK"],
            focal_length=[152.25, 153.0],
            principal_point=np.zeros((2, 2)),
            format_size=np.full((2, 2), np.nan),
        ),
        photos=replace(block.photos, camera=[0, 1, 1]),
        fiducials=replace(block.fiducials, camera=[0]),
    )
    east = extracted(two, photos(two, "22", "23")).block
    assert east.cameras.ids.tolist() == ["RMK"]
    assert east.photos.camera.tolist() == [0, 0]
    assert len(east.fiducials.ids) == len(east.distortion.kind) == 0


# --- which photos ---


def test_ranges_of_names_with_letters_and_hyphens() -> None:
    block = st_thomas()
    named = replace(block, photos=replace(block.photos, ids=np.array(["4-A9", "4-A10", "4-B10"])))
    assert photos_named(named, ["4-A9-4-A10"]).tolist() == [True, True, False]
    assert photos_named(named, ["4-A10"]).tolist() == [False, True, False]


def test_what_names_no_photo_is_an_error_each() -> None:
    with pytest.raises(DeckError) as error:
        photos_named(cayman(), ["837", "nonsense", "900-910", "846-837"])
    assert [problem.message for problem in error.value.problems] == [
        "no photo nonsense in the deck",
        "no photo 900-910 in the deck",
        "no photo 846-837 in the deck",
    ]


def test_area_by_stations() -> None:
    block = cayman()
    longitude = block.photos.position[:, 1] / DEGREE
    area = Area.box(-81.30, 19.0, -81.20, 20.0, geographic=True)
    assert photos_above(block, area).tolist() == ((longitude > -81.30) & (longitude < -81.20)).tolist()
    geocentric = in_system(CoordinateSystem.GEOCENTRIC)
    geographic = in_system(CoordinateSystem.GEOGRAPHIC)
    # half of the last decimal of a geocentric coordinate is 1e-9 degrees
    np.testing.assert_allclose(
        plan(geocentric, geocentric.photos.position), plan(geographic, geographic.photos.position), atol=1e-9
    )


def test_an_area_across_180_degrees() -> None:
    area = Area.box(179.0, -18.0, -179.0, -17.0, geographic=True)
    places = np.array([[179.5, -17.5], [-179.5, -17.5], [178.5, -17.5], [-178.5, -17.5], [180.0, -16.0]])
    assert area.holds(places).tolist() == [True, True, False, False, False]


def test_a_polygon_that_is_not_convex() -> None:
    text = "# an L\n0 0\n4, 0\n4 1\n1 1\n1 4\n\n0 4\n"
    area = area_of(text, "area.txt", geographic=False)
    places = np.array([[0.5, 0.5], [3.0, 0.5], [0.5, 3.0], [3.0, 3.0], [-1.0, 0.5], [np.nan, 0.5]])
    assert area.holds(places).tolist() == [True, True, True, False, False, False]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0\n1 0\n", "area.txt: an area needs three corners at least, not 2"),
        ("0 0\n1 0\nx 1\n", "area.txt:3: 'x 1' is not an east and a north"),
        ("0 0\n1 0\n1 2 3\n", "area.txt:3: '1 2 3' is not an east and a north"),
    ],
)
def test_a_file_that_is_no_area(text: str, message: str) -> None:
    with pytest.raises(DeckError) as error:
        area_of(text, "area.txt", geographic=False)
    assert str(error.value) == message


def test_an_empty_box_is_an_error() -> None:
    with pytest.raises(MusatError, match="is empty"):
        Area.box(1.0, 5.0, 2.0, 4.0, geographic=False)


@pytest.mark.parametrize("system", list(CoordinateSystem))
def test_images_are_put_down_on_level_ground_along_their_rays(system: CoordinateSystem) -> None:
    block = in_system(system)
    frame, plates, station = frame_of(block.options.system, block.ellipsoid), block.plates, block.photos
    ground = images_on_ground(block, 20.0)
    at = frame.working(station.position)
    axes = frame.axes(at)
    v = np.einsum("rij,rj->ri", axes[plates.photo], frame.working(ground) - at[plates.photo])
    image = np.einsum("rij,rj->ri", attitude_matrix(station.attitude[plates.photo]), v)
    camera = station.camera[plates.photo]
    scale = -block.cameras.focal_length[camera] / image[:, 2]
    xy = image[:, :2] * scale[:, None] + block.cameras.principal_point[camera]
    # rounding of geocentric coordinates, 1e-9 m, in the scale of the photos
    np.testing.assert_allclose(xy, plates.xy, atol=1e-9 * 1e3)
    # level below the station: off the curved surface by d^2/2R
    drop = np.square(v[:, :2]).sum(axis=1) / (2 * 6.37e6)
    bend = 0.0 if system is CoordinateSystem.LOCAL else drop
    np.testing.assert_allclose(np.atleast_1d(frame.height(frame.working(ground))) - bend, 20.0, atol=0.02)


def test_area_by_points() -> None:
    block = st_thomas()
    control = block.control.position[block.control.kind == 0][:1]
    east, north = plan(block, control)[0]
    box = Area.box(east - 1e-4, north - 1e-4, east + 1e-4, north + 1e-4, geographic=True)  # 10 m
    seen = np.unique(block.plates.photo[block.plates.point == block.control.point[0]])
    assert not photos_above(block, box).any()
    assert np.flatnonzero(photos_showing(block, box, ground_level(block))).tolist() == seen.tolist()


def test_ground_without_any_height_has_to_be_told() -> None:
    block = replace(
        st_thomas(),
        control=replace(st_thomas().control, position=np.full((6, 3), np.nan)),
    )
    assert ground_level(block) == pytest.approx(0.12)  # the middle one of the tides
    dry = replace(block, photos=replace(block.photos, tide=np.full(3, np.nan)))
    with pytest.raises(DeckError, match="from neither control nor tides"):
        ground_level(dry)


def test_the_tilted_water_is_noted() -> None:
    block = st_thomas()
    tilted = replace(block, water=replace(block.water, tilt_east=1e-5))
    assert extracted(tilted, photos(tilted, "21")).notes
    assert not extracted(tilted, photos(tilted, "21", "22", "23")).notes
    assert deck_bytes(extracted(block, photos(block, "21", "22", "23")).block) == deck_bytes(block)
