"""The listing and the record of an answer that is stated elsewhere: numbers are those of the stated solution."""

import json
import re

import numpy as np
import pytest

from altered import altered, put
from json_schema import load_schema, violations
from musatpy.model import CoordinateSystem, SystemSpec
from musatpy.reports.listing import listing
from musatpy.reports.pages import PAGE_WIDTH
from musatpy.reports.record import dumps, record
from musatpy.systems import stated, stated_solution, statement_of
from musatpy.units import ARC_SECOND, DEGREE, GON, AngleUnit
from record_rows import with_rows
from reports.test_listing import pages_of, section
from sample_solutions import sample_solution

UTM = {"kind": "PROJ", "definition": "EPSG:26717", "axes": "GRID", "sigmas": "SYST"}
FEET = "+proj=tmerc +lon_0=-80 +k=0.9996 +x_0=200000 +ellps=clrk66 +units=us-ft"
PLANE = {"kind": "TANG", "origin": (19.3 * DEGREE, -81.3 * DEGREE, 0.0), "axes": "GRID", "sigmas": "SYST"}
SPECS = {
    "UTM": SystemSpec(**UTM, unit=AngleUnit.GONS, angles="POK"),
    "UTM, local sigmas": SystemSpec(**{**UTM, "sigmas": "LOCL"}),
    "matrices": SystemSpec(**UTM, angles="MATR"),
    "feet": SystemSpec(**{**UTM, "definition": FEET}, unit=AngleUnit.DEGREES),
    "plane": SystemSpec(**PLANE, angles="MATR"),
    "geocentric": SystemSpec(kind="GEOC", axes="GEOC", sigmas="SYST"),
    "geographic": SystemSpec(sigmas="SYST", angles="ATS", unit=AngleUnit.RADIANS),
    "degrees": SystemSpec(unit=AngleUnit.DEGREES),
}


def solution_in(name, **changes):
    """The sample, whose positions are all known, with its answer in a system."""
    return altered(sample_solution(), block={"stated_in": SPECS[name], **changes})


def answer_of(solution):
    return stated_solution(solution, statement_of(solution.block.answer_in, solution.block))


def rows(text, title, skip=0):
    """Return the numbers of the rows of a table, without its first `skip` words."""
    lines = section(text, title)
    rule = next(number for number, line in enumerate(lines) if set(line) == {"-", " "})
    return [line.split()[skip:] for line in lines[rule + 1 :]]


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SPECS))
def test_pages_fit_the_paper_and_the_record_its_schema(name):
    solution, schema = solution_in(name, given_in=SPECS["UTM, local sigmas"]), load_schema()
    text = listing(solution)
    assert max(len(line) for page in pages_of(text) for line in page) <= PAGE_WIDTH
    assert "nan" not in text
    assert not [line for line in text.splitlines() if "*****" in line and "1053" not in line and "PLATE" in line]
    assert text.isascii()
    assert not list(violations(json.loads(dumps(record(solution))), schema, schema))


@pytest.mark.parametrize("name", list(SPECS))
def test_the_record_is_the_stated_solution(name):
    solution = solution_in(name)
    found, answer = with_rows(json.loads(dumps(record(solution))))["stated"], answer_of(solution)
    for table, column, expected in (
        ("stations", "position", answer.position),
        ("stations", "angles", answer.angles),
        ("stations", "matrix", answer.matrix),
        ("stations", "covariance", answer.covariance),
        ("points", "position", answer.points),
        ("points", "covariance", answer.point_covariance),
    ):
        values = np.array([row[column] for row in found[table]], dtype=float)
        np.testing.assert_array_equal(values, expected, f"{table}.{column}")
    assert found["answer"]["text"] == answer.statement.text
    assert found["input"] is None
    assert (found["stations"][0]["convergence"] is None) == (SPECS[name].kind != "PROJ")


def test_a_grid():
    solution = solution_in("UTM")
    text, answer = listing(solution), answer_of(solution)
    sigmas = np.sqrt(np.diagonal(answer.covariance, axis1=1, axis2=2))
    # half of the last printed decimal
    stations = np.array(rows(text, "Adjusted Exposure Stations: Positions", 2), dtype=float)
    np.testing.assert_allclose(stations, np.column_stack([answer.position, sigmas[:, :3]]), rtol=0, atol=5.01e-4)
    turns = np.array(rows(text, "Adjusted Exposure Stations: Attitudes", 1), dtype=float)
    np.testing.assert_allclose(turns[:, :3] * GON, answer.angles, rtol=0, atol=5.01e-8 * GON)
    np.testing.assert_allclose(turns[:, 3:] * ARC_SECOND, sigmas[:, 3:], rtol=0, atol=5.01e-3 * ARC_SECOND)
    maps = np.array(rows(text, "Adjusted Exposure Stations: The Map There", 1), dtype=float)
    np.testing.assert_allclose(maps[:, 0] * GON, answer.factors.convergence, rtol=0, atol=5.01e-8 * GON)
    np.testing.assert_allclose(maps[:, 1], answer.factors.meridian_scale, rtol=0, atol=5.01e-8)
    points = {line[0]: line for line in rows(text, "Adjusted Ground Points")}
    assert "E                N                h    Sigma E    Sigma N    Sigma h" in text
    for name, place, covariance in zip(
        solution.block.points.ids, answer.points, answer.point_covariance, strict=True
    ):
        if str(name) in points:
            numbers = [float(word) for word in points[str(name)][-6:]]
            sigma = np.sqrt(np.diagonal(covariance))
            np.testing.assert_allclose(numbers, [*place, *sigma], rtol=0, atol=5.01e-4)


@pytest.mark.parametrize("name", ["UTM", "feet", "plane"])
def test_ellipses_are_those_of_the_plane(name):
    solution = solution_in(name)
    text, answer = listing(solution), answer_of(solution)
    table = rows(text, "Statistics: Error Ellipses Of Stations, In The Plane Of The System", 0)
    ids = solution.block.photos.ids.tolist()
    assert sorted(line[0] for line in table) == sorted(ids)
    for photo, *row in table:  # the largest first
        covariance = answer.covariance[ids.index(photo), :2, :2]
        values, vectors = np.linalg.eigh(covariance)
        np.testing.assert_allclose([float(word) for word in row[:2]], np.sqrt(values[::-1]), rtol=0, atol=5.01e-4)
        bearing = np.degrees(np.arctan2(*vectors[:, 1])) % 180.0
        assert abs((float(row[2]) - bearing + 90.0) % 180.0 - 90.0) < 0.0501


@pytest.mark.parametrize("name", ["UTM, local sigmas", "geographic", "geocentric"])
def test_other_ellipses_are_across_the_vertical(name):
    title = "Statistics: Error Ellipses Of Stations"
    assert section(listing(solution_in(name)), title) == section(listing(sample_solution()), title)


def test_sigmas_of_angles_are_arc_seconds():
    solution = solution_in("geographic")
    text, answer = listing(solution), answer_of(solution)
    table = np.array(rows(text, "Adjusted Exposure Stations: Positions", 2), dtype=float)
    sigmas = np.sqrt(np.diagonal(answer.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(table[:, :2], answer.position[:, :2], rtol=0, atol=5.01e-12)
    np.testing.assert_allclose(table[:, 3:5] * ARC_SECOND, sigmas[:, :2], rtol=0, atol=5.01e-6 * ARC_SECOND)


def test_matrices_stand_on_three_lines():
    solution = solution_in("matrices")
    table = rows(listing(solution), "Adjusted Exposure Stations: Attitudes")[:15]  # the first page has these
    elements = np.array([line[2:5] for line in table], dtype=float).reshape(-1, 3, 3)
    np.testing.assert_allclose(elements, answer_of(solution).matrix[:5], rtol=0, atol=5.01e-10)
    assert [line[1] for line in table[:4]] == ["1", "2", "3", "1"]


def test_the_echo_is_in_the_words_of_the_deck():
    spec = SPECS["UTM, local sigmas"]
    solution = altered(sample_solution(), block={"given_in": spec})
    text = listing(solution)
    expected = stated(solution.block, statement_of(spec, solution.block)).block
    table = rows(text, "Input: Exposure station, rectangular (STX), As Stated", 2)
    echoed = np.array([line[:3] for line in table], dtype=float)
    np.testing.assert_allclose(echoed, expected.photos.position, rtol=0, atol=5.01e-5)
    assert re.search(r"Input, coordinates \.+ NAD27 / UTM zone 17N, EPSG:26717, ellipsoidal heights\n", text)
    assert "Answer, attitudes" in text


def test_points_beyond_the_system_are_named():
    """A point on the other side of the earth, which a gnomonic map cannot show."""
    spec = SystemSpec(kind="PROJ", definition="+proj=gnom +lat_0=19 +lon_0=-81 +ellps=clrk66", sigmas="SYST")
    far = {"position": put(3, [-0.3, 1.7, 0.0])}
    solution = altered(sample_solution(), block={"stated_in": spec}, points=far)
    text, name = listing(solution), solution.block.points.ids[3]
    sentence = f"{spec.definition}, ellipsoidal heights does not reach these points: {name}."
    assert section(text, "Points Without Coordinates In The System") == [sentence]
    row = with_rows(json.loads(dumps(record(solution))))["stated"]["points"][3]
    assert row == {"point": str(name), "position": [None] * 3, "covariance": [[None] * 3] * 3}
    assert answer_of(solution).far_points.sum() == 1


def test_stations_that_columns_cannot_say_have_a_note():
    """A truly vertical photo has neither azimuth nor swing; another is on the other side of the earth."""
    spec = SystemSpec(kind="PROJ", definition="+proj=gnom +lat_0=19 +lon_0=-81 +ellps=clrk66", angles="ATS")
    stations = {"attitude": put((0, slice(2)), 0.0), "position": put(1, [-0.3, 1.7, 3000.0])}
    solution = altered(sample_solution(), block={"stated_in": spec}, stations=stations)
    text = listing(solution)
    first, second = solution.block.photos.ids[:2]
    lost, far = section(text, "Notes On The Stations")
    assert lost.startswith(f"Photo {first}: first and third angle turn about one line; the first is set to zero")
    assert far == f"Photo {second}: {spec.definition}, ellipsoidal heights does not reach the station."
    positions = rows(text, "Adjusted Exposure Stations: Positions", 2)
    assert [len(row) for row in positions[:3]] == [6, 3, 6]
    assert "nan" not in text


def test_a_local_job_keeps_the_names_of_its_axes():
    solution = sample_solution(CoordinateSystem.LOCAL)
    spec = SystemSpec(kind="LOCL", angles="POK", unit=AngleUnit.DEGREES)
    text = listing(altered(solution, block={"stated_in": spec}))
    table, native = (rows(one, "Adjusted Exposure Stations: Positions") for one in (text, listing(solution)))
    assert table == native
    assert "Sigma X    Sigma Y    Sigma Z" in text


def test_without_cards_nothing_changes():
    assert record(sample_solution())["stated"] is None
    assert "Coordinate Systems" not in listing(sample_solution())
