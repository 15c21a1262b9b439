"""Pictures of orientations through water: of what they are asked for, always the same."""

from __future__ import annotations

import io

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib import image

from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.pictures import basins_picture, correlation_picture, precision_picture
from musatpy.orientation.twomedia.sights import Plane
from musatpy.orientation.twomedia.study import Basins, Precision
from orientation.twomedia.geometries import geometry, sights_of
from orientation.twomedia.methods import METHODS

BLUE, RED, GREY = 0x1F5A8C, 0xB5402A, 0x999999


def area(png: bytes, colour: int) -> int:
    """Return how many pixels have a colour."""
    pixels = np.asarray(image.imread(io.BytesIO(png), format="png"))[..., :3]
    wanted = np.array([colour >> 16, colour >> 8 & 0xFF, colour & 0xFF]) / 255.0
    return int((np.abs(pixels - wanted).max(axis=-1) < 0.01).sum())


def basins(outcomes: list[int]) -> Basins:
    errors = np.random.default_rng(1).normal(size=(1, len(outcomes), 10))
    return Basins(
        levels=np.array([1.0]),
        errors=errors,
        outcomes=np.array([outcomes]),
        roots=np.zeros((1, 10)),
        squares=np.zeros(1),
    )


@pytest.mark.slow
def test_basins_have_the_areas_of_their_shares() -> None:
    all_alike, mixed = (basins_picture(basins(outcomes)) for outcomes in ([0] * 8, [0] * 4 + [1, 1, -1, -1]))
    assert area(all_alike, RED) < 0.02 * area(all_alike, BLUE)  # the key alone
    for colour, share in ((BLUE, 0.5), (RED, 0.25), (GREY, 0.25)):
        assert area(mixed, colour) == pytest.approx(share * area(all_alike, BLUE), rel=0.05)  # key and crosses
    assert basins_picture(basins([0, 1, -1])) == basins_picture(basins([0, 1, -1]))


@pytest.mark.slow
def test_precision_draws_designs_limit_and_the_geometry_at_hand() -> None:
    precision = Precision(
        depths=np.array([0.01, 0.1, 1.0]),
        shares=np.array([0.0, 0.5]),
        sigma=np.array([[0.01, 0.001], [0.02, 0.002], [np.nan, 0.003]]),
        depth=0.2,
        share=0.0,
        at_hand=0.015,
    )
    png = precision_picture(precision, "lab")
    assert all(area(png, colour) > 50 for colour in (BLUE, RED, GREY))
    assert png == precision_picture(precision, "lab")


@pytest.mark.slow
def test_correlations_are_dark_where_they_are_strong() -> None:
    sights = sights_of(geometry("aerial", "SINGLE-RAY"), 20)
    png = correlation_picture(orient(sights, METHODS["SINGLE-RAY"], Plane()))
    darkest_blue, darkest_red = 0x053061, 0x67001F  # the ends of the colours: -1 and 1
    assert area(png, darkest_red) > area(png, darkest_blue) > 1000
