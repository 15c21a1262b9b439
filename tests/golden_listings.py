"""The golden listings: which decks have one, where it is, and how it is made.

`python tests/golden_listings.py` writes them again. Look at the difference before it is committed, and say in
CHANGELOG.md which numbers moved, by how much and why.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from musatpy.runs import ExitStatus, run_deck

FIXTURES = Path(__file__).parents[1] / "fixtures"
DECKS = (
    FIXTURES / "st_thomas" / "st_thomas.crd",
    FIXTURES / "st_thomas_raw" / "st_thomas_raw.crd",
    FIXTURES / "st_thomas_utm" / "st_thomas_utm.crd",
    FIXTURES / "cayman" / "cayman_standard.crd",
    FIXTURES / "cayman" / "cayman_modified.crd",
    FIXTURES / "cayman" / "cayman_clean.crd",
)


def golden(deck: Path) -> Path:
    """Return where the golden listing of a deck is."""
    return deck.with_suffix(".lst")


def listing_bytes(deck: Path, folder: Path) -> bytes:
    """Return the listing of a run of `deck`, whose files go to `folder`."""
    result = run_deck(deck, folder)
    if result.status is not ExitStatus.CONVERGED or result.listing is None:
        raise RuntimeError(f"{deck}: {result.status.name}, {[str(problem) for problem in result.problems]}")
    return result.listing.read_bytes()


def main() -> None:
    """Write every golden listing again, and say which changed."""
    for deck in DECKS:
        with tempfile.TemporaryDirectory() as folder:
            new = listing_bytes(deck, Path(folder))
        path = golden(deck)
        changed = not path.exists() or path.read_bytes() != new
        path.write_bytes(new)
        print(f"{path.relative_to(FIXTURES.parent)}: {'written' if changed else 'as before'}")


if __name__ == "__main__":
    main()
