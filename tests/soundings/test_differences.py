"""Differences of depths from soundings, their picture, and files of soundings."""

from pathlib import Path

import numpy as np
import pyproj
import pytest

from musatpy.arrays import FloatArray
from musatpy.errors import ProblemsError, SoundingError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.interchange import las
from musatpy.interchange.layers import LayerColumn, Points
from musatpy.soundings.differences import (
    DepthDifferences,
    likeness_warning,
    median_and_spread,
    order_shares,
    regression,
    samples,
)
from musatpy.soundings.pictures import difference_figure
from musatpy.soundings.s44 import orders_met, source, survey_orders
from musatpy.soundings.sounding_files import read_soundings
from musatpy.units import DEGREE


def differences(compiled: FloatArray, sounded: FloatArray, sigma: float = 0.1) -> DepthDifferences:
    names = np.arange(len(sounded)).astype(np.str_)
    return DepthDifferences(names=names, compiled=compiled, sounded=sounded, sigma=np.full(len(sounded), sigma))


def soundings(number: int = 400, noise: float = 0.1) -> tuple[FloatArray, FloatArray]:
    """Return true depths, and these with the noise of a compilation."""
    draws = np.random.default_rng(8)
    depth = draws.uniform(0.5, 30.0, number)
    return depth, depth + noise * draws.normal(size=number)


def test_bands_and_blunders() -> None:
    """Two soundings of a wrong digit are blunders; the bands are without them."""
    sounded, compiled = soundings()
    sounded = sounded.copy()
    sounded[:2] += 10.0
    shifted = differences(compiled, sounded)
    assert np.flatnonzero(shifted.blunders).tolist()[:2] == [0, 1] and shifted.blunders.sum() <= 4
    rows = {sample.what: sample for sample in samples(shifted)}
    assert list(rows) == ["all", "without blunders", "0 to 2 m", "2 to 5 m", "5 to 10 m", "10 to 20 m", "over 20 m"]
    assert rows["all"].statistics.maximum == pytest.approx(-10.0, abs=0.5)
    assert rows["all"].statistics.size == 400
    of_bands = [sample.statistics.size for sample in samples(shifted)[2:]]
    assert sum(of_bands) == rows["without blunders"].statistics.size == 400 - shifted.blunders.sum()
    assert rows["without blunders"].statistics.rms == pytest.approx(0.1, rel=0.1)

    depth = np.array([0.0, 1.99, 2.0, 4.99, 5.0, 10.0, 20.0, 25.0])  # one on a limit is in the deeper band
    sizes = {sample.what: sample.statistics.size for sample in samples(differences(depth, depth))[2:]}
    assert sizes == {"0 to 2 m": 2, "2 to 5 m": 2, "5 to 10 m": 1, "10 to 20 m": 1, "over 20 m": 2}


def test_every_round_of_blunders_shows_others() -> None:
    """Seven of a geometric series: until those that are left are within the limit that they make themselves."""
    series = np.append(1.2 ** np.arange(40), 0.0)
    found = differences(9.0 + series, np.full(41, 9.0))
    good = series[~found.blunders]
    middle, spread = median_and_spread(good)
    assert (np.sort(good) == np.sort(series)[:16]).all()
    np.testing.assert_array_equal(np.abs(series - middle) <= 3.29 * spread, ~found.blunders)


@pytest.mark.parametrize(("size", "is_blunder"), [(4.8, False), (-4.8, False), (4.95, True), (-4.95, True)])
def test_the_limit_of_blunders(size: float, is_blunder: bool) -> None:
    """Of differences of 1 and -1 m the limit is 3.29 times 1.4826 m, 4.878 m."""
    difference = np.concatenate([[size], np.zeros(3), np.ones(49), -np.ones(49)])
    blunders = differences(difference + 9.0, np.full(102, 9.0)).blunders
    assert blunders[0] == is_blunder and not blunders[1:].any()


def test_the_regression_of_a_line() -> None:
    sounded, _ = soundings()
    exact = regression(differences(sounded + 0.3 - 0.02 * sounded, sounded))
    assert exact is not None
    assert exact.a == pytest.approx(0.3) and exact.b == pytest.approx(-0.02)
    noisy = [
        regression(differences(sounded + 0.1 * np.random.default_rng(i).normal(size=400), sounded))
        for i in range(200)
    ]
    scaled = np.array([[line.a / line.a_sigma, line.b / line.b_sigma] for line in noisy if line])
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(scaled), axis=0)), 1.0, atol=0.15)
    assert -1.0 < exact.correlation < -0.8


def test_the_orders_of_the_standard() -> None:
    assert source().startswith("IHO") and "6.1.0" in source()
    assert [(order.name, order.a, order.b, order.c, order.e) for order in survey_orders()] == [
        ("Exclusive", 0.15, 0.0075, 1.0, 0.0),
        ("Special", 0.25, 0.0075, 2.0, 0.0),
        ("1a/1b", 0.5, 0.013, 5.0, 0.05),
        ("2", 1.0, 0.023, 20.0, 0.1),
    ]
    for within in (94, 95):  # percent
        difference = np.concatenate([np.zeros(within), np.full(100 - within, 50.0)])
        shares = order_shares(differences(difference + 9.0, np.full(100, 9.0)))
        assert {share.met for share in shares} == {within == 95}


def test_differences_without_error_count_alike() -> None:
    sounded, compiled = soundings()
    plain, weighted = (regression(differences(compiled, sounded, sigma)) for sigma in (0.0, 0.1))
    assert plain is not None and weighted is not None
    assert (plain.a, plain.b_sigma) == pytest.approx((weighted.a, weighted.b_sigma))
    small = regression(differences(np.array([1.0, 2.2, 2.9, 4.1]), np.arange(1.0, 5.0)))
    assert small is not None and small.sigma0 == pytest.approx(np.sqrt(0.05 / 0.01 / 2.0))


def test_the_limits_of_an_order_are_95_percent() -> None:
    """Of order 1a at 10 m: sqrt(.5^2 + .13^2) m = 1.96 sigma of the height, 5 m + 5 % = 2.448 sigma in plan."""
    vertical, horizontal = np.hypot(0.5, 0.13) / 1.960, 5.5 / 2.448
    covariance = np.zeros((4, 3, 3))
    for row, (of_plan, of_up) in enumerate(((0.999, 0.999), (0.999, 1.001), (1.001, 0.999), (0.0, 0.999))):
        covariance[row] = np.diag(np.square([of_plan * horizontal, 0.0, of_up * vertical]))
    first = [order.name for order in survey_orders()].index("1a/1b")
    assert (orders_met(np.full(4, 10.0), covariance) <= first).tolist() == [True, False, False, True]


RNG = np.random.default_rng(5)
TRUE = soundings(2000, 0.0)[0]
LEVEL = 8.0 + 0.1 * RNG.normal(size=2000)  # depths that do not go with each other have no slope
NOISE = RNG.normal(size=2000)


@pytest.mark.parametrize(
    ("compiled", "sounded", "sigma", "words"),
    [
        *((TRUE + 0.1 * NOISE, scale * TRUE, 0.1, words) for scale, words in (
            (3.2808, "feet"), (0.5468, "fathoms"), (-1.0, "positive up"), (10.0, "decimetres"),
            (100.0, "centimetres"), (1.0, ""),
        )),
        (LEVEL, 100.0 * LEVEL[::-1], 0.1, "centimetres"),
        (LEVEL, LEVEL[::-1], 0.1, ""),
        # an offset beyond 3.29 times the sigma and the spread of a difference
        (TRUE + 0.4 + 0.1 * NOISE, TRUE, 0.1, "0.40 m less deep than the bottom"),
        (TRUE - 0.4 + 0.1 * NOISE, TRUE, 0.1, "0.40 m deeper than the bottom"),
        (TRUE + 0.25 + 0.1 * NOISE, TRUE, 0.1, ""),
        (TRUE + 0.4 + 0.1 * NOISE, TRUE, 0.2, ""),
        (TRUE + 0.4 + 0.2 * NOISE, TRUE, 0.1, ""),
        # a slope within a twentieth of a unit
        *((TRUE, share * 3.281 * TRUE, 0.1, words) for share, words in ((0.96, "feet"), (1.04, "feet"))),
        # correlations of .97 and .85: below .9 a slope says nothing
        (TRUE, 3.281 * TRUE + 8.0 * NOISE, 0.1, "feet"),
    ],
)  # fmt: skip
def test_what_soundings_look_like(compiled: FloatArray, sounded: FloatArray, sigma: float, words: str) -> None:
    warning = likeness_warning(differences(compiled, sounded, sigma))
    assert (words in warning) if words else not warning


@pytest.mark.parametrize("sounded", [0.93 * 3.281 * TRUE, 1.07 * 3.281 * TRUE, 3.281 * TRUE + 18.0 * NOISE])
def test_what_soundings_do_not_look_like(sounded: FloatArray) -> None:
    assert "feet" not in likeness_warning(differences(TRUE, sounded))


WGS84 = Ellipsoid("", 6378137.0, 298.257223563)
EAST, NORTH = 290000.0, 2030000.0
IN_DEGREES = pyproj.Transformer.from_crs("EPSG:32620", "EPSG:4326").transform(EAST, NORTH)


def test_soundings_are_read_by_their_names(tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("Longitude, Latitude,Depth,sigma,id\n-64.93,18.33,2.5,0.2,A\n\n-64.94,18.34,-0.3,0.1,B\n")
    soundings = read_soundings(file)
    assert soundings.angular and soundings.names.tolist() == ["A", "B"]
    np.testing.assert_allclose(soundings.place[0] / DEGREE, [18.33, -64.93])
    assert soundings.depth.tolist() == [2.5, -0.3] and soundings.sigma.tolist() == [0.2, 0.1]
    file.write_text("x,y,z\n1,2,-3\n")
    assert read_soundings(file).depth.tolist() == [3.0] and not read_soundings(file).angular

    file.write_text(f"x,y,depth\n{EAST},{NORTH},3\n")
    assert not read_soundings(file, WGS84).angular
    mapped = read_soundings(file, WGS84, crs="EPSG:32620")
    assert mapped.angular
    np.testing.assert_allclose(mapped.place[0] / DEGREE, IN_DEGREES, atol=1e-9)  # 0.1 mm


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n", "no columns lon, lat, depth or lon, lat, height or x, y, depth or x, y, height among a, b"),
        ("x,y,depth\n", "no sounding"),
        ("x,y,depth,z\n1,2,3,4\n", "columns depth and height: one is meant"),
    ],
)
def test_files_that_cannot_be_used(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(SoundingError, match=message):
        read_soundings(tmp_path / "s.csv")


def test_dates_are_read_where_they_are_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("x,y,depth,Date\n1,2,3,1979-12-31\n1,2,4,\n1,2,5,\n")
    assert read_soundings(file, dated=True).date.astype(str).tolist() == ["1979-12-31", "NaT", "NaT"]
    file.write_text("x,y,depth,Date\n1,2,3,12/31/79\n1,2,4,1979-02-30\n")
    assert np.isnat(read_soundings(file).date).all()
    with pytest.raises(SoundingError, match="3 cols 7-16 date: '1979-02-30' is not a date YYYY-MM-DD"):
        read_soundings(file, dated=True)
    file.write_text("x,y,depth\n1,2,3\n")
    with pytest.raises(SoundingError, match="no column date"):
        read_soundings(file, dated=True)


def cloud(crs: str = "", **columns: list[float]) -> Points:
    xyz = np.array([[EAST, NORTH, -3.5], [EAST + 100.0, NORTH + 50.0, 0.25]])
    values = {name: LayerColumn.of(np.array(of), "m") for name, of in columns.items()}
    return Points(xyz=xyz, columns=values, crs=pyproj.CRS(crs) if crs else None)


def test_las_files(tmp_path: Path) -> None:
    """Heights with the opposite sign, or the extra bytes depth and sigma; places by the system of the file."""
    file = tmp_path / "s.laz"
    las.write(file, cloud())
    plain = read_soundings(file)
    np.testing.assert_allclose(plain.depth, [3.5, -0.25], atol=1e-4)  # the scale of the file
    np.testing.assert_allclose(plain.place, [[EAST, NORTH], [EAST + 100.0, NORTH + 50.0]], atol=1e-4)
    assert not plain.angular and np.isnan(plain.sigma).all() and plain.names.tolist() == ["1", "2"]
    las.write(file, cloud("EPSG:32620", depth=[3.1, 0.5], sigma=[0.1, 0.2]))
    mapped = read_soundings(file, WGS84)
    np.testing.assert_allclose(mapped.place[0] / DEGREE, IN_DEGREES, atol=1e-9)  # 0.1 mm
    assert mapped.angular and mapped.depth.tolist() == [3.1, 0.5] and mapped.sigma.tolist() == [0.1, 0.2]
    with pytest.raises(SoundingError, match="the job in a local one"):
        read_soundings(file, None)
    with pytest.raises(SoundingError, match="no column date"):
        read_soundings(file, WGS84, dated=True)
    las.write(file, cloud(depth=[3.1, np.nan]))
    with pytest.raises(SoundingError, match="1 points have no depth, point 2 first"):
        read_soundings(file)
    (tmp_path / "t.las").write_text("x")
    with pytest.raises(ProblemsError, match="LAS"):
        read_soundings(tmp_path / "t.las")


def sample(number: int = 60) -> tuple[DepthDifferences, np.ndarray]:
    """Return differences that grow with depth, the first a blunder, and their places."""
    draws = np.random.default_rng(5)
    sounded = np.linspace(1.0, 20.0, number)
    compiled = sounded + 0.2 - 0.05 * sounded + 0.05 * draws.normal(size=number)
    compiled[0] += 9.0
    return differences(compiled, sounded), np.column_stack(
        [np.arange(number), 100.0 + draws.uniform(0.0, 9.0, number)]
    )


def test_lines_and_dots_stand_where_the_numbers_say() -> None:
    given, xy = sample()
    against, by_size, on_map = difference_figure(given, xy, "s").axes[:3]
    lines = {line.get_label(): np.array(line.get_data()) for line in against.lines}
    np.testing.assert_array_equal(lines["soundings"], [given.sounded[1:], given.compiled[1:]])
    np.testing.assert_array_equal(lines["blunders"], [given.sounded[:1], given.compiled[:1]])
    np.testing.assert_array_equal(*lines["1:1"])
    line = regression(given)
    assert line is not None
    (label,) = (label for label in lines if label.endswith("x depth"))
    x, y = lines[label]
    np.testing.assert_allclose(y - x, line.a + line.b * x, atol=1e-12)  # rounding
    assert label == f"{line.a:+.3f} m {line.b:+.4f} x depth" and line.a > 0.1 > -0.04 > line.b
    assert sum(bar.get_height() for bar in by_size.patches) == 59
    shoaler, deeper = on_map.collections
    low, high = shoaler.get_clim()
    assert low == -high and 0.5 < high < 1.0 and deeper.get_clim() == (low, high)  # zero is the pale middle
    named = [line for line in on_map.lines if line.get_label().startswith("compiled")]
    assert {line.get_label(): line.get_marker() for line in named} == {
        "compiled shoaler": "^",
        "compiled deeper": "v",
    }
    np.testing.assert_array_equal(deeper.get_offsets(), xy[1:][given.difference[1:] > 0.0])
    assert (shoaler.get_array() <= 0.0).all() and len(shoaler.get_offsets()) + len(deeper.get_offsets()) == 59
    assert all(", m" in axes.get_xlabel() + axes.get_ylabel() for axes in (against, by_size, on_map))
    for number in (1, 2, 3):  # few soundings are drawn too
        rows = np.arange(len(xy)) < number
        assert len(difference_figure(given[rows], xy[rows], "few").axes[2].child_axes) == 1  # bar of colours
