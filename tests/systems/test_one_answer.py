"""One answer in every coordinate system, the words that state one, and the fixture in UTM."""

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyproj
import pytest

from musatpy import read_deck
from musatpy.adjustment import adjust
from musatpy.errors import SystemsError
from musatpy.formats.musat import deck_bytes
from musatpy.geometry.collinearity import AngleForm, attitude_matrix
from musatpy.geometry.systems import Geocentric
from musatpy.model import Solution
from musatpy.reports.record import dumps, record
from musatpy.systems import (
    Axes,
    Statement,
    SystemSpec,
    entered,
    own_statement,
    stated,
    stated_solution,
    statement_of,
)
from musatpy.units import AngleUnit
from record_rows import with_rows
from reference.earth import earth_of
from reference.networks import Plan
from reference.networks import simulate as network
from systems.stated_jobs import (
    CLARKE,
    FALSE,
    ORIGIN,
    coordinates,
    job,
    reference_axes,
    statements,
    told,
)

RAYS = 1e-9  # rad
NAMES = pytest.mark.parametrize(
    "name",
    [
        "geographic, matrices",
        "geocentric",
        "geocentric, azimuth",
        "tangent plane",
        "tangent plane, vertical",
        "UTM",
        "UTM, matrices",
        "UTM above a geoid",
        "feet",
    ],
)


@lru_cache
def answer() -> Solution:
    solution = adjust(job())
    assert solution.converged
    return solution


@NAMES
def test_stated_in_a_system(name, tmp_path):
    words = statements(tmp_path)[name]
    out, expected = stated(job(), words.statement), told(job(), words)
    # metres (feet): rounding of coordinates of 6e6; radians: the axes of the grid by differences
    np.testing.assert_allclose(out.block.photos.position, expected.block.photos.position, rtol=0, atol=5e-8)
    np.testing.assert_allclose(out.block.control.position, expected.block.control.position, rtol=0, atol=5e-8)
    np.testing.assert_allclose(out.block.photos.tide, expected.block.photos.tide, rtol=0, atol=1e-9)
    if words.statement.form is None:
        np.testing.assert_allclose(out.matrices, expected.matrices, rtol=0, atol=RAYS)
    else:
        turn = np.exp(1j * out.block.photos.attitude) - np.exp(1j * expected.block.photos.attitude)
        # tilts of a degree or two make azimuth and swing fifty times less sure than the rotation
        assert np.abs(turn).max() < 50.0 * RAYS
    assert out.warnings == ()


def test_geocentric_jobs_are_stated_like_geographic_ones(tmp_path):
    geocentric = stated(job(), Statement(system=Geocentric(CLARKE))).block
    statement = statements(tmp_path)["UTM"].statement
    out, expected = stated(geocentric, statement).block, stated(job(), statement).block
    # steps of geocentric coordinates, and these over the radius of the earth
    np.testing.assert_allclose(out.photos.position, expected.photos.position, rtol=0, atol=5e-9)
    np.testing.assert_allclose(out.control.position, expected.control.position, rtol=0, atol=5e-9)
    np.testing.assert_allclose(out.photos.attitude, expected.photos.attitude, rtol=0, atol=1e-14)
    assert out.options.system == expected.options.system == job().options.system


@NAMES
def test_solution_in_a_system(name, tmp_path):
    """Positions by PROJ, attitudes by scipy's axes, and the points come back."""
    words = statements(tmp_path)[name]
    solution = answer()
    out = stated_solution(solution, words.statement)
    np.testing.assert_allclose(out.points, coordinates(job(), words, solution.points.position), rtol=0, atol=5e-8)
    np.testing.assert_allclose(
        out.position, coordinates(job(), words, solution.stations.position), rtol=0, atol=5e-8
    )
    for found, given in ((out.apparent, "apparent"), (out.predicted, "predicted")):
        expected = coordinates(job(), words, getattr(solution.bathymetric, given))
        np.testing.assert_allclose(found, expected, rtol=0, atol=5e-8)
    np.testing.assert_allclose(out.tide + words.undulation, solution.water.tide, rtol=0, atol=1e-12)
    axes = reference_axes(job(), words, solution.stations.position)
    M = attitude_matrix(solution.stations.attitude) @ earth_of(job()).frame(solution.stations.position)
    np.testing.assert_allclose(out.matrix, M @ axes.swapaxes(1, 2), rtol=0, atol=RAYS)
    if words.statement.form is not None:
        adjusted = {"position": solution.stations.position, "attitude": solution.stations.attitude}
        expected = told(replace(job(), photos=replace(job().photos, **adjusted)), words).block.photos.attitude
        # tilts of a degree or two make azimuth and swing fifty times less sure than the rotation
        assert np.abs(np.exp(1j * out.angles) - np.exp(1j * expected)).max() < 50.0 * RAYS


def test_the_own_words_of_a_job_change_nothing():
    block = job()
    again, warnings = entered(stated(block, own_statement(block)), own_statement(block))
    assert warnings == ()
    np.testing.assert_array_equal(again.photos.position, block.photos.position)
    np.testing.assert_allclose(again.photos.attitude, block.photos.attitude, rtol=0, atol=1e-15)  # one rounding
    own = stated_solution(answer(), own_statement(block))
    np.testing.assert_allclose(own.angles, answer().stations.attitude, rtol=0, atol=1e-15)
    # latitudes have 1.6e-7 rad to the metre
    sigma = np.sqrt(np.diagonal(own.covariance, axis1=1, axis2=2))
    ours = np.sqrt(np.diagonal(answer().stations.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(sigma[:, 2:], ours[:, 2:], rtol=1e-12)
    np.testing.assert_allclose(sigma[:, :2] * 6.37e6, ours[:, [1, 0]] * [1.0, 1.0 / np.cos(0.337)], rtol=0.01)


def test_a_tangent_plane_says_which_coordinates_its_origin_has():
    shifted = SystemSpec(kind="TANG", origin=tuple(ORIGIN), false=tuple(FALSE), axes="GRID")
    assert statement_of(shifted, job()).system.text == (
        "tangent plane at latitude 19.32000000, longitude -81.18000000 degrees, height 0.000 m "
        "(X 5000.000, Y 2000.000, Z 100.000 there)"
    )
    plain = statement_of(SystemSpec(kind="TANG", origin=tuple(ORIGIN)), job()).system.text
    assert plain.endswith("height 0.000 m")


def test_a_local_job():
    block = network(Plan(photos_per_strip=2)).block
    statement = statement_of(SystemSpec(kind="LOCL", axes="GRID", angles="POK"), block)
    assert (statement.axes, statement.form) == (Axes.SYSTEM, AngleForm.PHI_OMEGA_KAPPA)
    with pytest.raises(SystemsError, match="needs an ellipsoid"):
        statement_of(SystemSpec(kind="GEOC"), block)


def test_text_says_it_all():
    spec = SystemSpec(kind="PROJ", definition="EPSG:26717", axes="GRID", angles="POK", sigmas="SYST")
    assert statement_of(spec, job()).text == (
        "NAD27 / UTM zone 17N, EPSG:26717, ellipsoidal heights; phi, omega, kappa along the axes of the system; "
        "sigmas of these coordinates and attitudes"
    )


FIXTURES = Path(__file__).resolve().parents[2] / "fixtures"
ROUNDED = 1e-4  # m, of the coordinates on cards
GIVEN = SystemSpec(
    kind="PROJ", definition="+proj=utm +zone=20 +ellps=clrk66", axes="GRID", angles="POK", unit=AngleUnit.GONS
)
STATED = SystemSpec(kind="PROJ", definition="EPSG:3992", axes="GRID", sigmas="SYST")


def test_the_deck_is_made_again():
    native = read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")
    titles = (*native.titles, "IN UTM  ANSWER IN STATE PLANE FEET")
    made = replace(native, titles=titles, given_in=GIVEN, stated_in=STATED)
    deck = read_deck(FIXTURES / "st_thomas_utm" / "st_thomas_utm.crd")
    assert (deck.given_in, deck.stated_in, deck.titles) == (GIVEN, STATED, titles)
    again = read_deck(deck_bytes(made))
    np.testing.assert_array_equal(again.photos.ids, deck.photos.ids)
    np.testing.assert_array_equal(again.plates.xy, deck.plates.xy)
    shift = (deck.photos.position - native.photos.position) * [6.4e6, 6.1e6, 1.0]
    np.testing.assert_allclose(shift, 0.0, rtol=0, atol=ROUNDED)
    # 10 decimals of a gon, and the convergence at stations that are rounded
    np.testing.assert_allclose(deck.photos.attitude, native.photos.attitude, rtol=0, atol=1e-11)
    np.testing.assert_allclose(again.control.position, deck.control.position, rtol=0, atol=1e-11)


@pytest.mark.slow
def test_the_answer_is_that_of_the_first_deck():
    first = adjust(read_deck(FIXTURES / "st_thomas" / "st_thomas.crd"))
    found = with_rows(
        json.loads(dumps(record(adjust(read_deck(FIXTURES / "st_thomas_utm" / "st_thomas_utm.crd")))))
    )
    to_plane = pyproj.Transformer.from_crs("EPSG:4139", "EPSG:3992", always_xy=True)  # Puerto Rico's own datum
    for rows, places in (
        (found["stated"]["stations"], first.stations.position),
        (found["stated"]["points"], first.points.position),
    ):
        east, north = to_plane.transform(*np.degrees(places[:, [1, 0]]).T)
        answer = np.array([row["position"] for row in rows], dtype=float)
        expected = np.column_stack([east, north, places[:, 2]])
        # rounded control, and submerged points that see it ten times larger; 3.28 feet to the metre
        np.testing.assert_allclose(answer, expected, rtol=0, atol=10.0 * ROUNDED)
