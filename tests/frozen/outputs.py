"""What a version of the program makes of the frozen decks.

`python -m frozen.outputs DECKS OUT [EVERY]`, with the version to be asked on PYTHONPATH, writes all that its
commands say and leave, a file for each, below a folder, of all decks or of one of EVERY. The number of the
version is taken out of texts.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path

from click.testing import CliRunner

from frozen import manual
from musatpy import __version__
from musatpy.cli.main import main as musat

_FAMILIES = ("giant", "patb", "bingo", "jfk")
_PAIRS = 200


def main(decks: Path, out: Path, every: int = 1) -> None:
    """Run every command on every deck, or on one of so many."""
    out.mkdir(parents=True)
    shutil.copytree(decks, out / "decks")
    os.chdir(out)
    manual.run(Path("decks/pages").resolve(), Path("manual").resolve())
    shutil.rmtree("decks/pages")
    paths = sorted(Path("decks").rglob("*.crd"))[::every]
    for deck in paths:
        _deck(deck)
    _pairs(sorted(Path("runs").rglob("*.lst")), sorted(Path("runs").rglob("*.json")))
    _jobs([path for path in paths if "simulated" in path.parts])
    shutil.rmtree("decks")
    for path in Path().rglob("*.json"):
        path.write_text(_neutral(path.read_text(encoding="utf-8")), encoding="utf-8")


def _deck(deck: Path) -> None:
    name = "_".join(deck.with_suffix("").parts[1:])
    runs = Path("runs") / name
    _said(f"check/{name}.txt", "check", deck)
    _said(f"list/{name}.txt", "list", "--json", deck)
    _said(f"runs/{name}/said.txt", "run", deck, "-o", runs, "--punch", "result", "--punch-edits")
    listing = runs / f"{deck.stem}.lst"
    if not listing.exists():
        return
    _said(f"audit/{name}.txt", "audit", listing)
    _said(f"audit/{name}.json.txt", "audit", "--json", listing)
    _said(f"diff/{name}.txt", "diff", listing, listing.with_suffix(".json"))
    for family in _FAMILIES:
        _converted(deck, Path("convert") / name, family)


def _converted(deck: Path, folder: Path, family: str) -> None:
    """Convert a deck to the files of an agency, and back."""
    _said(f"{folder}/{family}.txt", "convert", deck, folder / family, "--to", family)
    files = sorted(path for path in folder.glob(f"{family}*") if path.suffix != ".txt")
    if files:
        back = folder / f"back_{family}.crd"
        _said(f"{folder}/back_{family}.txt", "convert", files[0], back, "--from", family, "--deck", deck)


def _pairs(listings: list[Path], records: list[Path]) -> None:
    """Compare neighbours of a kind."""
    for kind, files in (("lst", listings), ("json", records)):
        for number in range(min(_PAIRS // 2, len(files) - 1)):
            pair = files[number], files[number + 1]
            _said(f"diff/{kind}{number:03}.txt", "diff", *pair, "--junit", f"diff/{kind}{number:03}.xml")
            _said(f"diff/{kind}{number:03}.json.txt", "diff", "--json", *pair)


def _jobs(decks: list[Path]) -> None:
    """Merge neighbours, and extract a photo and its neighbours of each deck."""
    for number, (deck, other) in enumerate(zip(decks[::5], decks[1::5], strict=False)):
        prefixes = ("--prefix", f"{other.name}=B", "--point-prefix", f"{other.name}=B")
        merged = f"merge/{number:03}.crd"
        _said(f"merge/{number:03}.txt", "merge", deck, other, "-o", merged, "--options-from", deck.name, *prefixes)
        _said(f"extract/{number:03}.txt", "extract", deck, "--photos", "1-2", "-o", f"extract/{number:03}.crd")


def _said(name: str, *arguments: object) -> None:
    """Write what a command says, and how it ends."""
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    result = CliRunner().invoke(musat, [str(argument) for argument in arguments])
    text = f"{_neutral(result.output)}\nstatus {int(result.exit_code)}\n"
    path.write_text(text, encoding="utf-8")


def _neutral(text: str) -> str:
    return re.sub(rf"(musatpy[^\n]{{0,12}}){re.escape(__version__)}", r"\1VERSION", text)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve(), *map(int, sys.argv[3:]))
