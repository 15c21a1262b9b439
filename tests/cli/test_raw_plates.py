"""`musat run` of decks with comparator readings: what it writes, and every plate that it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from altered import altered, put
from cli.commands import musat
from formats.deck_edits import add, drop, in_system
from formats.deck_edits import replace as edit
from formats.raw_deck_cases import GO, GRID, bad
from json_schema import load_schema, violations
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.model import (
    Atmosphere,
    CoordinateSystem,
    Curvature,
    Distortion,
    Plates,
    ReductionOptions,
    Refused,
    Transformation,
)
from raw_plates import COMPARATOR, DECK, crosses, distances, raw_block, refined_block, reseau
from record_rows import read_rows, with_columns


@pytest.fixture
def run(tmp_path):
    """Run a deck of these bytes; return the result, the listing and the record, None where there are none."""

    def run_bytes(data):
        path = tmp_path / "raw.crd"
        path.write_bytes(data)
        result = musat("run", path)
        listing, record = path.with_suffix(".lst"), path.with_suffix(".json")
        assert listing.exists() == record.exists()
        text = listing.read_text() if listing.exists() else None
        return result, text, read_rows(record) if record.exists() else None

    return run_bytes


def section(listing, title):
    """Return the lines of a section of a listing up to the next section or page."""
    return listing.split(f"\n{title}\n", 1)[1].split("\n\n\n", 1)[0].split("\f", 1)[0].splitlines()


@pytest.mark.slow
def test_the_record_obeys_its_schema_and_says_what_was_done(run):
    result, _, record = run(DECK.read_bytes())
    assert (result.exit_code, result.stderr) == (0, "")
    schema = load_schema()
    assert not list(violations(with_columns(record, schema), schema, schema))
    reduction = record["reduction"]
    assert [plate["photo"] for plate in reduction["plates"]] == ["21", "22", "23"]
    assert reduction["options"]["side"] == "IDEAL" and reduction["options"]["ground_height"] == 20.0
    assert len(reduction["readings"]) == 51 and len(record["plates"]) == 48
    assert record["plates"][0]["xy"] == pytest.approx(refined_block().plates.xy[0], abs=1e-7)  # rounded readings
    steps = {step["step"]: step for step in reduction["plates"][2]["steps"]}
    assert list(steps) == ["comparator", "fiducials", "lens", "refraction"]
    assert steps["refraction"]["largest"] == pytest.approx(6.46e-3, abs=5e-6)  # mm; the listing says 6.46 um
    assert steps["fiducials"]["largest"] is None
    spread = reduction["plates"][0]["spreads"][0]
    assert spread.items() >= {"of": "marks", "freedom": 8, "unlikely": False}.items() and spread["beyond"] == []


def test_the_listing_says_what_was_largest_and_on_which_side(run):
    _, listing, _ = run(DECK.read_bytes())
    lines = section(listing, "Plate Reduction")
    values = {name: value.lstrip(". ") for name, _, value in (line.partition(" ..") for line in lines)}
    assert values["Side of the lens distortion"] == "IDEAL  measured = ideal + distortion(ideal)"
    assert values["Largest displacement, refraction in the air"] == "6.46 um on photo 23"
    assert values["Earth curvature"] == "not corrected"
    assert len(section(listing, "Plate Reduction: Residuals Of Fiducial Marks: Transformed Minus Calibrated")) >= 24
    _, listing, record = run(deck_bytes(refined_block()))  # of which there is nothing to say
    assert record["reduction"] is None and record["comparator"] is None and record["reseau"] == []
    assert "Plate Reduction" not in listing


@pytest.mark.slow
def test_the_listing_of_a_grid_job_has_the_earth_curvature(run):
    options = ReductionOptions(
        plates=Plates.RAW, atmosphere=Atmosphere.ARDC, curvature=Curvature.YES, ground_height=0.0
    )
    block = in_system(CoordinateSystem.LOCAL)
    result, listing, record = run(deck_bytes(raw_block(block, reduction=options)))
    assert result.exit_code == 0
    # dr = H' r^3 / (2 R f^2) of the outermost image, to the first order: of 0.3 um, and the photos are tilted
    r = np.linalg.norm(block.plates.xy, axis=1).max()
    largest = max(step["largest"] for plate in record["reduction"]["plates"] for step in plate["steps"][-1:])
    assert largest == pytest.approx(1500.0 * r**3 / (2.0 * 6371e3 * 152.0**2), rel=0.1)
    (line,) = (line for line in listing.splitlines() if line.startswith("Largest displacement, earth curvature"))
    assert f" {1e3 * largest:.2f} um on photo 84".replace(" 0.", " .") in line


def test_repeated_readings_that_differ_are_listed(run):
    result, listing, record = run(bad(edit(92, "-212.8317998-135.4841978", "-212.8617998-135.4841978")))
    assert result.exit_code == 0
    readings = section(listing, "Plate Reduction: Repeated Readings")
    (row,) = (line for line in readings if line[:20].split() == ["21", "points"])
    assert row.endswith("*")
    notes = section(listing, "Plate Reduction: Notes")
    assert "Photo 21: points with readings beyond the limit: 102." in notes
    assert any(note.startswith("*  So large a spread has a probability below 0.05") for note in notes)
    assert record["reduction"]["plates"][0]["spreads"][1]["beyond"] == ["102"]


def test_readings_in_micrometres_have_room_and_their_unit(run):
    block = raw_block()
    spec = replace(COMPARATOR, scale_u=0.999985e-3, scale_v=1.000021e-3, reading_sigma=2.0, repeat_limit=10.0)
    marks, points = block.fiducial_measurements, block.plates
    block = replace(
        block,
        comparator=spec,
        fiducial_measurements=replace(marks, xy=1000.0 * marks.xy, sigma=np.full_like(marks.sigma, 2.5)),
        plates=replace(points, xy=1000.0 * points.xy),
    )
    result, listing, _ = run(deck_bytes(block))
    assert result.exit_code == 0
    marks, points = (
        section(listing, f"Input: {what}: Comparator Readings")
        for what in ("Fiducial measurement (FMS)", "Plate measurement (PLT)")
    )
    assert marks[2].split() == ["Photo", "Mark", "unit", "unit", "unit", "unit"]
    assert marks[4].split() == ["21", "1", "-233440.6974000", "-237471.7361000", "2.50000", "2.50000"]
    assert points[4].split()[:4] == ["21", "102", "-212835.6487000", "-135482.1723000"]


def test_points_outside_what_is_calibrated_are_listed(run):
    block = raw_block(reseau=reseau(), cross_measurements=crosses(["21", "22", "23"]))
    block = altered(block, distortion={"values": put(np.s_[2:, 0], [30.0, 60.0, 90.0])})
    measured = block.cross_measurements
    inner = np.isin(measured.ids, [f"{row}{column:02d}" for row in "BCDEF" for column in range(2, 7)])
    measured = replace(measured, photo=measured.photo[inner], ids=measured.ids[inner], xy=measured.xy[inner])
    result, listing, record = run(deck_bytes(replace(block, cross_measurements=measured)))
    assert result.exit_code == 0
    plate, notes = record["reduction"]["plates"][0], " ".join(section(listing, "Plate Reduction: Notes"))
    for table, note in (
        ("beyond_reseau", "measured crosses, corrected as in the nearest cell: "),
        ("beyond_table", "calibrated radii of the lens, corrected as its table goes on: "),
    ):
        assert "206" in plate[table] and "213" not in plate[table]  # at (87, -85) and (51, 13) mm
        assert f"Photo 21: points outside the {note}" in notes


def exchanged(first, second):
    """Exchange the names of two marks on photo 21, in both readings."""

    def swap(lines):
        for start in (31, 39):
            a, b = start + first - 2, start + second - 2
            lines[a], lines[b] = (
                lines[a][:13] + lines[b][13] + lines[a][14:],
                lines[b][:13] + lines[a][13] + lines[b][14:],
            )
        return lines

    return swap


def in_one_place(lines):
    return [line[:18] + lines[30][18:] if 31 <= number <= 46 else line for number, line in enumerate(lines, 1)]


def by_distances(**changes):
    """Return the deck of a job by distances, after changes of the block."""
    block = raw_block(mark_distances=distances(), reduction=replace(raw_block().reduction, **BY_DISTANCES))
    return replace(block, **changes)


BY_DISTANCES = {"transformation": Transformation.DISTANCES, "residual_limit": 0.03}
OFF = edit(35, "-127.5445980", "-127.8445980")  # mark 5 of photo 21 by 0.3 mm in one reading: 0.15 in their mean
FAR = [edit(35, "-127.5445980", " -97.5445980"), edit(43, "-127.5443366", " -97.5443366")]
RIGHT_HANDED = edit(4, " L 0.002", "   0.002")
WRONG = replace(distances(), distance=distances().distance + np.array([0.0, 0.0, 0.2, 0.0]))
WILD = Distortion(camera=np.zeros(1), kind=np.array(["RADL"]), values=np.array([[5e-5, np.nan, np.nan]]))

REFUSALS = {
    "missing": (bad(drop(*range(33, 39), *range(41, 47))), 31, "2 marks measured, 3 needed"),
    "swapped": (bad(exchanged(1, 6)), 31, "the marks fit with marks 6 and 1 exchanged; residuals x y in um: 6 "),
    "mirrored": (bad(RIGHT_HANDED), 31, "the marks fit a mirrored plate", "residuals x y in um: 1 "),
    "misplaced": (bad(*FAR), 31, "under no other names the marks fit; out of place: 5; residuals x y in um: 1 "),
    "degenerate": (bad(in_one_place), 31, "the marks lie in one place"),
    "limit": (bad(OFF), 31, "mark 5 is off by 0.1", "0.0300 mm; without mark 5 the others keep", "in um: 1 "),
    "lost": (deck_bytes(replace(raw_block(), distortion=WILD)), 27, "fits the calibration of the camera"),
    "distances": (deck_bytes(by_distances(mark_distances=WRONG)), 35, "distance 3 - 1 is off", "in um: 7 - 5 "),
    "axes": (bad(
        edit(3, "AFFINE   ", "DISTANCES"), drop(*range(35, 39), *range(43, 47)),
        add("FDS RC8  7    5      224.00500 0.00300 X", "FDS RC8  8    6      224.00100 0.00300 Y"),
    ), 31, "marks 7, 5, 8, 6 of the axes are not measured"),
    "reseau": (bad(
        add(*GRID, *(f"RSM {photo}       A01      -99.9870000 100.0120000" for photo in (21, 22, 23)))
    ), 31, "no cell of the reseau has its four crosses measured"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSALS)
def test_a_refused_plate_is_told_at_its_card(run, case):
    data, line, *messages = REFUSALS[case]
    result, listing, _ = run(data)
    assert result.exit_code == 1 and listing is None
    head = f"raw.crd:{line} cols 5-12 FMS.photo: photo 21: "
    (told,) = (text for text in result.stderr.splitlines() if head in text)
    for message in messages:
        assert message in told
    assert "    FMS 21" in result.stderr and "        ^^^^^^^^" in result.stderr
    assert "not run, " in result.stderr and "Traceback" not in result.stderr


LOW = edit(23, " 2400.3434", "   12.3434")


def test_a_plate_that_its_height_refuses_is_told_at_its_station(run):
    result, listing, _ = run(bad(LOW))
    assert result.exit_code == 1 and listing is None
    head, _, image, carets = result.stderr.splitlines()[:4]
    assert "raw.crd:23 cols 48-57 STA.height: photo 22: refraction by US1976 needs" in head
    assert "not 20.0 and 12.3" in head
    assert image[4 + 47 : 4 + 57] == "   12.3434" and carets == " " * (4 + 47) + "^" * 10
    assert "not run, 1 error" in result.stderr


def test_plates_that_the_ground_refuses_are_told_once_at_its_height(run):
    result, _, _ = run(bad(edit(3, "    20.00", "  2450.00")))
    head, _, image, carets = result.stderr.splitlines()[:4]
    assert "RED.ground_height: photo 21, like 2 more: refraction by US1976 needs -500 m <= ground < camera" in head
    assert image[carets.index("^") : carets.rindex("^") + 1].strip() == "2450.00"
    assert "not run, 1 error" in result.stderr


def test_a_geocentric_station_is_told_with_all_that_makes_its_height(run):
    block = raw_block(in_system(CoordinateSystem.GEOCENTRIC))
    position = block.photos.position.copy()
    position[1] *= 1.0 - 2500.0 / np.linalg.norm(position[1])  # 2500 m down, below the ground
    block = replace(block, photos=replace(block.photos, position=position))
    result, _, _ = run(deck_bytes(block))
    head, _, image, carets = result.stderr.splitlines()[:4]
    assert f": photo {block.photos.ids[1]}: refraction by US1976 needs" in head and " STX: " in head
    told = [float(text) for text in image[carets.index("^") : carets.rindex("^") + 1].split()]
    assert told == pytest.approx(position[1], abs=1e-4)  # rounded to the last digit of the card


def test_all_refused_plates_are_told_and_a_job_without_any_good_plate_stops(run):
    result, _, _ = run(bad(RIGHT_HANDED))
    lines = [line for line in result.stderr.splitlines() if "mirrored" in line]
    assert [line.split()[0].rpartition(":")[2] for line in lines] == ["31", "47", "63"]
    assert "not run, 3 errors" in result.stderr
    result, listing, _ = run(bad(RIGHT_HANDED, GO))
    assert result.exit_code == 1 and listing is None
    assert result.stderr.count("the marks fit a mirrored plate") == 3


def test_a_job_goes_on_without_a_refused_plate(run):
    result, listing, record = run(bad(drop(*range(33, 39), *range(41, 47)), GO))
    assert result.exit_code == 0 and ": ACCEPTED, " in result.stdout
    left_out = "raw.crd:31 cols 5-12 FMS.photo: warning: photo 21: left out: 2 marks measured, 3 needed"
    assert left_out in result.stderr
    lines = section(listing, "Plate Reduction: Photos Left Out")
    assert lines[1] == "Photo 21: MISSING: 2 marks measured, 3 needed."
    assert [row["photo"] for row in record["stations"]] == ["22", "23"]
    assert {row["photo"] for row in record["plates"]} == {"22", "23"}
    plates = record["reduction"]["plates"]
    assert [plate["reason"] for plate in plates] == ["MISSING", None, None]
    assert plates[0]["missing"] == ["3", "4", "5", "6", "7", "8"]
    schema = load_schema()
    assert not list(violations(with_columns(record, schema), schema, schema))


def test_residuals_of_a_plate_left_out_are_listed(run):
    result, listing, record = run(bad(OFF, GO))
    assert result.exit_code == 0
    notes = section(listing, "Plate Reduction: Notes")
    assert "Photo 21: marks without any one of which the others keep the limit: 5." in notes
    (row,) = (one for one in record["reduction"]["plates"][0]["marks"] if one["mark"] == "5")
    printed = f"{1e3 * row['residual'][1]:10.2f}"
    table = section(listing, "Plate Reduction: Residuals Of Fiducial Marks: Transformed Minus Calibrated")
    assert [printed in line for line in table if line[:15].split() == ["21", "5"]] == [True]


def test_a_job_that_needs_the_plate_says_that_it_is_left_out(run):
    data = bad(drop(*range(33, 39), *range(41, 47), *range(49, 55), *range(57, 63)), GO)
    result, listing, _ = run(data)
    assert result.exit_code == 1 and listing is None
    assert "photo 21 was left out: 2 marks measured, 3 needed" in result.stderr
    assert "Traceback" not in result.stderr


def test_decks_with_readings_convert_to_such_decks_alone(tmp_path):
    for target in ("job.im", "job.img", "geoin.dat"):
        result = musat("convert", DECK, tmp_path / target)
        assert (result.exit_code, list(tmp_path.iterdir())) == (1, [])
        assert "the plate coordinates are comparator readings (RED)" in result.stderr
    assert musat("convert", DECK, tmp_path / "same.crd").exit_code == 0
    assert (tmp_path / "same.crd").read_bytes() == DECK.read_bytes()
    block = read_deck(tmp_path / "same.crd")
    assert (block.comparator, block.reduction.refused) == (COMPARATOR, Refused.STOP)
