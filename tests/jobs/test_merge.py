"""Decks put together: nothing lost, nothing twice, and no contradiction let pass."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from altered import added, altered, with_options
from jobs.decks import cards, cayman, complaints, merge, photos, reread, rich, st_thomas
from musatpy import model
from musatpy.errors import DeckError
from musatpy.jobs.extract import extracted
from musatpy.jobs.naming import NamedKind, assigned, deck_number, new_names, renamed

LOCAL = model.CoordinateSystem.LOCAL


def strips() -> tuple[model.Block, model.Block]:
    """The photos of St. Thomas but the one in the middle, by themselves, with everything in common but photos."""
    block = reread(rich())
    return extracted(block, photos(block, "21", "22")).block, extracted(block, photos(block, "23")).block


# --- nothing lost, nothing twice ---


def test_everything_in_a_deck_is_carried() -> None:
    block = reread(rich())
    correlation = np.where(np.isfinite(block.control.sigma).all(axis=1)[:, None], [0.25] * 3, np.nan)
    block = replace(block, control=replace(block.control, correlation=correlation))
    assert any(card.startswith("CTC") for card in cards(block))
    whole = extracted(block, photos(block, "21", "22")).block, extracted(block, photos(block, "22", "23")).block
    found = merge(*whole, join_photos=True)
    assert cards(found.block) == cards(block)
    assert found.once == {
        "photo": 1,
        "fiducial mark": 1,
        "measurement": 22,
        "control point": 6,
        "distances": 2,
        "height differences": 2,
    }
    assert found.block.photos.ids.tolist() == ["21", "22", "23"]
    assert {kind: len(shared) for kind, shared in found.shared.items()} == {
        NamedKind.CAMERA: 1,
        NamedKind.PHOTO: 1,
        NamedKind.POINT: 22,
        NamedKind.GROUP: 1,
        NamedKind.TIDE: 1,
        NamedKind.DAY: 1,
    }


def test_one_deck_of_three_decides() -> None:
    block = st_thomas()
    other = replace(block, control=replace(block.control, sigma=block.control.sigma * 2.0))
    third = replace(block, control=replace(block.control, sigma=block.control.sigma * 3.0))
    assert len(complaints(block, other, third, join_photos=True)) == 10
    found = merge(block, other, third, join_photos=True, prefer=2)
    assert cards(found.block) == cards(third)
    assert found.believed == tuple(f"control point {name}" for name in ("101", "102", "103", "104", "105"))


# --- contradictions ---


CONTRADICTIONS: list[tuple[dict[str, Any], str]] = [
    (
        {"cameras": {"focal_length": [152.3]}},
        "camera RC8: focal length 152.25 in a.crd, 152.3 in b.crd",
    ),
    ({"cameras": {"format_size": [[np.nan, 228.6]]}}, "format [228.6 228.6] in a.crd, [  nan 228.6] in b.crd: one"),
    ({"fiducials": {"xy": lambda xy: xy + 0.001}}, "camera RC8: fiducials "),
    ({"distortion": {"kind": ["RADL", "RADL"]}}, "camera RC8: kinds of distortion "),
    ({"control": {"position": added((0, 2), 1e-4)}}, "control point 101 differs in position: a.crd and b.crd"),
    ({"options": {"system": LOCAL}, "ellipsoid": None}, "system is GEOG in a.crd, LOCL in b.crd"),
    ({"ellipsoid": model.EllipsoidSpec(name="WGS84")}, "ellipsoid is clrk66 in a.crd, wgs84 in b.crd"),
    ({"options": {"max_passes": 7}}, "option max_passes is 20 in a.crd, 7 in b.crd"),
    ({"water": model.Water(index=1.333)}, "water index is 1.34 in a.crd, 1.333 in b.crd"),
    ({"points": {"bathymetric": np.zeros_like}}, "point 206 is submerged in a.crd, and dry in b.crd"),
    ({"equal_elevations": {"sigma": [0.2]}}, "group SHORE has a sigma of 0.1 m in a.crd, 0.2 m in b.crd"),
]


@pytest.mark.parametrize(("changes", "message"), CONTRADICTIONS)
def test_what_differs_is_an_error_that_names_both(changes: dict[str, Any], message: str) -> None:
    west, east = strips()
    told = complaints(west, altered(east, **changes))
    assert message in told[0]
    assert len(told) == (6 if "point 206" in message else 1)  # so many are submerged, and in both decks
    if "system" in message or "ellipsoid" in message:  # which has to agree whoever is chosen
        assert complaints(west, altered(east, **changes), options_from=0) == told


def test_of_control_that_differs_one_deck_is_believed() -> None:
    west, east = strips()
    other = altered(east, control={"position": added((0, 2), 1e-4)})
    assert cards(merge(west, other, prefer=0).block) == cards(merge(west, east).block)
    believed = merge(west, other, prefer=1)
    assert believed.believed == ("control point 101",)
    row = np.flatnonzero(believed.block.points.ids[believed.block.control.point] == "101")
    np.testing.assert_array_equal(believed.block.control.position[row[0]], other.control.position[0])


def test_cameras_of_two_names_are_two_cameras() -> None:
    west, east = strips()
    apart = merge(west, renamed(east, {NamedKind.CAMERA: {"RC8": "RC8B"}}, "b.crd")).block
    assert apart.cameras.ids.tolist() == ["RC8", "RC8B"]
    assert apart.cameras.ids[apart.photos.camera].tolist() == ["RC8", "RC8", "RC8B"]
    assert apart.distortion.camera.tolist() == [0, 0, 1, 1]


def test_plate_sigmas_mean_what_they_meant() -> None:
    """Where options come from one deck, the others' default sigma and submerged factor stand on their cards."""
    west, east = strips()
    other = with_options(east, plate_sigma=0.008, submerged_factor=2.0)
    found = merge(west, other, options_from=0)
    assert found.block.plate_sigmas[: len(west.plates.photo)].tolist() == west.plate_sigmas.tolist()
    # the factor is divided out and multiplied in again: rounding of one product
    np.testing.assert_allclose(found.block.plate_sigmas[len(west.plates.photo) :], other.plate_sigmas, rtol=1e-15)
    assert len(found.notes) == 2


def test_an_ellipsoid_has_a_name_and_water_comes_from_one_deck() -> None:
    west, east = strips()
    same = replace(east, ellipsoid=model.EllipsoidSpec(name="CLRK66"))
    assert merge(west, same).block.ellipsoid == west.ellipsoid
    other = replace(east, water=model.Water(index=1.333))
    assert merge(west, other, options_from=1).block.water == other.water
    found = merge(west, replace(east, water=None))
    assert found.block.water == west.water
    assert found.notes == ("b.crd has no water card: the water of the others holds for it",)


def test_a_point_that_one_deck_flags_as_dry_is_dry_in_the_merged_one() -> None:
    west, east = strips()
    dry = east.points.ids == "208"
    flagged = replace(east, points=replace(east.points, dry=dry))
    points = merge(west, flagged).block.points
    assert points.ids[points.dry].tolist() == ["208"]


# --- what is measured between things ---


def test_a_base_the_other_way_round_is_the_same_base() -> None:
    block = reread(rich())
    turned = replace(block, air_bases=replace(block.air_bases, photo=block.air_bases.photo[:, ::-1]))
    found = merge(block, turned, join_photos=True)
    assert found.block.air_bases.photo.tolist() == block.air_bases.photo.tolist()
    longer = replace(turned, air_bases=replace(turned.air_bases, length=turned.air_bases.length + 1.0))
    assert complaints(block, longer, join_photos=True)[0] == "air base 21-22 differs in length: a.crd and b.crd"


def test_a_rise_the_other_way_round_is_a_fall() -> None:
    block = reread(rich())
    heights = block.height_differences
    turned = replace(heights, point=heights.point[:, ::-1], difference=-heights.difference)
    other = replace(block, height_differences=turned)
    assert len(merge(block, other, join_photos=True).block.height_differences.difference) == 2
    wrong = replace(other, height_differences=replace(turned, difference=heights.difference))
    assert len(merge(block, wrong, join_photos=True).block.height_differences.difference) == 4


def test_another_measurement_of_a_distance_is_another_measurement() -> None:
    block = reread(rich())
    again = replace(
        block, distances=replace(block.distances, length=block.distances.length + np.array([0.01, 0.0]))
    )
    found = merge(block, again, join_photos=True)
    assert found.block.distances.length.tolist() == [2700.0, 1600.0, 2700.01]
    assert found.once["distances"] == 1


def test_groups_of_one_name_are_one_group() -> None:
    west, _ = strips()
    other = altered(reread(rich()), photos={"ids": np.array(["31", "32", "33"])})
    found = merge(other, west)
    assert found.block.equal_elevations.ids.tolist() == ["SHORE"]
    assert len(found.block.equal_elevations.point) == 3
    wider = altered(west, equal_elevations={"sigma": [0.2]})
    assert merge(other, wider, prefer=1).block.equal_elevations.sigma.tolist() == [0.2]
    apart = merge(other, renamed(wider, {NamedKind.GROUP: {"SHORE": "SOUTH"}}, "b.crd")).block
    assert apart.equal_elevations.ids.tolist() == ["SHORE", "SOUTH"]


def test_tides_with_a_correction_in_common_are_noted() -> None:
    west, east = (
        with_options(one, program=model.Program.IIIA, water_level=model.WaterLevel.DAY) for one in strips()
    )
    assert merge(west, east).notes == ()
    same = renamed(east, {NamedKind.DAY: {"2": "1"}}, "b.crd")
    assert merge(west, same).notes == ("tides of day 1 have one unknown correction: a.crd, b.crd",)


# --- names ---


def test_names_are_given_all_at_once() -> None:
    block = st_thomas()
    turned = renamed(block, {NamedKind.PHOTO: {"21": "23", "23": "21"}}, "a.crd")
    assert turned.photos.ids.tolist() == ["23", "22", "21"]


def test_two_things_of_one_name_are_an_error() -> None:
    with pytest.raises(DeckError) as error:
        renamed(st_thomas(), {NamedKind.POINT: {"101": "102"}, NamedKind.PHOTO: {"99": "98"}}, "a.crd")
    assert [problem.headline() for problem in error.value.problems] == [
        "a.crd: no photo 99 to be renamed 98",
        "a.crd: points 102 and 101 would both be called 102",
    ]


def test_files_of_new_names() -> None:
    text = "# deck kind old new\nb photo 21 121\n* point 'A 1' A1  # a blank\n\nx/a.crd camera RC8 RC8A\n"
    lines = new_names(text, "names.txt")
    assert [(one.deck, one.kind, one.old, one.new, one.line) for one in lines] == [
        ("b", NamedKind.PHOTO, "21", "121", 2),
        ("*", NamedKind.POINT, "A 1", "A1", 3),
        ("x/a.crd", NamedKind.CAMERA, "RC8", "RC8A", 5),
    ]


@pytest.mark.parametrize(
    "line", ["a photo 21", "a plate 21 22", "a photo 21 22 23", "a photo '21 22", "a photo '' 2"]
)
def test_a_line_that_gives_no_new_name(line: str) -> None:
    with pytest.raises(DeckError) as error:
        new_names(f"a photo 21 22\n{line}\n", "names.txt")
    assert [problem.line for problem in error.value.problems] == [2]


def test_new_names_go_to_their_decks() -> None:
    parts = [("x/a.crd", st_thomas()), ("b.crd", cayman())]
    names = assigned(new_names("a photo 21 121\n* camera RC8 RMK\n", "names.txt"), parts)
    assert names == [
        {NamedKind.PHOTO: {"21": "121"}, NamedKind.CAMERA: {"RC8": "RMK"}},
        {NamedKind.CAMERA: {"RC8": "RMK"}},
    ]
    with pytest.raises(DeckError) as error:
        assigned(new_names("b photo 21 1\nc photo 21 1\n* point NONE 1\na photo 21 1\na photo 21 2\n", "n"), parts)
    assert [problem.headline() for problem in error.value.problems] == [
        "n:1: no photo 21 in b",
        "n:2: 'c' is none of the decks x/a.crd, b.crd",
        "n:3: no point NONE in *",
        "n:5: photo 21 is to be called 1 already",
    ]


def test_which_deck_is_meant() -> None:
    decks = ["x/a.crd", "y/a.crd", "y/b.crd", "b"]
    assert [deck_number(one, decks) for one in ("x/a.crd", "b.crd", "b")] == [0, 2, 3]
    with pytest.raises(DeckError, match=r"'a' may be any of x/a\.crd, y/a\.crd"):
        deck_number("a", decks)
