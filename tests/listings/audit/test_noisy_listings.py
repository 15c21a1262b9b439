"""Noise of the declared kinds on whole listings: the same numbers, each repair with its line, nothing silent."""

from __future__ import annotations

import random
import re

import pytest

from listings.audit.report_tables import FIXTURES, statistics_of, table
from musatpy.listings.audit.reading import listing_of
from musatpy.listings.audit.structures import RepairKind

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
        key: quantity.value if quantity.value is not None else quantity.text for key, quantity in listing.items()
    }


LISTINGS = {"own": OWN, **{f"6-{n}": table(n).read_text() for n in (1, 2, 5, 7, 8, 9)}}
CASES = [(name, kind) for name in LISTINGS for kind in KINDS]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_declared_noise_changes_no_number_and_is_reported(name, kind):
    text = LISTINGS[name]
    plain = numbers(statistics_of(listing_of(text, "x")))
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
        assert numbers(statistics_of(listing)) == plain, noisy.split("\n")[line - 1]
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


@pytest.mark.parametrize(
    ("old", "new", "kinds"),
    [
        ("Camera Station Position Analysis", "Camera Stati0n Posltion Analysis", {RepairKind.ZERO, RepairKind.ONE}),
        ("Plate Residuals\n", "P1ate Residua1s\n", {RepairKind.ONE}),
        ("Sum of Differences", "Sum 0f Differences", {RepairKind.ZERO}),
        ("RMS of All Points - x", "RMS 0f A11 Points - x", {RepairKind.ZERO, RepairKind.ONE}),
        ("Comparison of Computed", "Compari'son of C0mputed", {RepairKind.ZERO, RepairKind.STRAY}),
    ],
)
def test_titles_and_labels_are_repaired_too(old, new, kinds):
    assert f"\n{old}" in OWN  # the index has titles behind their pages
    listing = listing_of(OWN.replace(f"\n{old}", f"\n{new}", 1), "x")
    line = OWN[: OWN.index(f"\n{old}")].count("\n") + 2
    assert {one.line for one in listing.repairs} == {line} and kinds <= {one.kind for one in listing.repairs}
    assert listing.unreadable == ()
    assert numbers(statistics_of(listing)) == numbers(statistics_of(listing_of(OWN, "x")))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "Camera Station Attitude Analysis",
            "Cxmera Stxtion Attxtude Analxsis",
            "a report without a legible title",
        ),
        ("Plate Residuals\n", "Plxte Rexiduals\n", "a report without a legible title"),
        ("Comparison of Computed Geocentric", "Cxmparison xf Computed Geocentric", "without a legible title"),
    ],
)
def test_a_report_whose_title_is_not_legible_is_missed(old, new, said):
    assert f"\n{old}" in OWN
    listing = listing_of(OWN.replace(old, new), "x")
    title = OWN[: OWN.index(f"\n{old}")].count("\n") + 2
    problems = [problem for problem in listing.unreadable if said in problem.message]
    assert problems and title <= problems[0].line <= title + 12


def test_ids_with_letters_that_look_like_digits_are_no_noise():
    text = OWN.replace("ROCK", "I0l ")
    listing = listing_of(text, "x")
    assert listing.repairs == () and listing.unreadable == ()
    assert "I0l" in [point.name for point in listing.submerged[0].points]
