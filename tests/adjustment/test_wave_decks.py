"""Waves on the cards of a deck: the adjustments go through them, and find what is true."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import musatpy
from altered import altered, with_options
from musatpy.adjustment.wavy_water import Sea
from musatpy.errors import AdjustmentError
from musatpy.formats import musat
from musatpy.model import (
    CoordinateSystem,
    Editing,
    Program,
    Refraction,
    Solution,
    SystemSpec,
    Treatment,
    WaveOrigin,
    Waves,
)
from musatpy.model.tables import empty, taken
from musatpy.statistics import Statistics
from musatpy.units import DEGREE, AngleUnit
from reference import compare
from wave_strip import CREST, FOLDER, strip, true_waves, truth_text

DECK = FOLDER / "strip.crd"
UTM = "+proj=utm +zone=17 +ellps=clrk66"


@lru_cache
def truth() -> dict[str, np.ndarray]:
    """Return the true places of the points of the fixture: latitude, longitude (rad), height (m)."""
    lines = (FOLDER / "strip.truth.csv").read_text().splitlines()[1:]
    rows = (line.split(",") for line in lines)
    return {name: np.array([*map(float, place)]) * [DEGREE, DEGREE, 1.0] for name, *place in rows}


def height_errors(solution: Solution) -> np.ndarray:
    """Return adjusted minus true heights (k,) of the submerged points that were found."""
    block = solution.block
    rows = np.flatnonzero(block.points.bathymetric & np.isfinite(solution.points.position).all(axis=1))
    return solution.points.position[rows, 2] - [truth()[name][2] for name in block.points.ids[rows]]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_fixture_is_what_its_script_makes() -> None:
    block, true = strip(CoordinateSystem.GEOGRAPHIC, 0.003)
    assert musat.deck_bytes(block) == DECK.read_bytes()
    assert truth_text(block, true) == (FOLDER / "strip.truth.csv").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("program", list(Program))
@pytest.mark.parametrize("system", list(CoordinateSystem))
def test_the_truth_is_found_through_the_waves_of_the_cards(system: CoordinateSystem, program: Program) -> None:
    block, true = strip(system)
    solution = musatpy.adjust(with_options(block, program=program))
    assert solution.converged, solution.reason
    # rounding; on the ellipsoid the axes of the waves turn with the vertical, which the images do not know: 1e-5 m
    tolerance = 1e-9 if system is CoordinateSystem.LOCAL else 1e-4
    found = compare.enu_difference(block, solution.points.position, true)
    assert np.abs(found).max() < tolerance


@pytest.mark.slow
def test_without_its_waves_the_strip_is_wrong_by_decimetres() -> None:
    block = musat.read_deck(DECK)
    through = musatpy.adjust(block)
    level = musatpy.adjust(replace(block, waves=empty(Waves), wave_origin=None))
    errors = height_errors(through)
    sigma = np.sqrt(through.points.covariance[through.block.points.bathymetric, 2, 2])
    # of 11 points with a few redundant rays each: as large as their sigmas, within a factor
    assert 0.3 < rms(errors / sigma) < 1.7
    assert rms(errors) < 0.15 and rms(height_errors(level)) > 0.4  # 0.12 and 0.49 m
    assert level.sigma0 > 1.5 * through.sigma0  # the images themselves tell that the water was not level


@pytest.mark.slow
def test_both_programs_find_the_same_through_waves() -> None:
    block = musat.read_deck(DECK)
    one, other = (musatpy.adjust(with_options(block, program=program)) for program in Program)
    moved = compare.enu_difference(block, one.points.position, other.points.position)
    assert np.abs(moved).max() < 1e-4  # where the iterations stop
    assert one.sigma0 == pytest.approx(other.sigma0, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "card"),
    [
        (SystemSpec(kind="PROJ", definition=UTM, axes="GRID", angles="POK"), "WOX"),
        (SystemSpec(kind="GEOC", axes="GEOC", angles="MATR"), "WOX"),
        (SystemSpec(kind="GEOG", unit=AngleUnit.DEGREES), "WOD"),
        (None, "WOG"),
    ],
)
def test_a_deck_in_other_words_gives_the_same_answer(spec: SystemSpec | None, card: str) -> None:
    block = musat.read_deck(DECK)
    data = musat.deck_bytes(replace(block, given_in=spec))
    assert data.count(f"\n{card} ".encode()) == 1
    again = musat.read_deck(data)
    place, origin = (np.array([one.wave_origin.position]) for one in (again, block))
    assert np.abs(compare.enu_difference(block, place, origin)).max() < 5e-4  # half a last decimal of the card
    moved = musatpy.adjust(again).points.position, musatpy.adjust(block).points.position
    assert np.abs(compare.enu_difference(block, *moved)).max() < 5e-3  # cards round control and stations too
    cards = ([line for line in deck.splitlines() if line[:1] == b"W"] for deck in (data, musat.deck_bytes(again)))
    assert next(cards) == next(cards)


def test_cards_and_library_say_the_same_waves() -> None:
    block, _ = strip(CoordinateSystem.LOCAL)
    sea = Sea(surface=true_waves(), time=block.photos.time, origin=np.array(block.wave_origin.position))
    bare = replace(block, waves=empty(Waves), wave_origin=None)
    one, other = musatpy.adjust(block), musatpy.adjust(bare, sea=sea)
    np.testing.assert_allclose(one.points.position, other.points.position, atol=1e-9)  # rounding


@pytest.mark.slow
def test_a_blunder_is_found_through_waves() -> None:
    """Of 0.2 mm in a submerged point on three photos; with level water waves would drown it."""
    block = musat.read_deck(DECK)
    rays = np.bincount(block.plates.point[block.plates.triangulated], minlength=len(block.points.ids))
    point = int(np.flatnonzero(block.points.bathymetric & (rays >= 3))[0])
    row = int(np.flatnonzero(block.plates.point == point)[1])
    xy = np.array(block.plates.xy)
    xy[row, 1] += 0.2
    spoiled = with_options(altered(block, plates={"xy": xy}), editing=Editing.EDIT)
    solution = musatpy.adjust(spoiled)
    assert {(one.photo, one.point) for one in solution.findings if one.point} == {
        (str(block.photos.ids[block.plates.photo[row]]), str(block.points.ids[point]))
    }
    assert rms(height_errors(solution)) < 0.15  # 0.12 m with all images right


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wave_origin": lambda _: None}, "waves need the place from which their crests count"),
        ({"waves": lambda one: replace(one, height=[80.0, 0.3], shape=["STOK", ""])}, "too high for second-order"),
        ({"photos": lambda one: replace(one, time=[0.0, np.nan, 25.0, np.nan])}, "there is none of photo 838, 840"),
        ({"options": lambda one: replace(one, program=Program.IIA, refraction=Refraction.NONE)}, "RIGOROUS"),
        ({"options": lambda one: replace(one, water_tilt=Treatment.ADJUST)}, "exclude each other"),
    ],
)
def test_what_waves_cannot_be_adjusted_with_is_said(changes, message: str) -> None:
    block = musat.read_deck(DECK)
    spoiled = replace(block, **{name: change(getattr(block, name)) for name, change in changes.items()})
    with pytest.raises(AdjustmentError, match=message):
        musatpy.adjust(spoiled)


def test_waves_are_given_once() -> None:
    block = musat.read_deck(DECK)
    sea = Sea(surface=true_waves(), time=block.photos.time, origin=np.array(block.wave_origin.position))
    with pytest.raises(AdjustmentError, match="stand on the cards of the job, and others are given beside it"):
        musatpy.adjust(block, sea=sea)


@pytest.mark.slow
def test_where_crests_count_from_and_when_does_not_matter() -> None:
    """The origin moved along a wave's direction, or the clock put forward, with the crests to match."""
    block, _ = strip(CoordinateSystem.LOCAL)
    chop = taken(block.waves, np.array([1]))
    first = replace(block, waves=chop)
    direction = np.array([np.sin(chop.azimuth[0]), np.cos(chop.azimuth[0]), 0.0])
    place = np.array(block.wave_origin.position) + 40.0 * direction
    moved = replace(
        first, waves=replace(chop, crest=[CREST[1] - 40.0]), wave_origin=WaveOrigin(position=tuple(place.tolist()))
    )
    later = replace(
        first,
        photos=replace(block.photos, time=block.photos.time + 100.0),
        waves=replace(chop, crest=chop.crest - 100.0 * chop.speed),
    )
    want = musatpy.adjust(first).points.position
    for same in (moved, later):
        np.testing.assert_allclose(musatpy.adjust(same).points.position, want, atol=1e-8)  # rounding


def test_the_statistics_of_the_strip_are_those_of_its_noise() -> None:
    solution = musatpy.adjust(musat.read_deck(DECK))
    found = Statistics(solution).plates.total_rms[0] * 1e3
    assert 0.5 < solution.sigma0 < 1.3 and (found < 4.0).all()  # um; the noise is 3 um
