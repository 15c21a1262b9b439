"""The pages that name parts of the source name those that are there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "musatpy"


def test_the_architecture_names_every_room():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rooms = {folder.parent.name for folder in SOURCE.glob("*/__init__.py")}
    assert rooms - set(re.findall(r"\w+", page)) == set()


def test_names_of_the_glossary_are_in_the_source():
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    names = {name for names in re.findall(r"`([A-Za-z_.]+)`", page) for name in names.split(".")}
    words = {word for path in SOURCE.rglob("*.py") for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    assert len(names) > 50 and names - words == set()
