"""Conditions of the water, and waves on it: what a job makes of their cards, and keeps."""

import json
import re
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from adjustment.test_musat3a import sea_block
from altered import with_options
from jobs.decks import cayman, reread
from json_schema import load_schema, violations
from musatpy import model
from musatpy.formats import musat, parts
from musatpy.formats.cards.deck import write_cards
from musatpy.formats.cards.spec import card_formats_folder
from musatpy.formats.families import families
from musatpy.formats.job_tables import card_family
from musatpy.formats.refractive_index import index_of
from musatpy.jobs.agreement import Part, card_of, waves_of
from musatpy.jobs.extract import extracted, photos_named
from musatpy.jobs.merge import MergeOptions, merged
from musatpy.jobs.punch import PunchedPoints, restart, result
from musatpy.jobs.summary import summary
from musatpy.model import ControlKind, Treatment, Water, WaterConditions, Waves
from musatpy.model.tables import empty
from musatpy.pipeline import adjust
from musatpy.refraction import media
from musatpy.reports.jobs import list_text
from musatpy.reports.listing import listing
from musatpy.runs import run_deck
from musatpy.sea.deck_waves import wave_trains
from musatpy.units import DEGREE
from record_rows import read_rows, with_columns
from wave_strip import FOLDER, swell_length

DECK = FOLDER / "strip.crd"
SEA = WaterConditions(temperature=26.0, wavelength=480.0, chlorinity=19.2, air_temperature=28.0, air_pressure=1e5)
PURE = WaterConditions(temperature=35.0, wavelength=900.0, salinity=0.0, formula="IAPWS")


def waves() -> model.Block:
    return musat.read_deck(DECK)


def with_conditions(block: model.Block, conditions: WaterConditions, **more: float) -> model.Block:
    return replace(block, water=Water(index=index_of(conditions), conditions=conditions, **more))


def sea() -> model.Block:
    return with_conditions(cayman(), SEA)


def said(block: model.Block) -> list[object]:
    """Return what cards say of the water, waves as texts of their columns."""
    return [block.water, block.wave_origin, *(getattr(block.waves, field.name).tolist() for field in fields(Waves))]


def same(one: model.Block, other: model.Block) -> bool:
    return repr(said(one)) == repr(said(other))


def wave(**given: object) -> Waves:
    """Return one wave with nothing but what is given, and the rest of a wave."""
    nan = {field.name: [np.nan] for field in fields(Waves)}
    plain = {"ids": ["A"], "shape": [""], "height": [0.5], "azimuth": [0.0], "crest": [0.0]}
    return Waves(**{**nan, **plain, **{name: [value] for name, value in given.items()}})


def card(block: model.Block, mnemonic: str) -> str:
    """Return the one card of a deck, blank without."""
    return "".join(line for line in musat.deck_bytes(block).decode().splitlines() if line.startswith(mnemonic))


def ran(block: model.Block, folder: Path) -> Path:
    """Return the listing of a run, whose record is beside it."""
    musat.write_deck(block, folder / "job.crd")
    run_deck(folder / "job.crd", folder)
    assert max(len(line) for line in (folder / "job.lst").read_text().splitlines()) <= 132
    return folder / "job.lst"


# --- what the cards say ---


def test_the_index_is_that_of_the_library() -> None:
    salinity = media.salinity_of_chlorinity(19.2)
    air = media.relative_index(480.0, 26.0, salinity, air_temperature=28.0, air_pressure=1e5)
    assert index_of(SEA) == air
    assert index_of(PURE) == media.relative_index(900.0, 35.0, formula=media.Formula.IAPWS)
    # thinner air of 28 degrees and 1000 hPa has 0.0000160 less than standard air
    assert air - media.relative_index(480.0, 26.0, salinity) == pytest.approx(2.1e-5, abs=5e-6)


@pytest.mark.parametrize("conditions", [SEA, PURE])
def test_a_deck_keeps_what_was_given(conditions: WaterConditions) -> None:
    given = with_conditions(cayman(), conditions)
    assert reread(given).water == given.water
    assert not card(given, "WTR")  # nothing else is said of the water
    uncertain = with_conditions(cayman(), conditions, sigma=0.0005)
    assert reread(uncertain).water == uncertain.water
    assert card(uncertain, "WTR").startswith("WTR          0.000500 ")


def test_a_deck_with_waves_comes_back_byte_for_byte() -> None:
    assert musat.deck_bytes(waves()) == DECK.read_bytes()
    doubtful = replace(waves().waves, height_sigma=[0.1, np.nan], azimuth_sigma=[10.0 * DEGREE, np.nan])
    block = replace(waves(), waves=doubtful)
    assert card(block, "WVS").startswith("WVS SW                                          0.100   10.000 ")
    assert same(reread(block), block)


@pytest.mark.parametrize(
    "given",
    [
        {"period": 10.0, "depth": 12.0},
        {"length": 99.70724, "depth": 12.0},
        {"period": 10.0, "length": 99.70724},
        {"period": 10.0, "speed": 9.970724},
        {"length": 99.70724, "speed": 9.970724},
    ],
)
def test_two_of_period_length_and_speed_say_the_third(given: dict[str, float]) -> None:
    train = wave_trains(wave(**given))
    values = [float(column[0]) for column in (train.period, train.length, train.speed)]
    assert values == pytest.approx([10.0, 99.70724, 9.970724], rel=1e-6)  # the digits of the length


# --- what jobs keep ---


@pytest.mark.parametrize("names", [("wtc",), ("wav", "wvs", "wog", "wod", "wox")])
def test_a_family_without_these_cards_reads_its_decks(tmp_path: Path, names: tuple[str, ...]) -> None:
    """It says the index that conditions give, six decimals of its field, and no waves."""
    folder = Path(shutil.copytree(card_formats_folder() / "musat", tmp_path / "cards"))
    for name in names:
        (folder / f"{name}.toml").unlink()
    block, family = sea() if names == ("wtc",) else waves(), card_family(folder)
    for deck in (musat.deck_bytes(block, family), write_cards(parts.cards_of_parts(parts.parts_of(block), family))):
        plain = musat.read_deck(deck, family)
        assert plain.water == replace(
            block.water, index=pytest.approx(block.water.index, abs=5e-7), conditions=None
        )
        assert not len(plain.waves.ids) and plain.wave_origin is None
    native = write_cards(parts.cards_of_parts(parts.parts_of(block), card_family()))
    assert native == musat.deck_bytes(block)
    assert same(parts.block_of(parts.parts_of(block)), block)


def test_another_agency_says_what_it_cannot_hold() -> None:
    left = families()["bingo"].render(parts.parts_of(waves()), Path("x"), "x").left_out
    assert {"bingo holds no waves: 2 left out", "bingo holds no wave origin: 1 left out"} <= set(left)


@pytest.mark.parametrize(
    ("make", "ends"), [(sea, ("837-842", "841-846")), (waves, ("837-838", "839-840"))], ids=["conditions", "waves"]
)
def test_extract_and_merge_keep_them(make, ends: tuple[str, str]) -> None:
    block = make()
    west, east = (extracted(block, photos_named(block, [names])).block for names in ends)
    assert same(reread(west), block) and same(reread(east), block)
    np.testing.assert_array_equal(east.photos.time, block.photos.time[-len(east.photos.ids) :])
    jobs = [Part(name="west", block=west), Part(name="east", block=east)]
    assert same(merged(jobs, MergeOptions(join_photos=True, prefer=1)).block, block)


def test_other_waters_and_waves_do_not_agree() -> None:
    jobs = [Part(name=name, block=with_conditions(cayman(), c)) for name, c in (("a", SEA), ("b", PURE))]
    index, conditions = [problem.message for problem in card_of("water", jobs, None)[1]]
    assert index.startswith("water index is 1.34")
    assert "26 degrees Celsius, chlorinity 19.2, 480 nm, formula QUANFRY, air of 28" in conditions
    assert "35 degrees Celsius, salinity 0, 900 nm, formula IAPWS, standard air" in conditions
    block, origin = waves(), model.WaveOrigin(position=(0, 0, 0))
    other = replace(block, waves=replace(block.waves, crest=[0.0, 0.0]), wave_origin=origin)
    fewer, calm = replace(block, waves=wave(period=10.0)), replace(block, waves=empty(Waves), wave_origin=None)
    jobs = [Part(name=name, block=one) for name, one in zip("abcd", (calm, block, other, fewer), strict=True)]
    kept, _, problems = waves_of(jobs, None)
    assert kept.crest.tolist() == block.waves.crest.tolist()
    assert [problem.message for problem in problems] == [
        "the waves of b are not those of c: they differ in crest, origin",
        "the waves of b are not those of d: they differ in number",
    ]
    kept, place, problems = waves_of(jobs, jobs[2])
    assert not problems and kept.crest.tolist() == [0.0, 0.0] and place == origin


@pytest.mark.slow
def test_a_restart_keeps_conditions_until_the_index_is_adjusted() -> None:
    """An index with a sigma is an observation, and stays; one without is replaced by the adjusted one."""
    known = with_conditions(sea_block(), SEA)
    assert restart(adjust(known))[0].water == known.water
    observed = with_options(with_conditions(sea_block(), SEA, sigma=0.002), water_index=Treatment.ADJUST)
    solution = adjust(observed)
    assert restart(solution)[0].water == observed.water
    water = result(solution, PunchedPoints.ALL, ControlKind.FULL)[0].water
    assert water.conditions is None and water.index == solution.water.index != observed.water.index
    solution = adjust(with_options(known, water_index=Treatment.ADJUST))
    water = restart(solution)[0].water
    assert water.conditions is None and water.index == solution.water.index


@pytest.mark.slow
def test_the_origin_of_waves_stands_in_the_system_of_the_deck() -> None:
    """Of what is stated, of what is punched in the system of the answer, and of a place that the system lacks."""
    utm = model.SystemSpec(kind="PROJ", definition="+proj=utm +zone=17 +ellps=clrk66", axes="GRID")
    place = "WOX                468317.7465  2133904.6176       0.0000"
    lines = musat.deck_bytes(replace(waves(), given_in=utm)).decode().splitlines()
    assert lines[8].startswith(place)
    solution = adjust(replace(waves(), stated_in=utm))
    assert card(result(solution, PunchedPoints.ALL, ControlKind.FULL)[0], "WOX").startswith(place)
    echoed = listing(adjust(musat.read_deck("\n".join(lines).encode())))
    assert "      468317.7465       2133904.6176             .0000\n" in echoed
    lines[8] = "WOX             999999999.0000 99999999.000       0.0000".ljust(80)
    block, problems = musat.check_deck("\n".join(lines).encode())
    assert block is None and [problem.card for problem in problems] == ["WOX"]


# --- what is printed and recorded ---


SALT = WaterConditions(temperature=22.0, wavelength=480.0, salinity=39.0)
OIL = Water(index=1.46, liquid="LAB OIL 3")


@pytest.mark.parametrize(
    ("water", "lines"),
    [
        (
            sea().water,
            [
                f"Refractive index of water ........................ {sea().water.index:.6f}\n",
                "Refractive index computed for water of ........... 26 degrees Celsius, chlorinity 19.2, 480 nm, ",
                "relative to ...................................... air of 28 degrees Celsius and 1000 hPa\n",
            ],
        ),
        pytest.param(
            Water(index=index_of(SALT), conditions=SALT),
            ["salinity 39, 480 nm, formula QUANFRY extrapolated beyond"],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            OIL, ["Liquid, which is not water ....................... LAB OIL 3\n"], marks=pytest.mark.slow
        ),
    ],
    ids=["conditions", "salt beyond the fit", "another liquid"],
)
def test_listing_and_record_say_what_the_water_is(tmp_path: Path, water: Water, lines: list[str]) -> None:
    assert reread(replace(cayman(), water=water)).water == water
    text = ran(replace(cayman(), water=water), tmp_path).read_text()
    assert all(line in text for line in lines)
    recorded = json.loads((tmp_path / "job.json").read_text())["water"]
    assert (recorded["index"], recorded["liquid"]) == (water.index, water.liquid)
    assert water.conditions is None or WaterConditions(**recorded["conditions"]) == water.conditions


def test_salt_is_extrapolated_by_chlorinity_too() -> None:
    by_chlorinity = replace(SALT, salinity=None, chlorinity=39.0 / 1.80655)
    assert "QUANFRY extrapolated beyond a salinity of 35" in by_chlorinity.of_water
    assert "extrapolated" not in replace(by_chlorinity, chlorinity=19.3).of_water


def test_listing_and_record_say_which_waves_were_used(tmp_path: Path) -> None:
    text = ran(waves(), tmp_path).read_text()
    titles = ("Input: Wave (WAV)\n", "Input: Origin of the waves, geographic (WOG)\n", "Waves On The Water")
    assert all(title in text for title in titles)
    assert "SW    sinusoidal     12.00    10.000     99.707     9.971" in text
    assert "838              -.3000         12.500\n" in text
    record = read_rows(tmp_path / "job.json")
    assert not list(violations(with_columns(record, load_schema()), load_schema(), load_schema()))
    assert record["waves"][0]["length"] == pytest.approx(swell_length())
    assert record["waves"][0]["given_length"] is None and record["waves"][1]["depth"] is None
    assert record["wave_origin"] == list(waves().wave_origin.position)
    assert [row["time"] for row in record["stations"]] == [0.0, 12.5, 25.0, 37.5]


@pytest.mark.parametrize(("sigma", "shown"), [(np.nan, "SW, CHOP"), (2.0, r"SW, CHOP \(to be found\)")])
def test_the_list_of_a_job_names_its_waves(sigma: float, shown: str) -> None:
    block = replace(waves(), waves=replace(waves().waves, crest_sigma=[np.nan, sigma]))
    assert re.search(rf"waves on the water \.+ {shown}\n", list_text(summary(block), "strip.crd"))
