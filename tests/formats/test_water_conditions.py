"""Temperature, salinity and wavelength in place of the refractive index: what a job makes of them, and keeps."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from adjustment.test_musat3a import sea_block
from jobs.decks import cayman, reread, with_options
from musatpy import model
from musatpy.formats import musat, parts
from musatpy.formats.cards.deck import write_cards
from musatpy.formats.cards.spec import card_formats_folder
from musatpy.formats.job_tables import card_family
from musatpy.formats.refractive_index import index_of
from musatpy.jobs.agreement import Part, water_of
from musatpy.jobs.extract import extracted, photos_named
from musatpy.jobs.merge import MergeOptions, merged
from musatpy.jobs.punch import PunchedPoints, restart, result
from musatpy.model import ControlKind, Treatment, Water, WaterConditions
from musatpy.pipeline import adjust
from musatpy.refraction import media
from musatpy.runs import run_deck

SEA = WaterConditions(temperature=26.0, wavelength=480.0, chlorinity=19.2, air_temperature=28.0, air_pressure=1e5)
PURE = WaterConditions(temperature=35.0, wavelength=900.0, salinity=0.0, formula="IAPWS")


def with_conditions(block: model.Block, conditions: WaterConditions, **more: float) -> model.Block:
    return replace(block, water=Water(index=index_of(conditions), conditions=conditions, **more))


def card(block: model.Block, mnemonic: str) -> str:
    """Return the one card of a deck, blank without."""
    return "".join(line for line in musat.deck_bytes(block).decode().splitlines() if line.startswith(mnemonic))


def test_the_index_is_that_of_the_library() -> None:
    salinity = media.salinity_of_chlorinity(19.2)
    sea = media.relative_index(480.0, 26.0, salinity, air_temperature=28.0, air_pressure=1e5)
    assert index_of(SEA) == sea
    assert index_of(PURE) == media.relative_index(900.0, 35.0, formula=media.Formula.IAPWS)
    plain = WaterConditions(temperature=26.0, wavelength=480.0, salinity=float(salinity))
    assert index_of(plain) == media.relative_index(480.0, 26.0, salinity)
    # thinner air of 28 degrees and 1000 hPa has 0.0000160 less than standard air
    assert index_of(SEA) - index_of(plain) == pytest.approx(2.1e-5, abs=5e-6)


@pytest.mark.parametrize("conditions", [SEA, PURE])
def test_a_deck_keeps_what_was_given(conditions: WaterConditions) -> None:
    given = with_conditions(cayman(), conditions)
    assert reread(given).water == given.water
    assert not card(given, "WTR")  # nothing else is said of the water
    tilted = with_conditions(cayman(), conditions, sigma=0.0005)
    assert reread(tilted).water == tilted.water
    assert card(tilted, "WTR").startswith("WTR          0.000500 ")


def test_extract_and_merge_keep_it() -> None:
    block = with_conditions(cayman(), SEA)
    west, east = (extracted(block, photos_named(block, [some])).block for some in ("837-842", "841-846"))
    assert reread(west).water == reread(east).water == block.water
    ends = [Part(name="west", block=west), Part(name="east", block=east)]
    assert merged(ends, MergeOptions(join_photos=True, prefer=1)).block.water == block.water


def test_waters_of_other_conditions_do_not_agree() -> None:
    jobs = [Part(name=name, block=with_conditions(cayman(), c)) for name, c in (("a", SEA), ("b", PURE))]
    index, conditions = [problem.message for problem in water_of(jobs, None)[1]]
    assert index.startswith("water index is 1.34")
    assert "26 degrees Celsius, chlorinity 19.2, 480 nm, formula QUANFRY, air of 28" in conditions
    assert "35 degrees Celsius, salinity 0, 900 nm, formula IAPWS, standard air" in conditions


@pytest.mark.slow
def test_a_restart_keeps_it_until_the_index_is_adjusted() -> None:
    """An index with a sigma is an observation, and stays; one without is replaced by the adjusted one."""
    known = with_conditions(sea_block(), SEA)
    assert restart(adjust(known))[0].water == known.water
    observed = with_options(with_conditions(sea_block(), SEA, sigma=0.002), water_index=Treatment.ADJUST)
    solution = adjust(observed)
    assert restart(solution)[0].water == observed.water
    found = result(solution, PunchedPoints.ALL, ControlKind.FULL)[0].water
    assert found.conditions is None and found.index == solution.water.index != observed.water.index
    free = with_options(with_conditions(sea_block(), SEA), water_index=Treatment.ADJUST)
    solution = adjust(free)
    started = restart(solution)[0].water
    assert started.conditions is None and started.index == solution.water.index


def test_other_families_get_the_index(tmp_path: Path) -> None:
    """A family without a card of conditions says the index that they give; six decimals of the field."""
    folder = tmp_path / "cards"
    shutil.copytree(card_formats_folder() / "musat", folder)
    (folder / "wtc.toml").unlink()
    block, family = with_conditions(cayman(), SEA), card_family(folder)
    for deck in (musat.deck_bytes(block, family), write_cards(parts.cards_of_parts(parts.parts_of(block), family))):
        water = musat.read_deck(deck, family).water
        assert water == Water(index=pytest.approx(block.water.index, abs=5e-7))
    native = write_cards(parts.cards_of_parts(parts.parts_of(block), card_family()))
    assert musat.read_deck(native).water == block.water
    assert parts.block_of(parts.parts_of(block)).water == block.water


def test_listing_and_record_say_index_and_origin(tmp_path: Path) -> None:
    deck = tmp_path / "job.crd"
    block = with_conditions(cayman(), SEA)
    musat.write_deck(block, deck)
    run_deck(deck, tmp_path)
    listing = (tmp_path / "job.lst").read_text()
    assert f"Refractive index of water ........................ {block.water.index:.6f}\n" in listing
    assert (
        "Refractive index computed for water of ........... 26 degrees Celsius, chlorinity 19.2, 480 nm, "
        "formula QUANFRY\n"
        "relative to ...................................... air of 28 degrees Celsius and 1000 hPa\n"
    ) in listing
    assert max(len(line) for line in listing.splitlines()) <= 132
    water = json.loads((tmp_path / "job.json").read_text())["water"]
    assert water["index"] == block.water.index
    assert WaterConditions(**water["conditions"]) == SEA


@pytest.mark.slow
def test_salt_beyond_the_fit_is_extrapolated_and_says_so(tmp_path: Path) -> None:
    """The sea of half the jobs: a salinity of 39, which the cards of its chlorinity and salinity tell alike."""
    for given in ({"salinity": 39.0}, {"chlorinity": 39.0 / 1.80655}):
        conditions = WaterConditions(temperature=22.0, wavelength=480.0, **given)
        assert "QUANFRY extrapolated beyond a salinity of 35" in conditions.of_water
    deck = tmp_path / "job.crd"
    musat.write_deck(with_conditions(cayman(), replace(conditions, chlorinity=None, salinity=39.0)), deck)
    run_deck(deck, tmp_path)
    assert "salinity 39, 480 nm, formula QUANFRY extrapolated beyond" in (tmp_path / "job.lst").read_text()
    assert "extrapolated" not in replace(conditions, chlorinity=19.3).of_water


@pytest.mark.slow
def test_another_liquid_is_listed_recorded_and_written_again(tmp_path: Path) -> None:
    block = cayman()
    oil = replace(block, water=Water(index=1.46, liquid="LAB OIL 3"))
    assert reread(oil).water == oil.water
    deck = tmp_path / "job.crd"
    musat.write_deck(oil, deck)
    run_deck(deck, tmp_path)
    assert "Liquid, which is not water ....................... LAB OIL 3\n" in (tmp_path / "job.lst").read_text()
    assert json.loads((tmp_path / "job.json").read_text())["water"]["liquid"] == "LAB OIL 3"
    musat.write_deck(replace(oil, water=Water(index=1.46)), deck)
    block, problems = musat.check_deck(deck)
    assert block is None and "WTR.index: a refractive index of 1.46" in problems[0].headline()
