"""The fixture in UTM is the job of St. Thomas, and so is its answer."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj

from musatpy import adjust, read_deck
from musatpy.formats.musat import deck_bytes
from musatpy.model import SystemSpec
from musatpy.reports.record import dumps, record
from musatpy.units import AngleUnit
from record_rows import with_rows

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
