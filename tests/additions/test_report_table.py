"""A table is added to a copy of the house by the recipe of docs/extending.md: what prints or reads it knows it."""

import json
import re
import shutil
from pathlib import Path

import pytest

from record_rows import read_rows

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
DECK = ROOT / "fixtures" / "cayman" / "cayman_modified.crd"
TITLE, FIELD = "Images Of Photos", "images"


@pytest.fixture(scope="module")
def house(module_copy, blocks):
    """Return a copy of the house with the new page: one new file under src, one changed."""
    house = module_copy
    for name in ("docs/batch.md", "tests/json_schema.py", "pyproject.toml"):
        (house.folder / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, house.folder / name)
    reports = house.package / "reports"
    (reports / "images.py").write_text(dict(blocks("A table of the listing"))["py"])
    pages = (reports / "listing.py").read_text()
    assert pages.count(" iterations ") == 1  # its name, in the order of the listing
    (reports / "listing.py").write_text(pages.replace(" iterations ", " images iterations "))
    made = house.python("tests/json_schema.py")
    assert made.returncode == 0, made.stderr
    return house


@pytest.fixture(scope="module")
def files(house):
    """Return the listing and the record of a run."""
    ran = house.musat("run", DECK, "--csv", "-o", house.folder / "out")
    assert ran.returncode == 0, ran.stderr
    return house.folder / "out" / f"{DECK.stem}.lst", house.folder / "out" / f"{DECK.stem}.json"


def test_it_is_printed_and_recorded(files):
    listing, record = files
    rows = read_rows(record)[FIELD]
    lines = listing.read_text().split(f"\n{TITLE}\n")[1].splitlines()
    assert lines[1].split() == ["Photo", "Images"]
    assert [line.split() for line in lines[3 : 3 + len(rows)]] == [[r["photo"], str(r["images"])] for r in rows]


def test_it_is_written_as_csv(house, files):
    rows = read_rows(files[1])[FIELD]
    lines = (house.folder / "out" / f"{DECK.stem}_tables" / "images_of_photos.csv").read_text().splitlines()
    assert lines == ["Photo,Images", *(f"{row['photo']},{row['images']}" for row in rows)]


def test_a_difference_of_listing_and_record_is_seen(house, files):
    listing, record = files
    same = house.musat("diff", listing, record)
    assert same.returncode == 0, same.stdout
    assert TITLE not in same.stdout.partition("Not compared")[2]
    other = house.folder / "other.lst"
    before, _, after = listing.read_text().partition(f"\n{TITLE}\n")
    other.write_text(f"{before}\n{TITLE}\n" + re.sub(r"\d+$", "9999", after, count=1, flags=re.MULTILINE))
    changed = house.musat("diff", other, record)
    assert changed.returncode == 1 and TITLE in changed.stdout


def test_the_audit_knows_it(house, files):
    audited = house.musat("audit", files[0])
    assert audited.returncode == 0 and "cannot be read" not in audited.stdout, audited.stdout


def test_schema_and_manual_are_made_from_it(house):
    schema = json.loads((house.package / "reports/record.schema.json").read_text())
    assert FIELD in schema["required"] and schema["properties"][FIELD]["required"] == ["photo", "images"]
    fields = (house.package / "reports/record.md").read_text()
    assert "- `images[].images` (integer): measured on the photo" in fields
