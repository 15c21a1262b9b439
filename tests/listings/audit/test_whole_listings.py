"""Listings as a whole: pages, several runs, missing lines, and noise of a scanner."""

import math
import random
import re

import pytest

from listings.audit.report_tables import FIXTURES, statistics_of, table
from musatpy.listings.audit import audit, listing_of, read_listing, side_by_side
from musatpy.listings.audit.against import numbers_of
from musatpy.listings.audit.cells import RepairKind

STANDARD, MODIFIED = (FIXTURES / "cayman" / f"cayman_{name}.lst" for name in ("standard", "modified"))


def test_an_error_in_the_second_run_is_found_at_its_line():
    spoiled = MODIFIED.read_text().replace("-0  0  4.113", "-0  0  4.173")
    found = audit(listing_of(STANDARD.read_text() + "\f" + spoiled, "x"))
    (alone,) = {one.line for one in audit(listing_of(spoiled, "x"))}
    assert {one.line for one in found} == {alone + STANDARD.read_text().count("\n")}


@pytest.mark.slow
def test_what_two_runs_say_otherwise_is_not_compared(tmp_path):
    (both := tmp_path / "both.lst").write_text(STANDARD.read_text() + "\f" + MODIFIED.read_text())
    found = side_by_side(read_listing(MODIFIED), both)
    assert all(pair.alike for pair in found.pairs) and found.only_old == ()
    compared = {pair.key for pair in found.pairs}
    assert {key for key in compared if key.refracted} == {
        key for key in statistics_of(read_listing(MODIFIED)) if key.refracted
    }
    assert compared.isdisjoint(found.several) and "bathymetric points" in {key.report for key in found.several}
    assert set(found.several) == numbers_of(read_listing(both))[1]


@pytest.mark.parametrize("source", [MODIFIED, table(4)])
def test_line_ends_tabs_and_a_byte_order_mark_change_nothing(source, tmp_path):
    text = source.read_text().replace("        ", "\t" if source == table(4) else "        ")
    (path := tmp_path / "x.lst").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode() + b"\f")
    found, plain = read_listing(path), read_listing(source)
    assert found.repairs == found.unreadable == () and statistics_of(found) == statistics_of(plain)


@pytest.mark.parametrize(
    ("number", "row", "old", "item", "found"),
    [
        (1, "Standard Dev", " 0  0    .144", "Latitude", "-0 0 .144"),
        (4, "RMS of All Points - y", " .033", "frame 841", "-.033"),
    ],
)
def test_a_negative_root_is_found(number, row, old, item, found):
    lines = table(number).read_text().splitlines()
    (at,) = (n for n, line in enumerate(lines) if line.startswith(row))
    assert lines[at].count(old) == 1
    lines[at] = lines[at].replace(old, "-" + old.lstrip())
    known = {(one.item, one.message) for one in audit(read_listing(table(number)))}
    findings = [one for one in audit(listing_of("\n".join(lines), "x")) if (one.item, one.message) not in known]
    assert [(one.item, one.line) for one in findings] == [(item, at + 1)]
    assert found in [suspect.found for suspect in findings[0].suspects]


OWN = (FIXTURES / "st_thomas_utm" / "st_thomas_utm.lst").read_text()
# Kind of noise -> where it falls, what it makes of the text there, and the repair that it takes.
KINDS = {
    "bullet": (r"\.(?=\d)", lambda old, rng: "\u2022", RepairKind.BULLET),
    "one": (r"(?<=[\d. ])1(?=[\d. ]|$)", lambda old, rng: rng.choice("lI"), RepairKind.ONE),
    "zero": (r"(?<=[\d. ])0(?=[\d. ]|$)", lambda old, rng: rng.choice("Oo"), RepairKind.ZERO),
    "stray": (r"(?<=\d)(?= |$)|(?<= )(?=[-.\d])", lambda old, rng: rng.choice(",;:'`_"), RepairKind.STRAY),
    "split": (r"(?<=\d)(?=\.?\d)", lambda old, rng: " ", RepairKind.SPLIT),
}
# Rows of the standard reports.
ROW = re.compile(
    r"^(?:Sample S|Sum of|Mean Value|RMS of [ADNPT]|Standard Dev|Maximum D|Camera with|Point with|Frame  )"
    r"|^(?:\S+ +| {9,})[XYZ] "
)


def spoiled(text, kind, rng):
    """Return the text with one place of one row changed, and the number of the row."""
    pattern, noise, _ = KINDS[kind]
    lines = text.split("\n")
    rows = [n for n, line in enumerate(lines) if ROW.match(line) and re.search(pattern, line[8:])]
    at = rng.choice(rows)
    places = [match for match in re.finditer(pattern, lines[at]) if match.start() >= 8]
    place = rng.choice(places)
    lines[at] = lines[at][: place.start()] + noise(place[0], rng) + lines[at][place.end() :]
    return "\n".join(lines), at + 1


def numbers(listing):
    return {
        key: cell.text if math.isnan(cell.value) else cell.value for key, cell in statistics_of(listing).items()
    }


LISTINGS = {"own": OWN, **{f"6-{n}": table(n).read_text() for n in (1, 2, 5, 7, 8, 9)}}
CASES = [(name, kind) for name in LISTINGS for kind in KINDS]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_declared_noise_changes_no_number_and_is_reported(name, kind):
    text = LISTINGS[name]
    plain = numbers(listing_of(text, "x"))
    rng = random.Random(f"{name} {kind}")
    repaired = 0
    for _ in range(12 if name == "own" else 6):
        noisy, line = spoiled(text, kind, rng)
        listing = listing_of(noisy, "x")
        here = [one for one in listing.repairs if one.line == line]
        if any(problem.line == line for problem in listing.unreadable):
            assert kind in ("split", "stray"), noisy.split("\n")[line - 1]  # no other kind leaves two readings
            continue
        assert KINDS[kind][2] in [one.kind for one in here], noisy.split("\n")[line - 1]
        assert {one.line for one in listing.repairs} == {line} and listing.unreadable == ()
        assert numbers(listing) == plain, noisy.split("\n")[line - 1]
        repaired += 1
    assert repaired >= 3


@pytest.mark.parametrize("name", LISTINGS)
def test_undeclared_noise_is_never_taken(name):
    text = LISTINGS[name]
    rng = random.Random(name)
    for _ in range(12 if name == "own" else 8):
        lines = text.split("\n")
        rows = [n for n, line in enumerate(lines) if ROW.match(line) and re.search(r"[\d ]\.\d+", line)]
        at = rng.choice(rows)
        place = rng.choice([match.end() - 1 for match in re.finditer(r"[\d ]\.\d+", lines[at])])
        lines[at] = lines[at][:place] + rng.choice("?#%SB\u00a3") + lines[at][place + 1 :]
        listing = listing_of("\n".join(lines), "x")
        assert at + 1 in [problem.line for problem in listing.unreadable], lines[at]
        assert not [one for one in listing.repairs if one.line == at + 1]


def test_ids_with_letters_that_look_like_digits_are_no_noise():
    text = OWN.replace("ROCK", "I0l ")
    listing = listing_of(text, "x")
    assert listing.repairs == () and listing.unreadable == ()
    assert any(report.name == "bathymetric points" and "I0l" in report.items for report in listing.reports)
