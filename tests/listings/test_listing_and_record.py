"""A listing against the record of its run."""

import dataclasses
import json
import random
import re

import pytest

from listings.runs import RAW, SEA, ST_THOMAS, edited, moved, printed, run_of
from musatpy.listings import CannotCompareError, compare_texts, parse_rules
from musatpy.model import RecordContent
from musatpy.records.json_files import with_images
from musatpy.reports.record import texts_of
from musatpy.statistics import Statistics
from record_rows import with_columns, with_rows
from sample_solutions import sample_solution

MIXED, REVERSED = ("a.lst", "b.json"), ("a.json", "b.lst")


@pytest.fixture
def text():
    return run_of(ST_THOMAS).record


@pytest.fixture
def listing():
    return run_of(ST_THOMAS).listing


def compared(a, b, rules="", names=MIXED):
    return compare_texts(a, b, parse_rules(rules), names)


def held(run, change):
    """Return what differs between the listing of a run and its record with a change."""
    return compared(run.listing, edited(run.record, change))


@pytest.mark.parametrize(
    "deck", [ST_THOMAS, "cayman/cayman_standard.crd", "cayman/cayman_modified.crd", SEA, RAW, None]
)
def test_a_listing_shows_the_numbers_of_its_record(deck):
    """Of a local job with all kinds of rows too."""
    run = run_of(deck) if deck else printed(sample_solution())
    result = compared(run.listing, run.record)
    assert result.same, result.findings[:5]
    assert result.counts["rows compared"] > 250
    assert "Page headers" in result.not_compared
    left_out = [note.partition(":")[0] for note in result.not_compared if "column" not in note]
    assert not any("Ellipses" in title or "Warnings" in title for title in left_out)
    assert not any("How Well" in note and "column" in note for note in result.not_compared)
    reduction = {re.split(": (?:column|words)", note)[0] for note in result.not_compared if "Reduction" in note}
    parts = {"Plate Reduction", "Plate Reduction: Plates", "Plate Reduction: Steps And Parameters"}
    assert reduction == (parts if deck == RAW else set())


@pytest.mark.parametrize("deck", [ST_THOMAS, RAW])
def test_what_a_record_was_written_without_is_not_compared(deck):
    """The same sections and counts otherwise."""
    run = run_of(deck)
    whole = compared(run.listing, run.record)
    some = compared(run.listing, "".join(texts_of(Statistics(run.solution), RecordContent.TABLES)))
    assert some.same, some.findings[:5]
    left_out = {note.partition(":")[0] for note in set(some.not_compared) - set(whole.not_compared)}
    assert {"Worst Observations", "Residuals Of Plate Measurements", "Input"} <= left_out
    images = "Photos, points, images, submerged points, all but the first 2 numbers"
    assert any(images in note for note in some.not_compared)
    assert 100 < some.counts["rows compared"] < whole.counts["rows compared"]


ATTITUDES, RESIDUALS = (
    "Adjusted Exposure Stations: Attitudes",
    "Residuals Of Plate Measurements: Adjusted Minus Measured",
)
ELLIPSES, WAVES = "Statistics: Error Ellipses Of Stations", "Water: How Well The Waves Are Known"
MARKS = "Plate Reduction: Residuals Of Fiducial Marks: Transformed Minus Calibrated"
_PARAMETERS = ("adjusted_water", "waves", "parameters")
MOVES = {
    ST_THOMAS: [
        (("points", 2, "position", 2), 0.001, "Adjusted Ground Points", "203", {"Elevation"}),
        (("stations", 0, "attitude", 0), 1e-8, ATTITUDES, "21", {"X-Tilt"}),
        (("solution", "sigma0"), 1e-6, "Solution Summary", "Sigma0 (standard deviation of unit weight)",
         {"field 8"}),
        (("plates", 3, "residual", 1), 2e-5, RESIDUALS, "21 204", {"Resid. y"}),
        (("analyses", "ground_point", 2, "rms"), 0.01, "Ground Point Analysis", "RMS of Differences",
         {"Elev. (M)"}),
        (("bathymetric_points", 0, "predicted", 1), 0.1, "Bathymetric Points", "203 Y", {"Predicted"}),
        (("plate_statistics", "frames", 0, "rms", 0, 1), 0.001, "Plate Residuals", "RMS of Trig. Points - y",
         {"21"}),
        (("dependence", "stations", 1, "inflation", 5), 0.1, "Statistics: Variance Inflation Of Stations", "22",
         {"Heading"}),
    ],
    SEA: [
        (("stations", 1, "covariance", 0, 0), 1.0, ELLIPSES, "2", {"Major", "Minor", "Bearing"}),
        (("stations", 1, "position_sigma", 2), 0.1, ELLIPSES, "2", {"Sigma Up"}),
        ((*_PARAMETERS, 2, "adjusted"), 0.01, WAVES, "SW towards, deg", {"Adjusted", "Adjusted - given"}),
        (("dependence", "globals", 2, "sigma"), 1e-4, "Statistics: Global Unknowns", "wave SW azimuth",
         {"Sigma m, arc sec, 1"}),
        (("waves", 0, "given_length"), 0.1, "Input: Wave (WAV)", "SW", {"Length"}),
    ],
    RAW: [
        (("comparator", "non_orthogonality"), 1e-6, "Input: Comparator (CMP)", ".999985000", {"Non orthogonality"}),
        (("distortion", 3, "values", 1), 1e-6, "Input: Lens distortion (DST)", "RC8 TABL", {"Value 2"}),
        (("reduction", "readings", 4, "xy", 1), 1e-6, "Input: Plate measurement (PLT): Comparator Readings",
         "21 205", {"y unit"}),
        (("reduction", "options", "residual_limit"), 1e-4, "Plate Reduction", "Limit of residuals of marks",
         {"field 7"}),
        (("reduction", "plates", 1, "sigma0"), 0.01, "Plate Reduction: Plates", "22", {"Sigma0"}),
        (("reduction", "plates", 1, "marks", 2, "residual", 0), 1e-4, MARKS, "22 3", {"Resid. x"}),
        (("reduction", "plates", 2, "spreads", 1, "sigma", 1), 1e-4, "Plate Reduction: Repeated Readings",
         "23 points", {"Sigma v unit"}),
    ],
}  # fmt: skip


@pytest.mark.parametrize("deck", MOVES)
def test_numbers_of_the_record_that_move_a_printed_digit_are_found(deck):
    _, listing, text = run_of(deck)
    expected = {(section, row, column) for *_, section, row, columns in MOVES[deck] for column in columns}
    for path, step, *_ in MOVES[deck]:
        text = moved(text, path, step)
    sections = {section for section, *_ in expected}
    found = [one for one in compared(listing, text).findings if one.section in sections]
    assert {(one.section, one.row, one.column) for one in found} == expected
    assert all(one.last_digits is None or abs(one.last_digits) >= 1 for one in found)


def test_a_record_before_its_listing_differs_the_other_way_round(listing, text):
    other = moved(text, ("points", 2, "position", 2), 0.001)
    (there,) = compared(listing, other).findings
    (back,) = compared(other, listing, names=REVERSED).findings
    assert back.difference == -there.difference
    assert compared(listing, other, "[[rule]]\nlast_digits = 99\n").same


def test_rows_without_a_partner_are_found():
    def change(content):
        del content["plates"][2]

    found = held(run_of(ST_THOMAS), change)
    assert {(one.kind, one.section, one.row) for one in found.findings} == {
        ("only in A", "Input: Plate measurement (PLT)", "21 203"),
        ("only in A", RESIDUALS, "21 203"),
        ("number", "Size Of The Job", "Plate measurements"),
        ("number", "Run", "Photos, points, images, submerged points"),
    }


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (None, "[1, 2]", r"b\.json: is not the record of a run"),
        (None, "{}", r"b\.json: is not the record of a run"),
        (None, '{"compilation_version": "1.0"}', r"compilation_version: is a record of schema 1\.0"),
        ("x 1.5\n", None, r"a\.lst: has no section"),
    ],
)
def test_what_is_no_record_or_no_listing_of_ours_is_refused(text, listing, a, b, message):
    with pytest.raises(CannotCompareError, match=message):
        compared(a or listing, b or text)


def test_a_record_that_is_not_as_its_schema_says_is_refused_with_all_that_is_wrong(text, listing):
    content = json.loads(text)
    content["points"]["position"][2] = [1.0, "x"]
    content["stations"]["photo"].pop()
    del content["options"]
    with pytest.raises(CannotCompareError) as caught:
        compared(listing, json.dumps(content))
    assert {(problem.file, problem.field) for problem in caught.value.problems} == {
        ("b.json", "options"),
        ("b.json", "points.position[2]"),
        ("b.json", "points.position[2][1]"),
        ("b.json", "stations"),
    }


def test_rows_of_words_and_sections_without_numbers_are_said_not_to_be_compared(text, listing):
    found = compared(listing, text)
    assert "Options: words (6 rows)" in found.not_compared
    worst = "Statistics: Observations, The Worst First: notes (2 rows)"
    assert {"Page headers", worst} <= set(found.not_compared)


OBSERVATIONS, PAGE_1 = "Statistics: Observations, The Worst First", "Worst Observations"


def test_the_worst_observations_are_held_against_the_record():
    columns = {
        "residual": "Residual", "sigma": "Sigma", "redundancy": "Redund.", "standardised": "Stand. residual",
        "test": "Test value", "detectable": "Detectable error",
    }  # fmt: skip
    on_page_1 = {"residual": "Residual", "normal_test": "Normal test", "estimated_error": "Estimated error"}

    def change(content):
        content.update(with_rows(with_images(with_columns(content))))  # in one table, as earlier records have them
        worst = max(content["observations"], key=lambda one: abs(one["test"] or 0.0))
        for key in columns | on_page_1:
            worst[key] += 0.001 if key in ("residual", "sigma", "detectable", "estimated_error") else 0.1

    found = held(run_of(SEA), change).findings
    expected = {(OBSERVATIONS, column) for column in columns.values()}
    assert {(one.section, one.column) for one in found} == expected | {
        (PAGE_1, name) for name in on_page_1.values()
    }
    assert all(one.row.split() == ["plate", "3", "14", "y"] for one in found)


def test_sentences_are_held_against_the_record():
    warning = "point ROCK is flagged as submerged and stands 1.5 m above the water"
    run = printed(dataclasses.replace(run_of(ST_THOMAS).solution, warnings=(warning,)))

    def change(content):
        content["solution"]["warnings"].append("a new warning of 3.5 m")

    found = held(run, change)
    assert [(one.kind, one.section, one.b) for one in found.findings] == [
        ("only in B", "Warnings In Short", "a new warning of 3.5 m"),
        ("only in B", "Warnings", "a new warning of 3.5 m"),
    ]
    first, _, rest = run.listing.partition("\f")
    broken = first + "\f" + rest.replace("is flagged as submerged and", "is flagged as submer-\n  ged and", 1)
    found = compared(broken, run.record)
    assert [(one.kind, one.section, one.a) for one in found.findings] == [("text", "Warnings", "submer- ged")]
    assert compared(broken.replace("submer-", "submer", 1), run.record).same


def test_both_numbers_of_a_line_are_held_against_the_record():
    def change(content):
        content["adjusted_water"]["tilt"][0] += 1e-7
        content["adjusted_water"]["tilt_sigma"][1] += 1e-7
        content["water"]["sigma"] += 1e-4

    found = held(printed(sample_solution()), change)
    assert [(one.row, one.column) for one in found.findings] == [
        ("Refractive index of water", "field 9"),
        ("1.340000", "Sigma"),  # on its card
        ("Tilt towards east", "field 5"),
        ("Tilt towards north", "field 9"),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("deck", [ST_THOMAS, SEA, RAW])
def test_changed_digits_of_a_listing_are_found(deck):
    """Of sixty numbers at a time: one finding in each line beside the listing as it was, one beside its record.

    But for words of which the record has no number: of 450 digits 437 were found, of any sixty more than 54.
    """
    _, listing, text = run_of(deck)
    chance = random.Random(450)
    numbers = list(re.finditer(r"(?<![\w.])-?\d*\.\d+", listing))
    for _ in range(3):
        changed = listing
        lines = {listing.count("\n", 0, number.start()) + 1: number for number in chance.sample(numbers, 60)}
        for number in lines.values():
            place = chance.choice([n for n in range(*number.span()) if listing[n].isdigit()])
            digit = chance.choice([digit for digit in "0123456789" if digit != listing[place]])
            changed = changed[:place] + digit + changed[place + 1 :]
        assert sorted(one.place_a.line for one in compare_texts(listing, changed).findings) == sorted(lines)
        beside_record = {one.place_a.line for one in compared(changed, text).findings}
        assert beside_record <= {*lines} and len(beside_record) >= 37 / 40 * len(lines)
