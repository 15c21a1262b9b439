"""The decks on which two versions of the program are compared.

`python -m frozen.inputs DIR`, with src and tests on PYTHONPATH, writes them: those of the fixtures, the bad ones of
the tests of the checks, jobs in other coordinate systems, raw plates, and simulated blocks; and the pages of the
manual of that version, whose examples are run.
"""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import musatpy
from frozen import manual
from frozen.specs import spec, toml
from musatpy.errors import MusatError
from musatpy.formats import musat
from musatpy.simulation import simulate

ROOT = Path(__file__).parents[2]
SIMULATED = 300


def main(out: Path) -> None:
    """Write all decks below a folder."""
    _fixtures(out / "fixtures")
    _bad(out / "bad")
    _stated(out / "stated")
    _simulated(out / "simulated")
    manual.copied(Path(musatpy.__file__).parents[2], out / "pages")


def _fixtures(out: Path) -> None:
    for deck in sorted((ROOT / "fixtures").rglob("*.crd")):
        target = out / deck.parent.name / deck.name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(deck, target)


def _bad(out: Path) -> None:
    from formats.test_checks_cases import ALL

    out.mkdir(parents=True)
    for number, (data, _) in enumerate(ALL):
        (out / f"{number:03}.crd").write_bytes(data)


def _stated(out: Path) -> None:
    """Write a job that is given, and answered, in each system; without those whose geoid is a file."""
    import raw_plates
    from systems.stated_jobs import job
    from systems.test_system_decks import SPECS

    out.mkdir(parents=True)
    block = musat.read_deck(musat.deck_bytes(job()))
    for name, system in SPECS.items():
        if "geoid" not in name:
            stated = replace(block, given_in=system, stated_in=system)
            (out / f"{name.replace(', ', '_').replace(' ', '_')}.crd").write_bytes(musat.deck_bytes(stated))
    (out / "raw.crd").write_bytes(musat.deck_bytes(raw_plates.raw_block()))


def _simulated(out: Path) -> None:
    out.mkdir(parents=True)
    for seed in range(SIMULATED):
        path = out / f"s{seed:03}.toml"
        path.write_text(toml(spec(seed)), encoding="utf-8")
        try:
            (out / f"s{seed:03}.crd").write_bytes(musat.deck_bytes(simulate(path).block))
        except MusatError as error:
            print(f"{path.name}: {error}", file=sys.stderr)
        path.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
