"""What is in a deck, counted the slow way."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from formats.random_blocks import random_block
from jobs.decks import cayman, photos, rich, st_thomas
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import extracted
from musatpy.jobs.merge import merged
from musatpy.jobs.naming import Kind, prefixed, renamed
from musatpy.jobs.summary import rays_histogram, summary
from musatpy.model import Block, CoordinateSystem, SystemSpec
from musatpy.reports.job_list import list_record, list_text
from raw_plates import raw_block

BOTH = (Kind.PHOTO, Kind.POINT)


def points_of(block: Block, *, flagged: bool) -> list[set[int]]:
    """The points on each photo, those flagged N too or not."""
    plates = block.plates
    rows = np.ones(len(plates.photo), dtype=bool) if flagged else plates.triangulated
    return [set(plates.point[rows & (plates.photo == photo)].tolist()) for photo in range(len(block.photos.ids))]


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_ties_and_parts(seed: int) -> None:
    block = random_block(seed, CoordinateSystem.LOCAL)
    on = points_of(block, flagged=False)
    common = {(a, b): len(on[a] & on[b]) for a, b in combinations(range(len(on)), 2) if on[a] & on[b]}
    found = summary(once_each(block), few=3)
    pairs = found.pairs
    assert (
        dict(zip(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True), pairs.points, strict=True))
        == common
    )
    for part, least in ((found.part, 1), (found.strong_part, 3)):
        ties = [pair for pair, count in common.items() if count >= least]
        rows, columns = zip(*ties, strict=True) if ties else ((), ())
        graph = coo_matrix((np.ones(len(ties)), (rows, columns)), shape=(len(on), len(on)))
        assert part.tolist() == connected_components(graph, directed=False)[1].tolist()


def once_each(block: Block) -> Block:
    """The block with the first measurement of each point on each photo, as a deck has to have it."""
    plates = block.plates
    best: dict[tuple[int, int], int] = {}
    for row, key in enumerate(zip(plates.photo.tolist(), plates.point.tolist(), strict=True)):
        if key not in best or (plates.triangulated[row] and not plates.triangulated[best[key]]):
            best[key] = row
    rows = np.array(sorted(best.values()))
    return replace(
        block,
        plates=replace(
            plates,
            photo=plates.photo[rows],
            point=plates.point[rows],
            xy=plates.xy[rows],
            sigma=plates.sigma[rows],
            triangulated=plates.triangulated[rows],
        ),
    )


@pytest.mark.parametrize("seed", range(5))
def test_rays(seed: int) -> None:
    block = once_each(random_block(seed, CoordinateSystem.GEOGRAPHIC))
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


def two_parts() -> Block:
    block = st_thomas()
    other = renamed(block, {kind: prefixed(block, kind, "X", {}) for kind in BOTH}, "b")
    return merged([Part(name="a", block=block), Part(name="b", block=other)]).block


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
    assert lines[0].startswith("MUSAT  job.crd") and lines[0].endswith("PAGE     1")
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
    copies = [
        Part(
            name=name,
            block=renamed(
                block, {kind: prefixed(block, kind, name, {}) for kind in (Kind.PHOTO, Kind.POINT)}, name
            ),
        )
        for name in "ABC"
    ]
    found = summary(merged(copies).block)
    text = list_text(found, "many.crd")
    assert "A838\n    A837 (18)  A839 (19)  A840 (4)\n" in text
    assert "3 parts" in text
