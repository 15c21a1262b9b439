"""Unknown waves on the cards of a deck: what they mean to the adjustment, what is punched, and the truth."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import musatpy
from altered import altered, with_options
from musatpy.adjustment.wavy_water import Sea, sea_of
from musatpy.errors import AdjustmentError
from musatpy.formats import musat
from musatpy.jobs.punch import Content, Punch, punched
from musatpy.listings import compare_texts, parse_rules
from musatpy.model import Datum, Editing, Solution, WaveOrigin, Waves
from musatpy.model.tables import empty
from musatpy.model.water import WAVE_SIGMAS
from musatpy.refraction.waves import LENGTH, sinusoidal
from musatpy.reports.record import dumps, record
from musatpy.sea.theory import linear_wave
from musatpy.simulation import simulate
from musatpy.simulation.simulation_spec import load_spec
from musatpy.units import DEGREE
from record_rows import with_rows
from wave_strip import FOLDER

DECK = FOLDER / "unknown.crd"
TRUTH = np.array([1.05, 92.3, 52.0 * DEGREE, 8.0])  # of fixtures/waves/unknown.toml
SIGMA = np.array([[0.4, 5.0, 4.0 * DEGREE, 9.0]])


@lru_cache
def solved() -> Solution:
    return musatpy.adjust(musat.read_deck(DECK))


def test_the_fixture_is_what_its_spec_makes() -> None:
    assert musat.deck_bytes(simulate(load_spec(FOLDER / "unknown.toml")).block) == DECK.read_bytes()


@pytest.mark.slow
def test_the_waves_of_the_deck_are_found() -> None:
    waves = solved().water.waves
    assert waves.ids.tolist() == ["SW"] and set(waves.verdicts.ravel()) == {"determined"}
    assert (np.abs(waves.value[0] - TRUTH) < 3.0 * waves.sigma[0]).all()
    assert (np.abs(waves.prior[0] - TRUTH) > 5.0 * waves.sigma[0]).all()  # what the card says is wrong by as much
    truth = json.loads((FOLDER / "unknown.truth.json").read_text())["points"]
    ids, wet = solved().block.points.ids, solved().block.points.bathymetric

    def heights(solution: Solution) -> float:
        true = np.array([truth[name]["position"][2] for name in ids[wet].tolist()])
        return float(np.sqrt(np.mean(np.square(solution.points.position[wet, 2] - true))))

    block = musat.read_deck(DECK)
    as_on_card = replace(block.waves, **{name: [np.nan] for name in WAVE_SIGMAS})
    assert heights(solved()) < 0.12  # 0.08 m; sigmas of the heights are about that
    assert heights(musatpy.adjust(replace(block, waves=as_on_card))) > 0.25  # 0.3 m with the card taken for true


@pytest.mark.slow
def test_cards_and_library_ask_for_the_same() -> None:
    block = musat.read_deck(DECK)
    card = sinusoidal(amplitude=0.375, length=96.3, azimuth=(90.0 - 55.5) * DEGREE, crest=1.0)
    k = 2.0 * np.pi / 96.3
    card = replace(card, frequency=np.sqrt([9.80665 * k * np.tanh(k * 10.0)]))  # dispersion, as the card leaves it
    sea = Sea(
        surface=card, time=block.photos.time, origin=np.array(block.wave_origin.position), sigma=SIGMA, depth=10.0
    )
    found = musatpy.adjust(replace(block, waves=empty(Waves), wave_origin=None), sea=sea)
    np.testing.assert_allclose(
        found.water.waves.value, solved().water.waves.value, atol=1e-7
    )  # where iterations stop
    np.testing.assert_allclose(found.points.position, solved().points.position, atol=1e-7)
    assert found.water.waves.ids.tolist() == ["1"]


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ({"length": [96.3]}, None),
        ({"period": [10.0], "length": [np.nan]}, "period"),
        ({"period": [10.0]}, "period"),
        ({"speed": [9.5]}, "speed"),
    ],
)
def test_what_the_card_gives_beside_the_length_stays(given: dict[str, list[float]], kept: str | None) -> None:
    """Period or speed; with neither, the speed follows the length by theory."""
    block = musat.read_deck(DECK)
    trains = sea_of(replace(block, waves=replace(block.waves, **given)), None).trains
    longer = trains.values.copy()
    longer[:, LENGTH] *= 1.1
    moved = trains.with_values(longer)
    periods = [float((one.values[:, LENGTH] / one.speed)[0]) for one in (trains, moved)]
    if kept == "period":
        assert periods == pytest.approx([10.0, 10.0], rel=1e-12)  # rounding
    elif kept == "speed":
        assert [trains.speed[0], moved.speed[0]] == pytest.approx([9.5, 9.5], rel=1e-12)
    else:
        theory = linear_wave(periods[1], 10.0)
        assert float(theory.length) == pytest.approx(float(longer[0, LENGTH]), rel=1e-9)  # its own iteration


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"datum": Datum.FREE}, "a free network and they exclude each other"),
        ({"editing": Editing.LIST}, "unknown waves and the search for blunders exclude each other"),
    ],
)
def test_what_excludes_unknown_waves_is_said(changes: dict[str, object], message: str) -> None:
    with pytest.raises(AdjustmentError, match=message):
        musatpy.adjust(with_options(musat.read_deck(DECK), **changes))


def test_unknown_waves_are_sinusoidal() -> None:
    block = musat.read_deck(DECK)
    with pytest.raises(AdjustmentError, match="all of them are sinusoidal; SW is of shape STOK"):
        musatpy.adjust(altered(block, waves={"shape": ["STOK"]}))


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
    given = musat.read_deck(DECK).waves
    for name in ("height", "length", "azimuth", "crest", *WAVE_SIGMAS):
        np.testing.assert_array_equal(getattr(restart.waves, name), getattr(given, name))


@pytest.mark.slow
def test_an_origin_far_off_leaves_the_same_waves() -> None:
    """3 km along the waves: the sigma of the azimuth now moves crests by more, and all of that is searched."""
    block = musat.read_deck(DECK)
    direction = np.array([np.sin(55.5 * DEGREE), np.cos(55.5 * DEGREE), 0.0])
    place = np.array(block.wave_origin.position) - 3000.0 * direction
    far = altered(
        block, waves={"crest": [1.0 + 3000.0 - 31 * 96.3]}, wave_origin=WaveOrigin(position=tuple(place.tolist()))
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
    block, _ = musat.check_deck(DECK.read_bytes().replace(b"-85.6243490", b"  0        "))
    solution = musatpy.adjust(block)
    assert "more than waves could explain" in solution.reason
    assert len(solution.iterations) <= block.options.max_iterations


def test_points_behind_cameras_before_waves_are_set_free_end_the_run() -> None:
    text = DECK.read_bytes().replace(b"6938.8501", b"6938850.1")
    text = text.replace(b"-85.5708860 -84.8290680", b"-84.8290680 -85.5708860")
    block, _ = musat.check_deck(text)
    assert musatpy.adjust(block).reason.startswith("points stay behind their cameras: photo 2 still moves")
