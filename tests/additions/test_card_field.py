"""A card field is added to a copy of the program as docs/extending.md says: two files, and nothing is lost."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
DECK = ROOT / "fixtures" / "waves" / "strip.crd"
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
RECIPE = PAGE[PAGE.index("## A card field\n") :].split("\n## ")[0]
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


def blocks(kind: str) -> str:
    """Return the fenced block of a kind that the recipe has."""
    (text,) = re.findall(rf"```{kind}\n(.*?)```", RECIPE, re.DOTALL)
    return dedent(text)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Return a copy of the program with the new field on its card, and not yet in the model."""
    shutil.copytree(ROOT / "src" / "musatpy", tmp_path / "musatpy", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "card_formats", tmp_path / "musatpy" / "card_formats")
    with (tmp_path / "musatpy" / "card_formats" / "musat" / "tid.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n{blocks('toml')}")
    return tmp_path


def run(copy: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run Python with the copy in the place of the program."""
    environment = os.environ | {"PYTHONPATH": str(copy)}
    return subprocess.run(
        [sys.executable, *arguments], cwd=copy, env=environment, capture_output=True, text=True, check=False
    )


def test_what_is_on_a_card_and_not_in_the_model_is_an_error(copy: Path) -> None:
    result = run(copy, "-m", "musatpy", "check", DECK)
    assert result.returncode == 1
    assert re.search(
        r"tid\.toml: TID\.gauge: target: 'photos\.tide_gauge' is not in the model; expected", result.stderr
    )


def test_what_the_cards_of_another_table_say_is_an_error(copy: Path) -> None:
    add_to_model(copy, blocks("py").replace('"tides"', '"stations"'))
    result = run(copy, "-m", "musatpy", "check", DECK)
    assert result.returncode == 1
    assert "STA has no target photos.tide_gauge" in result.stderr


def add_to_model(copy: Path, line: str) -> None:
    """Add a column to the photos."""
    path = copy / "musatpy" / "model" / "block.py"
    before, following, after = path.read_text(encoding="utf-8").partition("    time: FloatArray")
    assert following
    path.write_text(f"{before}    {line.strip()}\n{following}{after}", encoding="utf-8")


def test_the_recipe_of_the_manual_works(copy: Path, tmp_path: Path) -> None:
    add_to_model(copy, blocks("py"))
    cards = DECK.read_text(encoding="ascii").splitlines()
    row = max(row for row, card in enumerate(cards) if card.startswith("TID"))
    cards[row] = f"{cards[row][:62]}PIER".ljust(72)
    deck = tmp_path / "gauged.crd"
    deck.write_text("\n".join(cards) + "\n", encoding="ascii")
    script = tmp_path / "tries.py"
    script.write_text(TRIES, encoding="utf-8")
    result = run(copy, script, deck)
    assert result.returncode == 0, result.stderr
    assert "patb holds no tides" in result.stdout
    manual = run(copy, "-m", "musatpy.formats.cards.manual")
    assert "photos.tide_gauge" in manual.stdout
