"""Waves on the cards of a deck: what a job makes of them, and keeps."""

import re
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from jobs.decks import reread
from json_schema import load_schema, violations
from musatpy import model
from musatpy.formats import musat, parts
from musatpy.formats.cards.deck import write_cards
from musatpy.formats.cards.spec import card_formats_folder
from musatpy.formats.families import families
from musatpy.formats.job_tables import card_family
from musatpy.jobs.agreement import Part, waves_of
from musatpy.jobs.extract import extracted, photos_named
from musatpy.jobs.merge import MergeOptions, merged
from musatpy.jobs.punch import PunchedPoints, restart, result
from musatpy.jobs.summary import summary
from musatpy.model import ControlKind, Waves
from musatpy.model.tables import empty
from musatpy.pipeline import adjust
from musatpy.reports.jobs import list_text
from musatpy.reports.listing import listing
from musatpy.runs import run_deck
from musatpy.sea.deck_waves import wave_trains
from musatpy.units import DEGREE
from record_rows import read_rows, with_columns
from wave_strip import CHOP_LENGTH, CHOP_SPEED, FOLDER, PERIOD, swell_length

DECK = FOLDER / "strip.crd"


def read() -> model.Block:
    return musat.read_deck(DECK)


def same(one: Waves, other: Waves) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=name not in ("ids", "shape"))
        for name in (field.name for field in fields(Waves))
    )


def wave(**given: object) -> Waves:
    """Return one wave with nothing but what is given, and the rest of a wave."""
    nan = {field.name: [np.nan] for field in fields(Waves)}
    plain = {"ids": ["A"], "shape": [""], "height": [0.5], "azimuth": [0.0], "crest": [0.0]}
    return Waves(**{**nan, **plain, **{name: [value] for name, value in given.items()}})


def test_a_deck_comes_back_byte_for_byte() -> None:
    assert musat.deck_bytes(read()) == DECK.read_bytes()
    doubtful = replace(read().waves, height_sigma=[0.1, np.nan], azimuth_sigma=[10.0 * DEGREE, np.nan])
    block = replace(read(), waves=doubtful)
    data = musat.deck_bytes(block)
    assert b"\nWVS SW                                          0.100   10.000 " in data
    assert data.count(b"\nWVS ") == 1
    assert same(musat.read_deck(data).waves, doubtful)


def test_theory_knows_what_cards_leave_blank() -> None:
    swell, chop = wave_trains(read().waves).length
    assert swell == pytest.approx(swell_length(), rel=1e-12)  # rounding, of another way to solve the same equation
    assert chop == CHOP_LENGTH
    assert wave_trains(read().waves).period == pytest.approx([PERIOD, CHOP_LENGTH / CHOP_SPEED], rel=1e-15)
    deep = wave_trains(wave(period=8.0))
    assert deep.length[0] == pytest.approx(9.80665 * 64.0 / (2.0 * np.pi))  # g T^2 / 2 pi
    assert deep.group_speed[0] == pytest.approx(deep.speed[0] / 2.0)
    assert deep.breaking_height[0] == pytest.approx(0.142 * deep.length[0])


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
    found = [float(values[0]) for values in (train.period, train.length, train.speed)]
    assert found == pytest.approx([10.0, 99.70724, 9.970724], rel=1e-6)  # the digits of the length


def test_the_family_says_what_it_cannot_hold() -> None:
    left = families()["bingo"].render(parts.parts_of(read()), Path("x"), "x").left_out
    assert "bingo holds no waves: 2 left out" in left
    assert "bingo holds no wave origin: 1 left out" in left


def test_a_family_of_cards_without_waves_reads_its_decks(tmp_path: Path) -> None:
    folder = tmp_path / "cards"
    shutil.copytree(card_formats_folder() / "musat", folder)
    for name in ("wav", "wvs", "wog", "wod", "wox"):
        (folder / f"{name}.toml").unlink()
    family = card_family(folder)
    calm = musat.read_deck(musat.deck_bytes(read(), family), family)
    assert not len(calm.waves.ids) and calm.wave_origin is None
    native = write_cards(parts.cards_of_parts(parts.parts_of(read()), card_family()))
    assert native == DECK.read_bytes()
    again = parts.block_of(parts.parts_of(read()))
    assert same(again.waves, read().waves) and again.wave_origin == read().wave_origin


def test_extract_and_merge_keep_them() -> None:
    block = read()
    west, east = (extracted(block, photos_named(block, [some])).block for some in ("837-838", "839-840"))
    for part in (west, east):
        assert same(reread(part).waves, block.waves) and part.wave_origin == block.wave_origin
    np.testing.assert_array_equal(east.photos.time, [25.0, 37.5])
    ends = [Part(name="west", block=west), Part(name="east", block=east)]
    whole = merged(ends, MergeOptions(join_photos=True, prefer=1)).block
    assert same(whole.waves, block.waves) and whole.wave_origin == block.wave_origin


def test_decks_of_other_waves_do_not_agree() -> None:
    block = read()
    other = replace(
        block, waves=replace(block.waves, crest=[0.0, 0.0]), wave_origin=model.WaveOrigin(position=(0, 0, 0))
    )
    fewer = replace(block, waves=wave(period=10.0))
    calm = replace(block, waves=empty(Waves), wave_origin=None)
    jobs = [Part(name=name, block=one) for name, one in zip("abcd", (calm, block, other, fewer), strict=True)]
    waves, origin, problems = waves_of(jobs, None)
    assert [problem.message for problem in problems] == [
        "the waves of b are not those of c: they differ in crest, origin",
        "the waves of b are not those of d: they differ in number",
    ]
    assert same(waves, block.waves) and origin == block.wave_origin
    waves, origin, problems = waves_of(jobs, jobs[2])
    assert not problems and same(waves, other.waves) and origin == other.wave_origin


def test_what_is_punched_has_them() -> None:
    solution = adjust(read())
    for block in (restart(solution)[0], result(solution, PunchedPoints.ALL, ControlKind.FULL)[0]):
        assert same(block.waves, read().waves) and block.wave_origin == read().wave_origin
        np.testing.assert_array_equal(block.photos.time, read().photos.time)
    again = adjust(restart(solution)[0])
    moved = again.points.position - solution.points.position
    assert np.abs(moved * [6.4e6, 6.0e6, 1.0]).max() < 1e-4  # where the iteration stops


def test_the_list_of_a_job_names_its_waves() -> None:
    assert re.search(r"waves on the water \.+ SW, CHOP\n", list_text(summary(read()), "strip.crd"))
    block = read()
    guessed = replace(block.waves, crest_sigma=[np.nan, 2.0])
    text = list_text(summary(replace(block, waves=guessed)), "strip.crd")
    assert re.search(r"waves on the water \.+ SW, CHOP \(to be found\)\n", text)


@pytest.mark.slow
def test_the_origin_stands_in_the_system_of_the_deck() -> None:
    """Of what is stated, of what is punched in the system of the answer, and of a place that the system lacks."""
    utm = model.SystemSpec(kind="PROJ", definition="+proj=utm +zone=17 +ellps=clrk66", axes="GRID")
    place = "WOX                468317.7465  2133904.6176       0.0000"
    lines = musat.deck_bytes(replace(read(), given_in=utm)).decode().splitlines()
    assert lines[8].startswith(place)
    solution = adjust(replace(read(), stated_in=utm))
    punched = result(solution, PunchedPoints.ALL, ControlKind.FULL)[0]
    assert musat.deck_bytes(punched).decode().splitlines()[8].startswith(place)
    echoed = listing(adjust(musat.read_deck("\n".join(lines).encode())))
    assert "      468317.7465       2133904.6176             .0000\n" in echoed
    lines[8] = "WOX             999999999.0000 99999999.000       0.0000".ljust(80)
    block, problems = musat.check_deck("\n".join(lines).encode())
    assert block is None and [problem.card for problem in problems] == ["WOX"]


def test_listing_and_record_say_what_was_used(tmp_path: Path) -> None:
    deck = tmp_path / "job.crd"
    musat.write_deck(read(), deck)
    run_deck(deck, tmp_path)
    text = (tmp_path / "job.lst").read_text()
    assert (
        "Input: Wave (WAV)\n" in text
        and "Input: Origin of the waves, geographic (WOG)\n" in text
        and "Waves On The Water" in text
    )
    assert "SW    sinusoidal     12.00    10.000     99.707     9.971" in text
    assert "838              -.3000         12.500\n" in text
    assert max(len(line) for line in text.splitlines()) <= 132
    record = read_rows(tmp_path / "job.json")
    assert not list(violations(with_columns(record, load_schema()), load_schema(), load_schema()))
    assert record["waves"][0]["length"] == pytest.approx(swell_length())
    assert record["waves"][0]["given_length"] is None and record["waves"][1]["depth"] is None
    assert record["wave_origin"] == list(read().wave_origin.position)
    assert [row["time"] for row in record["stations"]] == [0.0, 12.5, 25.0, 37.5]
