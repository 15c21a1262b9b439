"""The wheel holds the card formats, and the program runs from it alone."""

import subprocess
import sys
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = "musatpy/examples/examples.toml"

READ_SAMPLES = """
import musatpy
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.spec import card_formats_folder, load_family
family = load_family(card_formats_folder() / "musat")
deck = read_cards("".join(f"{card.sample}\\n" for card in family.cards.values()).encode(), family)
assert not deck.problems, deck.problems
print(musatpy.__file__, card_formats_folder(), sum(map(len, deck.lines.values())), sep="\\n")
"""


@pytest.fixture(scope="module")
def unpacked(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def examples_of(folder):
    return tomllib.loads((folder / "examples.toml").read_text(encoding="utf-8"))["example"]


@pytest.mark.slow
def test_the_wheel_is_small(wheel):
    """Of the examples 3 MB at most, and far less than that in all."""
    with zipfile.ZipFile(wheel) as archive:
        sizes = [one.compress_size for one in archive.infolist() if one.filename.startswith("musatpy/examples/")]
    assert sum(sizes) < 3_000_000
    assert wheel.stat().st_size < 5_000_000


@pytest.mark.slow
def test_the_metadata_say_what_it_is(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(name).decode())
        assert [one for one in archive.namelist() if one.endswith("licenses/LICENSE")]
    assert (metadata["Name"], metadata["License-Expression"], metadata["License-File"]) == (
        "musatpy",
        "MIT",
        "LICENSE",
    )
    classifiers = metadata.get_all("Classifier")
    assert "Environment :: Console" in classifiers and "Programming Language :: Python :: 3.11" in classifiers
    assert metadata["Requires-Python"] == ">=3.11"
    assert metadata["Project-URL"].startswith("Report ETL-0306, https://")
    assert {"notebook", "plots", "gis", "las", "fast"} <= set(metadata.get_all("Provides-Extra"))


def run(unpacked: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python code with the unpacked wheel before all else on its path, away from the checkout."""
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(unpacked)!r})\n{code}", *arguments]
    return subprocess.run(command, cwd=unpacked, capture_output=True, text=True, timeout=120)


def test_every_file_is_in_the_wheel(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    formats = {f"musatpy/{path.relative_to(ROOT).as_posix()}" for path in ROOT.glob("card_formats/*/*.toml")}
    modules = {path.relative_to(ROOT / "src").as_posix() for path in ROOT.glob("src/musatpy/**/*.py")}
    assert len(formats) >= 18
    templates = {path.relative_to(ROOT / "src").as_posix() for path in ROOT.glob("src/musatpy/page/templates/*")}
    assert len(templates) >= 5
    assert formats | modules | templates <= names
    examples = {f"musatpy/examples/{file}" for one in examples_of(ROOT / "fixtures") for file in one["files"]}
    assert len(examples) > 15
    assert {name for name in names if name.startswith("musatpy/examples/")} == {*examples, EXAMPLES}
    assert not [name for name in names if name.startswith(("tests/", "fixtures/", "docs/"))]


@pytest.mark.slow
def test_cards_are_read_with_the_formats_of_the_wheel(unpacked):
    ran = run(unpacked, READ_SAMPLES)
    assert ran.returncode == 0, ran.stderr
    package, formats, cards = ran.stdout.splitlines()
    assert Path(package) == unpacked / "musatpy" / "__init__.py"
    assert Path(formats) == unpacked / "musatpy" / "card_formats"
    assert int(cards) == len(list(ROOT.glob("card_formats/musat/*.toml")))
