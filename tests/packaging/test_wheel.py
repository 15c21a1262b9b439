"""The wheel holds the card formats, and the program runs from it alone."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

READ_SAMPLES = """
import musatpy
from musatpy.formats.cards import card_formats_folder, load_family, read_cards
family = load_family(card_formats_folder() / "musat")
deck = read_cards("".join(f"{card.sample}\\n" for card in family.cards.values()).encode(), family)
assert not deck.problems, deck.problems
print(musatpy.__file__, card_formats_folder(), sum(len(table) for table in deck.tables.values()), sep="\\n")
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built offline with the tools of this environment."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def unpacked(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def run(unpacked: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python code with the unpacked wheel before all else on its path, away from the checkout."""
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(unpacked)!r})\n{code}", *arguments]
    return subprocess.run(command, cwd=unpacked, capture_output=True, text=True, timeout=120)


def test_every_file_is_in_the_wheel(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    formats = {f"musatpy/{path.relative_to(ROOT).as_posix()}" for path in ROOT.glob("card_formats/*/*.toml")}
    modules = {path.relative_to(ROOT / "src").as_posix() for path in ROOT.glob("src/musatpy/**/*.py")}
    assert len(formats) >= 18
    assert formats | modules <= names
    assert not [name for name in names if name.startswith(("tests/", "fixtures/", "docs/"))]


def test_cards_are_read_with_the_formats_of_the_wheel(unpacked):
    ran = run(unpacked, READ_SAMPLES)
    assert ran.returncode == 0, ran.stderr
    package, formats, cards = ran.stdout.splitlines()
    assert Path(package) == unpacked / "musatpy" / "__init__.py"
    assert Path(formats) == unpacked / "musatpy" / "card_formats"
    assert int(cards) == len(list(ROOT.glob("card_formats/musat/*.toml")))


def test_the_program_starts_from_the_wheel(unpacked):
    ran = run(unpacked, "from musatpy.cli.main import main; main()", "--help")
    assert ran.returncode == 0, ran.stderr
    assert "check" in ran.stdout and "run" in ran.stdout


def test_the_wheel_runs_a_deck(unpacked, tmp_path):
    deck = ROOT / "fixtures" / "st_thomas" / "st_thomas.crd"
    ran = run(unpacked, "from musatpy.cli.main import main; main()", "run", str(deck), "-o", str(tmp_path))
    assert ran.returncode == 0, ran.stderr
    assert "ACCEPTED" in ran.stdout
    assert (tmp_path / "st_thomas.lst").read_bytes() == deck.with_suffix(".lst").read_bytes()
    assert json.loads((tmp_path / "st_thomas.json").read_text())["solution"]["converged"] is True
