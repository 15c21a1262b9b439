"""Model points of a plotter without stage output: their rays rebuilt, and what is lost without the y-parallax."""

from __future__ import annotations

import numpy as np
import pytest

from compilation.scenes import at_depth, flat_images, grid, pair
from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.loop import Drive, Loop
from musatpy.compilation.model_points import stages_of
from musatpy.compilation.stereomodels import Stereomodel, set_up
from musatpy.compilation.triangulation import Triangulation
from musatpy.formats.compilation_deck import compilation_bytes, read_compilation

_PLACES = grid((200.0, 1600.0), 1700.0)
_DEPTH = 30.0


@pytest.fixture(scope="module")
def run() -> Triangulation:
    """Return the pair of section 5: H 3000 m, f 152.4 mm, base 1810 m."""
    return pair(3000.0, 1810.0)


def marks(stereo: Stereomodel, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the marks (k, 3) without x-parallax, in the middle of the rays, and their y-parallaxes (k,) mm.

    By scalars: each ray at the height where both have the same X.
    """
    place, parallax = np.empty((len(xy), 3)), np.empty(len(xy))
    (x1, y1, z1), (x2, y2, z2) = stereo.stations
    f = 152.4
    for row, ((a, b), (c, d)) in enumerate(xy):
        fall = (x2 - x1) / (a - c)  # both cameras look straight down from one height
        assert z1 == pytest.approx(z2)
        Y = [y1 + b * fall, y2 + d * fall]
        place[row] = x1 + a * fall, np.mean(Y), z1 - f * fall
        parallax[row] = d - b - (y2 - y1) / fall * -1.0
    return place, parallax


def deck(place: FloatArray, parallax: FloatArray | None, loop: str = " ") -> bytes:
    """Return a deck of submerged model points, with and without their y-parallaxes (mm)."""
    lines = [f"MDL 1        1        2                                          5.00  {loop}"]
    for row, (X, Y, Z) in enumerate(place):
        py = "" if parallax is None else f"{1e3 * parallax[row]:8.2f}"
        lines.append(f"MPT 1        {row:<8} GB{X:12.4f}{Y:12.4f}{Z:12.4f}{py}")
    return "\n".join([*lines, "END", ""]).encode()


def points(run: Triangulation, data: bytes) -> Compiled:
    contents, warnings = read_compilation(data)
    assert not warnings and compilation_bytes(
        read_compilation(compilation_bytes(contents))[0]
    ) == compilation_bytes(contents)
    return compiled(run, contents)


def test_rays_come_back_from_the_mark_and_its_parallax(run: Triangulation) -> None:
    stereo = set_up(run, "1", "2")
    xy = flat_images(run, at_depth(_PLACES, _DEPTH))
    place, parallax = marks(stereo, xy)
    # 30.1 um at the scale of the water; straight rays to both sides of the mark are exact up to rounding.
    scale = (stereo.height - place[:, 2]) / stereo.height
    assert np.abs(parallax * scale).max() == pytest.approx(0.0301, abs=5e-5)
    np.testing.assert_allclose(
        stages_of(Loop(stereo=stereo, drive=Drive.AIR), place, parallax), xy, rtol=0, atol=1e-9
    )


def test_points_are_true_with_their_parallaxes_and_off_without(run: Triangulation) -> None:
    true = at_depth(_PLACES, _DEPTH)
    place, parallax = marks(set_up(run, "1", "2"), flat_images(run, true))
    result = points(run, deck(place, parallax))
    # .005 um of the card's y-parallax and .05 mm of its coordinates, at a scale of 1 to 20,000.
    assert np.abs(result.gathered("position") - true).max() < 5e-4
    assert np.abs(result.gathered("y_parallax")).max() < 1e-5
    assert not list(result.warnings())
    without = points(run, deck(place, None))
    lost = np.linalg.norm(without.gathered("position") - true, axis=1).max()
    assert 0.05 < lost < 0.1 and np.isnan(without.gathered("y_parallax")).all()
    (warning,) = without.warnings()
    # Up to .083 m where the straight rays meet best (ETL-0306 has 30 m as the deepest of St. Thomas).
    told = float(warning.split("up to ")[1].split(" m")[0])
    assert warning.startswith("model 1 has model points without y-parallax") and told == pytest.approx(
        0.083, rel=0.05
    )


def test_dry_points_need_no_parallax(run: Triangulation) -> None:
    place, _ = marks(set_up(run, "1", "2"), flat_images(run, at_depth(_PLACES, 0.0)))
    place[:, 2] += 5.0
    data = deck(place, None).replace(b" GB", b" G ")
    result = points(run, data)
    stereo = set_up(run, "1", "2")
    assert np.abs(stereo.model(run.frame.working(result.gathered("position"))) - place).max() < 1e-4
    assert not list(result.warnings())


def test_marks_of_a_loop_through_the_water_are_the_true_points(run: Triangulation) -> None:
    """Nothing is lost without y-parallaxes there; one that the operator saw stays a y-parallax of the point."""
    true = at_depth(_PLACES, _DEPTH)
    place = set_up(run, "1", "2").model(run.frame.working(true))
    result = points(run, deck(place, None, "T"))
    assert np.abs(result.gathered("position") - true).max() < 1e-4  # .05 mm of the card
    assert np.isnan(result.gathered("y_parallax")).all() and not list(result.warnings())
    seen = points(run, deck(place, np.full(len(place), 0.008), "T"))
    # that of the point is of the right image, across its epipolar line, which is not quite along Y.
    np.testing.assert_allclose(seen.gathered("y_parallax"), 0.008, rtol=0.01)
