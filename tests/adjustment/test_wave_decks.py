"""Strips through waves by their decks: known waves, and unknown ones that are found."""

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import musatpy
from altered import altered, with_options
from blocks import converged
from musatpy import model
from musatpy.adjustment.wavy_water import Sea, sea_of
from musatpy.errors import AdjustmentError
from musatpy.formats import musat
from musatpy.jobs.punch import Content, Punch, punched
from musatpy.listings import compare_texts, parse_rules
from musatpy.model.tables import empty
from musatpy.model.water import WAVE_SIGMAS
from musatpy.refraction.waves import LENGTH, sinusoidal
from musatpy.reports.record import dumps, record
from musatpy.sea.theory import linear_wave
from musatpy.simulation import simulate
from musatpy.simulation.simulation_spec import load_spec
from musatpy.units import DEGREE, AngleUnit
from record_rows import with_rows
from reference import compare
from wave_strip import FOLDER, strip, true_waves, truth_text

DECK = FOLDER / "strip.crd"
UTM = "+proj=utm +zone=17 +ellps=clrk66"


@lru_cache
def truth() -> dict[str, np.ndarray]:
    """Return the true places of the points of the fixture: latitude, longitude (rad), height (m)."""
    lines = (FOLDER / "strip.truth.csv").read_text().splitlines()[1:]
    rows = (line.split(",") for line in lines)
    return {name: np.array([*map(float, place)]) * [DEGREE, DEGREE, 1.0] for name, *place in rows}


def height_errors(solution: model.Solution) -> np.ndarray:
    """Return adjusted minus true heights (k,) of the submerged points that were found."""
    block = solution.block
    rows = np.flatnonzero(block.points.bathymetric & np.isfinite(solution.points.position).all(axis=1))
    return solution.points.position[rows, 2] - [truth()[name][2] for name in block.points.ids[rows]]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_fixture_is_what_its_script_makes() -> None:
    block, true = strip(model.CoordinateSystem.GEOGRAPHIC, 0.003)
    assert musat.deck_bytes(block) == DECK.read_bytes()
    assert truth_text(block, true) == (FOLDER / "strip.truth.csv").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("program", list(model.Program))
@pytest.mark.parametrize("system", list(model.CoordinateSystem))
def test_the_truth_is_found_through_the_waves_of_the_cards(
    system: model.CoordinateSystem, program: model.Program
) -> None:
    block, true = strip(system)
    solution = converged(block, program=program)
    # rounding; on the ellipsoid the axes of the waves turn with the vertical, which the images do not know: 1e-5 m
    tolerance = 1e-9 if system is model.CoordinateSystem.LOCAL else 1e-4
    found = compare.enu_difference(block, solution.points.position, true)
    assert np.abs(found).max() < tolerance


@pytest.mark.slow
def test_without_its_waves_the_strip_is_wrong_by_decimetres() -> None:
    block = musat.read_deck(DECK)
    through = musatpy.adjust(block)
    level = musatpy.adjust(replace(block, waves=empty(model.Waves), wave_origin=None))
    errors = height_errors(through)
    sigma = np.sqrt(through.points.covariance[through.block.points.bathymetric, 2, 2])
    # of 11 points with a few redundant rays each: as large as their sigmas, within a factor
    assert 0.3 < rms(errors / sigma) < 1.7
    assert rms(errors) < 0.15 and rms(height_errors(level)) > 0.4  # 0.12 and 0.49 m
    assert level.sigma0 > 1.5 * through.sigma0  # the images themselves tell that the water was not level


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "card"),
    [
        (model.SystemSpec(kind="PROJ", definition=UTM, axes="GRID", angles="POK"), "WOX"),
        (model.SystemSpec(kind="GEOC", axes="GEOC", angles="MATR"), "WOX"),
        (model.SystemSpec(kind="GEOG", unit=AngleUnit.DEGREES), "WOD"),
        (None, "WOG"),
    ],
)
def test_a_deck_in_other_words_gives_the_same_answer(spec: model.SystemSpec | None, card: str) -> None:
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


@pytest.mark.slow
def test_a_blunder_is_found_through_waves() -> None:
    """Of 0.2 mm in a submerged point on three photos; with level water waves would drown it."""
    block = musat.read_deck(DECK)
    rays = np.bincount(block.plates.point[block.plates.triangulated], minlength=len(block.points.ids))
    point = int(np.flatnonzero(block.points.bathymetric & (rays >= 3))[0])
    row = int(np.flatnonzero(block.plates.point == point)[1])
    xy = np.array(block.plates.xy)
    xy[row, 1] += 0.2
    spoiled = with_options(altered(block, plates={"xy": xy}), editing=model.Editing.EDIT)
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
        (
            {"options": lambda one: replace(one, program=model.Program.IIA, refraction=model.Refraction.NONE)},
            "RIGOROUS",
        ),
        ({"options": lambda one: replace(one, water_tilt=model.Treatment.ADJUST)}, "cannot be combined with"),
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
    with pytest.raises(AdjustmentError, match="the cards of the job have waves, but other waves are given too"):
        musatpy.adjust(block, sea=sea)


UNKNOWN = FOLDER / "unknown.crd"
TRUTH = np.array([1.05, 92.3, 52.0 * DEGREE, 8.0])  # of fixtures/waves/unknown.toml
SIGMA = np.array([[0.4, 5.0, 4.0 * DEGREE, 9.0]])


@lru_cache
def solved() -> model.Solution:
    return musatpy.adjust(musat.read_deck(UNKNOWN))


def test_the_fixture_is_what_its_spec_makes() -> None:
    assert musat.deck_bytes(simulate(load_spec(FOLDER / "unknown.toml")).block) == UNKNOWN.read_bytes()


@pytest.mark.slow
def test_the_waves_of_the_deck_are_found() -> None:
    waves = solved().water.waves
    assert waves.ids.tolist() == ["SW"] and set(waves.verdicts.ravel()) == {"determined"}
    assert (np.abs(waves.value[0] - TRUTH) < 3.0 * waves.sigma[0]).all()
    assert (np.abs(waves.prior[0] - TRUTH) > 5.0 * waves.sigma[0]).all()  # what the card says is wrong by as much
    truth = json.loads((FOLDER / "unknown.truth.json").read_text())["points"]
    ids, wet = solved().block.points.ids, solved().block.points.bathymetric

    def heights(solution: model.Solution) -> float:
        true = np.array([truth[name]["position"][2] for name in ids[wet].tolist()])
        return float(np.sqrt(np.mean(np.square(solution.points.position[wet, 2] - true))))

    block = musat.read_deck(UNKNOWN)
    as_on_card = replace(block.waves, **{name: [np.nan] for name in WAVE_SIGMAS})
    assert heights(solved()) < 0.12  # 0.08 m; sigmas of the heights are about that
    assert heights(musatpy.adjust(replace(block, waves=as_on_card))) > 0.25  # 0.3 m with the card taken for true


@pytest.mark.slow
def test_cards_and_library_ask_for_the_same() -> None:
    block = musat.read_deck(UNKNOWN)
    card = sinusoidal(amplitude=0.375, length=96.3, azimuth=(90.0 - 55.5) * DEGREE, crest=1.0)
    k = 2.0 * np.pi / 96.3
    card = replace(card, frequency=np.sqrt([9.80665 * k * np.tanh(k * 10.0)]))  # dispersion, as the card leaves it
    sea = Sea(
        surface=card, time=block.photos.time, origin=np.array(block.wave_origin.position), sigma=SIGMA, depth=10.0
    )
    found = musatpy.adjust(replace(block, waves=empty(model.Waves), wave_origin=None), sea=sea)
    np.testing.assert_allclose(
        found.water.waves.value, solved().water.waves.value, atol=1e-7
    )  # where iterations stop
    np.testing.assert_allclose(found.points.position, solved().points.position, atol=1e-7)
    assert found.water.waves.ids.tolist() == ["1"]


@pytest.mark.parametrize(
    ("given", "kept", "value"),
    [
        ({"length": [96.3]}, "by theory", np.nan),
        ({"period": [10.0], "length": [np.nan]}, "period", 10.0),
        ({"period": [10.0]}, "period", 10.0),
        ({"speed": [9.5]}, "speed", 9.5),
    ],
)
def test_what_the_card_gives_beside_the_length_stays(
    given: dict[str, list[float]], kept: str, value: float
) -> None:
    """Period or speed; with neither, the speed follows the length by theory."""
    trains = sea_of(altered(musat.read_deck(UNKNOWN), waves=given), None).trains
    longer = trains.with_values(trains.values * [1.0, 1.1, 1.0, 1.0])
    for one in (trains, longer):
        length, speed = float(one.values[0, LENGTH]), float(one.speed[0])
        said = {"period": length / speed, "speed": speed}
        theory = float(linear_wave(length / speed, 10.0).length)
        assert said[kept] == pytest.approx(value, rel=1e-12) if kept in said else theory == pytest.approx(length)


def test_a_result_has_the_adjusted_waves_and_a_restart_those_of_the_deck() -> None:
    waves = solved().water.waves
    result, _ = punched(solved(), Punch(content=Content.RESULT, plates=True))
    again = musat.read_deck(musat.deck_bytes(result)).waves
    for column, name in enumerate(("height", "length", "azimuth", "crest")):
        unit = DEGREE if name == "azimuth" else 1.0
        for got, want in ((getattr(again, name), waves.value), (getattr(again, f"{name}_sigma"), waves.sigma)):
            assert got[0] == pytest.approx(want[0, column], abs=5.1e-4 * unit)  # half a last decimal of the card
    assert np.isnan(again.period[0]) and np.isnan(again.speed[0])
    without, _ = punched(solved(), Punch(content=Content.RESULT, sigmas=False))
    assert np.isnan([getattr(without.waves, name)[0] for name in WAVE_SIGMAS]).all()
    restart, _ = punched(solved(), Punch())
    given = musat.read_deck(UNKNOWN).waves
    for name in ("height", "length", "azimuth", "crest", *WAVE_SIGMAS):
        np.testing.assert_array_equal(getattr(restart.waves, name), getattr(given, name))


@pytest.mark.slow
def test_an_origin_far_off_leaves_the_same_waves() -> None:
    """3 km along the waves: the sigma of the azimuth now moves crests by more, and all of that is searched."""
    block = musat.read_deck(UNKNOWN)
    direction = np.array([np.sin(55.5 * DEGREE), np.cos(55.5 * DEGREE), 0.0])
    place = np.array(block.wave_origin.position) - 3000.0 * direction
    far = altered(
        block,
        waves={"crest": [1.0 + 3000.0 - 31 * 96.3]},
        wave_origin=model.WaveOrigin(position=tuple(place.tolist())),
    )
    found = musatpy.adjust(far)
    assert found.water.waves.open[0] > 0.5 and found.water.waves.searched.all()
    # the crest that is given 3 km off, good to 9 m, pulls at length and azimuth by what that leaves of a length
    wet = block.points.bathymetric
    off = (found.points.position - solved().points.position)[wet]
    assert np.abs(off / np.sqrt(np.einsum("pii->pi", solved().points.covariance))[wet]).max() < 2.0
    for solution in (found, solved()):
        assert not any("crests" in warning for warning in solution.warnings)


def test_listing_and_record_say_the_same() -> None:
    text = musatpy.listing(solved())
    for title in ("Adjusted Waves", "How Well The Waves Are Known", "Correlations Of The Waves"):
        assert f"Water: {title}" in text
    assert "wave SW azimuth" in text
    kept = record(solved())
    rows = {row["parameter"]: row for row in with_rows(kept)["adjusted_water"]["waves"]["parameters"]}
    assert rows["height"]["given"] == pytest.approx(0.75) and rows["height"]["verdict"] == "determined"
    assert kept["waves"]["height_sigma"][0] == 0.4
    assert compare_texts(text, dumps(kept), parse_rules(""), ("a.lst", "a.json")).same


@pytest.mark.slow
def test_waves_are_not_set_free_where_no_waves_could_explain_the_images() -> None:
    block, _ = musat.check_deck(UNKNOWN.read_bytes().replace(b"-85.6243490", b"  0        "))
    solution = musatpy.adjust(block)
    assert "more than waves could explain" in solution.reason
    assert len(solution.iterations) <= block.options.max_iterations


def test_points_behind_cameras_before_waves_are_set_free_end_the_run() -> None:
    text = UNKNOWN.read_bytes().replace(b"6938.8501", b"6938850.1")
    text = text.replace(b"-85.5708860 -84.8290680", b"-84.8290680 -85.5708860")
    block, _ = musat.check_deck(text)
    assert musatpy.adjust(block).reason.startswith("points stay behind their cameras: photo 2 still moves")
