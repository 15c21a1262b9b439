"""Decks read for editing, summaries of jobs, and decks of raw readings cut out and merged."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from altered import altered
from formats.deck_edits import GOOD, deck
from formats.deck_edits import replace as with_text
from jobs.decks import cards, cayman, complaints, merge, photos, reread, rich, st_thomas
from musatpy import adjust, model
from musatpy.errors import DeckError
from musatpy.formats.musat import check_deck
from musatpy.geometry.areas import Area
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import extracted, photos_showing
from musatpy.jobs.merge import merged
from musatpy.jobs.naming import NamedKind, prefixed, renamed
from musatpy.jobs.punch import Content, Punch, punched
from musatpy.jobs.summary import rays_histogram, summary
from musatpy.model import Block, SystemSpec
from musatpy.model.tables import taken
from musatpy.reports.jobs import list_record, list_text
from raw_plates import crosses, distances, raw_block, refined_block, reseau


def without(*mnemonics: str) -> bytes:
    return deck(lines=[line for line in GOOD if line[:3] not in mnemonics])


@pytest.mark.parametrize("mnemonics", [("CTG", "BAS", "EQL"), ("PLT", "EQL")], ids=["control", "measurements"])
def test_a_deck_may_lack_control_or_measurements(mnemonics: tuple[str, ...]) -> None:
    data = without(*mnemonics)
    assert check_deck(data)[0] is None
    block, problems = check_deck(data, for_run=False)
    assert block is not None
    assert all(problem.severity == "warning" for problem in problems)


@pytest.mark.parametrize(
    "data", [without("CAM"), without("ATT"), without("ELL"), deck(with_text(6, "STA 841", "STA 842"))]
)
def test_a_deck_may_not_contradict_itself(data: bytes) -> None:
    assert check_deck(data, for_run=False)[0] is None


def points_of(block: Block, *, flagged: bool) -> list[set[int]]:
    """The points on each photo, those flagged N too or not."""
    plates = block.plates
    rows = np.ones(len(plates.photo), dtype=bool) if flagged else plates.triangulated
    return [set(plates.point[rows & (plates.photo == photo)].tolist()) for photo in range(len(block.photos.ids))]


def two_parts() -> Block:
    block = st_thomas()
    return merged([Part(name="a", block=block), Part(name="b", block=copied(block, "X"))]).block


def copied(block: Block, prefix: str) -> Block:
    """The block with a prefix before the names of its photos and points."""
    return renamed(
        block, {kind: prefixed(block, kind, prefix, {}) for kind in (NamedKind.PHOTO, NamedKind.POINT)}, prefix
    )


def flagged() -> Block:
    """The strip, of whose measurements every third is kept out."""
    return altered(cayman(), plates={"triangulated": lambda kept: np.arange(len(kept)) % 3 > 0})


DECKS = pytest.mark.parametrize("make", [rich, cayman, flagged, two_parts])


@DECKS
def test_ties_and_parts(make: Callable[[], Block]) -> None:
    block = make()
    on = points_of(block, flagged=False)
    common = {(a, b): len(on[a] & on[b]) for a, b in combinations(range(len(on)), 2) if on[a] & on[b]}
    found = summary(block, few=9)
    pairs = found.pairs
    assert (
        dict(zip(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True), pairs.points, strict=True))
        == common
    )
    for part, least in ((found.part, 1), (found.strong_part, 9)):
        ties = [pair for pair, count in common.items() if count >= least]
        rows, columns = zip(*ties, strict=True) if ties else ((), ())
        graph = coo_matrix((np.ones(len(ties)), (rows, columns)), shape=(len(on), len(on)))
        assert part.tolist() == connected_components(graph, directed=False)[1].tolist()


@DECKS
def test_rays(make: Callable[[], Block]) -> None:
    block = make()
    found, plates = summary(block), block.plates
    kind = dict(zip(block.control.point.tolist(), block.control.kind.tolist(), strict=True))
    rays = Counter(plates.point.tolist())
    for photo, points in enumerate(points_of(block, flagged=True)):
        counts = found.photos
        assert counts.rays[photo] == len(points)
        assert counts.submerged[photo] == sum(block.points.bathymetric[point] for point in points)
        assert counts.land[photo] == counts.rays[photo] - counts.submerged[photo]
        assert counts.single[photo] == sum(rays[point] == 1 for point in points)
        assert counts.control[photo].tolist() == [sum(kind.get(p) == k for p in points) for k in range(4)]
    assert found.points.rays.tolist() == [rays[point] for point in range(len(block.points.ids))]
    histogram = rays_histogram(found)
    assert histogram["points"].tolist() == [
        sum(rays[p] == r for p in range(len(block.points.ids))) for r in range(max(rays.values()) + 1)
    ]
    assert (histogram["land"] + histogram["submerged"] == histogram["points"]).all()


def test_cayman() -> None:
    found = summary(cayman())
    assert found.photos.with_next.tolist() == [18, 19, 13, 12, 13, 13, 11, 18, 21, 0]
    assert found.photos.kept_out.sum() == 9
    assert [len(part) for part in found.parts] == [len(part) for part in found.strong_parts] == [10]
    assert found.gaps.size == 0
    assert rays_histogram(found)["points"].tolist() == [0, 0, 53, 45]
    assert [part.tolist() for part in summary(cayman(), few=12).strong_parts] == [
        ["837", "838", "839", "840", "841", "842", "843"],
        ["844", "845", "846"],
    ]


def test_parts_that_nothing_ties_and_the_gap_between() -> None:
    found = summary(two_parts())
    assert [part.tolist() for part in found.parts] == [["21", "22", "23"], ["X21", "X22", "X23"]]
    assert found.gaps.tolist() == [2]
    text = list_text(found, "two.crd")
    assert "2 parts that hang together by a point in common or more:" in text
    assert "    23-X21 (0)" in text


def test_pages_and_record_say_the_same() -> None:
    block = rich()
    block = replace(block, plates=replace(block.plates, triangulated=np.arange(48) != 3))
    found = summary(extracted(block, photos(block, "21", "22")).block)
    text, record = list_text(found, "job.crd"), list_record(found, "job.crd")
    lines = text.splitlines()
    assert all(len(line) <= 132 for line in lines)
    assert lines[0].startswith("MUSAT  job.crd") and lines[0].endswith("PAGE      1")
    row = next(line for line in lines if line.startswith("21 "))
    photo = record["photos"][0]
    wanted = [photo[key] for key in ("rays", "land", "submerged", "flagged_n")]
    assert [int(word) for word in row.split()[2:6]] == wanted == [13, 9, 4, 1]
    assert photo["with_next"] == 12  # 13, less the one that is flagged
    assert "    204 on 21" in text
    alone = [one["point"] for one in record["points"] if one["rays"] == 1 and not one["control"]]
    assert all(f"{name} on 22" in text for name in alone if name != "208") and len(alone) > 3
    assert record["parts"] == [["21", "22"]]
    assert record["overlaps"] == [{"first": "21", "second": "22", "points": 12}]
    assert photo["position_sigma"] == [0.5, 0.5, 0.8]


def test_other_systems_and_readings_are_told() -> None:
    given = SystemSpec(kind="PROJ", definition="EPSG:3992", geoid="level.gtx")
    found = summary(replace(raw_block(), given_in=given, stated_in=SystemSpec(kind="GEOC")))
    lines = [line.replace(" ..", "..").rstrip() for line in list_text(found, "job.crd").splitlines()]
    told = {line.split(".", 1)[0]: line.split(".. ", 1)[1] for line in lines if ".. " in line}
    expected = {
        "deck stated in": "PROJ EPSG:3992 above level.gtx",
        "answer stated in": "GEOC",
        "plate measurements are": "comparator readings",
    }
    assert {name: told[name] for name in expected} == expected
    assert list_record(found, "job.crd")["stated"] == expected
    assert list_record(summary(st_thomas()), "job.crd")["stated"] == {}


def test_a_job_of_many_photos_lists_neighbours_in_place_of_a_matrix() -> None:
    block = cayman()
    found = summary(merged([Part(name=name, block=copied(block, name)) for name in "ABC"]).block)
    text = list_text(found, "many.crd")
    assert "A838\n    A837 (18)  A839 (19)  A840 (4)\n" in text
    assert "3 parts" in text


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
    counts = {"RSC": 49, "RSM": 98, "FDS": 4, "LNS": 1, "DST": 5, "FMS": 32, "CMP": 1, "RED": 1}
    for kind, count in counts.items():
        own = {line for line in kept if line[:3] == kind}
        assert own <= set(text) and len(own) == count, kind
    again = reread(part)
    assert again.photos.ids.tolist() == ["22", "23"]


def test_a_point_that_is_read_twice_on_one_photo_is_single():
    block = raw()
    row = next(row for row, point in enumerate(block.plates.point) if block.points.ids[point] == "212")
    twice = replace(block, plates=taken(block.plates, np.append(np.arange(len(block.plates.photo)), row)))
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
