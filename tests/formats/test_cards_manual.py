"""The manual of the cards is made from their TOML files, and the copy in the repository is the current one."""

from __future__ import annotations

import subprocess
import sys

import pytest

from musatpy.formats.cards import card_formats_folder, load_family
from musatpy.formats.cards.manual import card_manual
from musatpy.formats.cards.spec import CardSpec, FieldSpec
from musatpy.specs import keys


@pytest.fixture(scope="module")
def family():
    return load_family(card_formats_folder() / "musat")


def test_every_card_has_ruler_sample_and_fields(family):
    sections = card_manual(family).split("\n### ")[1:]
    assert [section[:3] for section in sections] == list(family.cards)
    for section, card in zip(sections, family.cards.values(), strict=True):
        ruler, sample = section.split("```")[1].splitlines()[1:]
        assert len(ruler) == len(sample) == 80
        assert sample == card.sample
        assert card.doc in section
        rows = [line for line in section.splitlines() if line.startswith("| ")][2:]
        assert [row.split(" | ")[1] for row in rows] == [field.name for field in card.fields]
        for row, field in zip(rows, card.fields, strict=True):
            assert str(field.edit) in row and field.doc in row and f"`{field.target}`" in row


def test_every_key_is_explained(family):
    manual = card_manual(family)
    assert all(f"| `{key}` |" in manual for key in [*keys(CardSpec), *keys(FieldSpec)])


def test_the_readme_of_the_card_formats_is_current():
    command = [sys.executable, "-m", "musatpy.formats.cards.manual"]
    manual = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    readme = (card_formats_folder() / "README.md").read_text(encoding="utf-8")
    assert readme == manual, (
        "card_formats/README.md is stale; regenerate it with "
        "`python -m musatpy.formats.cards.manual > card_formats/README.md`"
    )
