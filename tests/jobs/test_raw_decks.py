"""Decks of comparator readings listed, taken apart and put together, and what is punched of their solutions."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from jobs.decks import cards, photos, reread
from musatpy import adjust, model
from musatpy.errors import DeckError
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import extracted, photos_showing
from musatpy.jobs.merge import Merged, MergeOptions, merged
from musatpy.jobs.plan_positions import Area
from musatpy.jobs.punch import Content, Punch, punched
from musatpy.jobs.summary import summary
from raw_plates import crosses, distances, raw_block, refined_block, reseau


def raw() -> model.Block:
    """The fixture with a reseau and distances between its marks, and a camera that took nothing before its own."""
    block = raw_block(reseau=reseau(), cross_measurements=crosses(["21", "22", "23"]), mark_distances=distances())
    block = reread(block)
    spare = {
        name: np.concatenate([getattr(block.cameras, name)] * 2)
        for name in ("ids", "focal_length", "principal_point", "format_size")
    }
    spare["ids"] = np.array(["RC10", "RC8"])
    linked = ("distortion", "fiducials", "lenses", "mark_distances", "reseau", "photos")
    tables = {name: replace(table := getattr(block, name), camera=table.camera + 1) for name in linked}
    return replace(block, cameras=replace(block.cameras, **spare), **tables)


def merge(*blocks: model.Block, **options: object) -> Merged:
    parts = [Part(name=f"{letter}.crd", block=block) for letter, block in zip("abc", blocks, strict=False)]
    return merged(parts, MergeOptions(**options))  # type: ignore[arg-type]


def complaints(*blocks: model.Block, **options: object) -> list[str]:
    with pytest.raises(DeckError) as error:
        merge(*blocks, **options)
    return [problem.message for problem in error.value.problems]


def test_repeated_readings_are_one_ray():
    found, plain = summary(raw_block()), summary(refined_block())
    np.testing.assert_array_equal(found.photos.rays, plain.photos.rays)
    np.testing.assert_array_equal(found.points.rays, plain.points.rays)
    np.testing.assert_array_equal(found.pairs.points, plain.pairs.points)


def test_photos_come_out_with_their_readings_and_calibrations():
    block = raw()
    part = extracted(block, photos(block, "22", "23")).block
    assert part.cameras.ids.tolist() == ["RC8"]
    text = cards(block)
    gone = {line for line in text if line.startswith(("CAM RC10", "FMS 21", "RSM 21"))}
    kept = cards(part)
    assert gone and not kept.keys() & gone
    for kind, count in (
        ("RSC", 49),
        ("RSM", 98),
        ("FDS", 4),
        ("LNS", 1),
        ("DST", 5),
        ("FMS", 32),
        ("CMP", 1),
        ("RED", 1),
    ):
        own = {line for line in kept if line[:3] == kind}
        assert own <= set(text) and len(own) == count, kind
    again = reread(part)
    assert again.photos.ids.tolist() == ["22", "23"]


def test_a_point_that_is_read_twice_on_one_photo_is_single():
    block = raw()
    row = next(row for row, point in enumerate(block.plates.point) if block.points.ids[point] == "212")
    plates = {one.name: getattr(block.plates, one.name) for one in fields(block.plates)}
    again = {name: np.concatenate([column, column[row : row + 1]]) for name, column in plates.items()}
    twice = replace(block, plates=replace(block.plates, **again))
    for one in (block, twice):
        assert "212" in extracted(one, photos(one, "21"), drop_single=True).dropped
        assert "212" in extracted(one, photos(one, "21")).single


def test_images_of_readings_are_nowhere_yet():
    box = Area.box(-66.0, 17.0, -64.0, 19.0, geographic=True)
    with pytest.raises(DeckError, match="comparator readings"):
        photos_showing(raw_block(), box, 0.0)


def test_parts_make_the_whole_again():
    block = raw()
    parts = [extracted(block, photos(block, *names)).block for names in (("21", "22"), ("22", "23"))]
    found = merge(*parts, join_photos=True)
    whole = extracted(block, photos(block, "21", "22", "23")).block
    assert cards(found.block) == cards(whole)
    assert found.once["fiducial mark"] == 16 and found.once["reseau cross"] == 49


def test_what_readings_disagree_in_is_told():
    block = raw_block()
    other = replace(block, comparator=replace(block.comparator, rotation=0.1))
    first, second = (extracted(one, photos(one, name)).block for one, name in ((block, "21"), (other, "23")))
    assert complaints(first, second) == ["the comparator of a.crd is not that of b.crd"]
    assert complaints(first, second, options_from=0) == ["the comparator of a.crd is not that of b.crd"]
    other = replace(block, reduction=replace(block.reduction, ground_height=30.0))
    second = extracted(other, photos(other, "23")).block
    assert complaints(first, second) == ["the reduction of a.crd is not that of b.crd"]
    assert merge(first, second, options_from=1).block.reduction.ground_height == 30.0
    other = replace(block, lenses=replace(block.lenses, k0=np.array([1e-5])))
    second = extracted(other, photos(other, "23")).block
    assert complaints(first, second)[0].startswith("camera RC8: linear distortion ")
    other = replace(block, options=replace(block.options, plate_sigma=0.007))
    second = extracted(other, photos(other, "23")).block
    told = complaints(first, second, options_from=0)
    assert told == ["option plate_sigma of raw plates is 0.005 in a.crd, 0.007 in b.crd"]


def test_readings_and_refined_coordinates_do_not_mix():
    block, plain = raw_block(), refined_block()
    first = extracted(block, photos(block, "21")).block
    second = extracted(plain, photos(plain, "23")).block
    assert "what plate cards give is readings (RAW) in a.crd, refined in b.crd" in complaints(first, second)


@pytest.mark.slow
@pytest.mark.parametrize("content", Content)
def test_refined_coordinates_are_punched(content):
    solution = adjust(raw_block())
    block, _ = punched(solution, Punch(content=content, plates=True))
    again = reread(block)
    assert not again.raw and again.comparator is None
    # the field holds seven decimals
    np.testing.assert_allclose(again.plates.xy, solution.block.plates.xy, rtol=0.0, atol=0.6e-7)
    if content is Content.RESTART:
        restarted = adjust(again)
        assert len(restarted.iterations) < len(solution.iterations)
        assert restarted.sigma0 == pytest.approx(solution.sigma0, abs=1e-6)  # 1e-7 mm of sigmas of 5e-3 mm
