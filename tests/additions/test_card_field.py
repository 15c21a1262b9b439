"""A card field is added to a copy of the program as docs/extending.md says: two files, and nothing is lost."""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
DECK = Path(__file__).parents[2] / "fixtures" / "waves" / "strip.crd"
TRIES = """
import sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from musatpy.formats import families, musat, parts
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import extracted
from musatpy.jobs.merge import merged
from musatpy.jobs.punch import punched
from musatpy.model.block import in_order_of_ids
import musatpy
from musatpy.reports.record import document, record

deck = Path(sys.argv[1])
block = musat.read_deck(deck)
assert set(block.photos.tide_gauge) == {"", "PIER"}, block.photos.tide_gauge
(gauged,) = block.photos.ids[block.photos.tide_gauge == "PIER"]
again = musat.read_deck(musat.deck_bytes(block))
assert again.photos.tide_gauge.tolist() == block.photos.tide_gauge.tolist()
assert musat.deck_bytes(again) == musat.deck_bytes(block)
converted = families.families()["musat"].render(parts.parts_of(block), deck, "gauged").contents.popitem()[1]
assert b"PIER" in converted
assert parts.block_of(parts.deck_parts(deck)).photos.tide_gauge.tolist() == block.photos.tide_gauge.tolist()

def gauge(of):
    return dict(zip(of.photos.ids.tolist(), of.photos.tide_gauge.tolist()))[gauged]

last = block.photos.ids == gauged
assert gauge(extracted(block, last | np.roll(last, 1)).block) == "PIER"
assert gauge(merged([Part(name="a", block=block)]).block) == "PIER"
assert gauge(in_order_of_ids(block)) == "PIER"

# it is echoed and recorded
solution = musatpy.adjust(block)
text = musatpy.listing(solution)
echo = text[text.rindex("Input: Tide (TID)") :].split("Input: ")[1].splitlines()
start = next(line for line in echo if "Gauge" in line).index("Gauge")
assert [line[start:].strip() for line in echo if line.startswith(gauged)] == ["PIER"], echo
stations = record(solution)["stations"]
assert dict(zip(stations["photo"], stations["tide_gauge"]))[gauged] == "PIER"
about = document().schema()["properties"]["stations"]["properties"]["tide_gauge"]
assert about["description"] == "TID gauge: Gauge from which the height comes.", about
left_out = families.families()["patb"].render(parts.parts_of(block), deck.parent).left_out
print(*left_out, sep="\\n")
"""


@pytest.fixture
def copy(copy, blocks):
    """Return a copy with the new field on its card, and not yet in the model."""
    with (copy.package / "card_formats" / "musat" / "tid.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n{dict(blocks('A card field'))['toml']}")
    return copy


def add_to_model(copy, line: str) -> None:
    """Add a column to the photos."""
    path = copy.package / "model" / "block.py"
    before, following, after = path.read_text(encoding="utf-8").partition("    time: FloatArray")
    assert following
    path.write_text(f"{before}    {line.strip()}\n{following}{after}", encoding="utf-8")


def test_what_is_on_a_card_and_not_in_the_model_is_an_error(copy) -> None:
    result = copy.musat("check", DECK)
    assert result.returncode == 1
    message = r"tid\.toml: TID\.gauge: target: 'photos\.tide_gauge' is not in the model; expected"
    assert re.search(message, result.stderr)


def test_what_the_cards_of_another_table_say_is_an_error(copy, blocks) -> None:
    add_to_model(copy, dict(blocks("A card field"))["py"].replace('"tides"', '"stations"'))
    result = copy.musat("check", DECK)
    assert result.returncode == 1
    assert "STA has no target photos.tide_gauge" in result.stderr


def test_the_recipe_of_the_manual_works(copy, blocks) -> None:
    add_to_model(copy, dict(blocks("A card field"))["py"])
    cards = DECK.read_text(encoding="ascii").splitlines()
    row = max(row for row, card in enumerate(cards) if card.startswith("TID"))
    cards[row] = f"{cards[row][:62]}PIER".ljust(72)
    deck = copy.folder / "gauged.crd"
    deck.write_text("\n".join(cards) + "\n", encoding="ascii")
    assert "patb holds no tides" in copy.tries(TRIES, deck).stdout
    assert "photos.tide_gauge" in copy.python("-m", "musatpy.formats.cards.manual").stdout
