"""The water at exposures: levels between and beyond the readings of a gauge, and clocks that are hours off."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from musatpy.files import write_files
from musatpy.formats.job_folder import files_of_tables
from musatpy.model import ObservationKind
from musatpy.pointfiles.gauges import Tide, read_tide
from musatpy.sfm import tides
from musatpy.sfm.model import ModelError

NOON = 1715947200.0  # 2024-05-17 12:00 UTC
PERIOD = 12.42 * 3600.0


def height(time: np.ndarray) -> np.ndarray:
    """Return a tide of 1.5 m with its quarter-diurnal part, which makes it lopsided."""
    phase = 2.0 * np.pi * (time - NOON) / PERIOD
    return 1.5 * np.sin(phase) + 0.2 * np.cos(2.0 * phase)


def gauge(step: float, hours: float = 24.0, noise: float = 0.0, seed: int = 1) -> Tide:
    """Return readings every `step` s about noon."""
    time = NOON + np.arange(-1800.0 * hours, 1800.0 * hours + 1.0, step)
    level = height(time) + noise * np.random.default_rng(seed).normal(size=len(time))
    return Tide(file="tide.csv", time=time, level=level, sigma=np.full(len(time), noise))


def read(tmp_path: Path, text: str, **others: float) -> Tide:
    (tmp_path / "tide.csv").write_text(text)
    return read_tide(tmp_path / "tide.csv", ModelError, **{"sigma": 0.02} | others)


def refusals(error: pytest.ExceptionInfo[ModelError]) -> list[str]:
    return [problem.headline().rpartition("/tide.csv")[2] for problem in error.value.problems]


@pytest.mark.parametrize("step", [360.0, 900.0, 1800.0])
def test_levels_without_noise_are_as_good_as_their_sigmas(step: float) -> None:
    time = NOON + np.random.default_rng(2).uniform(-9.0, 9.0, 400) * 3600.0
    level, sigma = gauge(step).at(time)
    error = level - height(time)
    assert np.abs(error).max() < 0.02
    # readings left out make gaps twice as long: the error is measured there, and taken down as its square
    assert 0.1 < np.sqrt(np.mean(error**2)) / np.sqrt(np.mean(sigma**2)) < 1.3


def test_an_error_of_all_readings_is_in_the_sigma_and_is_not_taken_for_one_of_interpolation() -> None:
    time = NOON + np.random.default_rng(3).uniform(-9.0, 9.0, 300) * 3600.0
    whole = gauge(360.0)
    level, sigma = replace(whole, level=whole.level + 0.03, sigma=whole.sigma + 0.03).at(time)
    assert np.abs((level - height(time)) / sigma - 1.0).max() < 0.01
    noisy, sigma = gauge(360.0, noise=0.03).at(time)
    # errors that are independent are less between two readings
    assert 0.7 < np.sqrt(np.mean((noisy - height(time)) ** 2)) / 0.03 < 1.0
    assert np.abs(sigma / 0.03 - 1.0).max() < 0.01


def test_noise_of_readings_that_are_left_out_is_taken_off() -> None:
    errors, squares, middle = [], [], NOON + np.array([3600.0])
    for seed in range(40):
        whole = gauge(60.0, noise=0.03, seed=seed)
        out = np.abs(whole.time - middle) < 600.0
        tide = Tide(file="", time=whole.time[~out], level=whole.level[~out], sigma=whole.sigma[~out])
        level, sigma = tide.at(middle)
        errors.append(level - height(middle))
        squares.append(sigma**2 - 0.03**2 / 2)  # of independent readings at both ends
    # within 1 sigma of 40 errors; with the noise of what is compared with it would be .8 of this
    assert 0.89 < np.sqrt(np.mean(np.square(errors)) / np.mean(squares)) < 1.11


def test_the_sigma_grows_in_a_gap_and_is_that_of_the_readings_at_its_ends() -> None:
    whole = gauge(60.0, noise=0.001)
    out = np.abs(whole.time - NOON - 3600.0) < 840.0
    tide = Tide(file="", time=whole.time[~out], level=whole.level[~out], sigma=whole.sigma[~out])
    ends = NOON + 3600.0 + np.array([-840.0, 0.0, 840.0])
    level, sigma = tide.at(ends)
    assert sigma[[0, 2]].tolist() == [0.001, 0.001] and sigma[1] > 0.0015
    assert abs(level[1] - height(ends[1:2])[0]) < 3.0 * sigma[1]


def test_levels_of_photos_stand_above_their_datum_in_flights() -> None:
    time = NOON + np.array([5000.0, 0.0, 60.0, 5100.0])
    levels = tides.tide_levels(gauge(600.0), list("abcd"), time, np.array([40.0, 41.0, 42.0, 43.0]))
    np.testing.assert_allclose(levels.level - height(time), [40.0, 41.0, 42.0, 43.0], atol=1e-3)
    assert levels.group.tolist() == ["FLIGHT2", "FLIGHT1", "FLIGHT1", "FLIGHT2"]
    given = tides.given_levels(-0.3, 0.05, np.full(3, np.nan))
    assert given.level.tolist() == [-0.3] * 3 and given.sigma.tolist() == [0.05] * 3
    assert given.group.tolist() == ["FLIGHT1"] * 3
    assert tides.flights(np.zeros(0)).tolist() == []


def test_every_photo_without_a_level_is_named_with_its_time() -> None:
    whole = gauge(600.0, hours=10.0)
    out = np.abs(whole.time - NOON) < 1000.0
    tide = Tide(file="/tide.csv", time=whole.time[~out], level=whole.level[~out], sigma=whole.sigma[~out])
    time = NOON + np.array([-1200.0, 0.0, 86400.0, 19000.0, np.nan, -1201.0])
    with pytest.raises(ModelError) as caught:
        tides.tide_levels(tide, list("abcdef"), time, np.zeros(6))
    span = "2024-05-17 07:00:00 UTC to 2024-05-17 17:00:00 UTC"
    assert refusals(caught) == [
        ": photo b, 2024-05-17 12:00:00 UTC: no reading for more than 30 minutes, from 2024-05-17 11:40:00 UTC to"
        " 2024-05-17 12:20:00 UTC",
        f": photo c, 2024-05-18 12:00:00 UTC: the tide is of another day, {span}",
        f": photo d, 2024-05-17 17:16:40 UTC: readings are from {span}, and go no further",
        ": photo e, it has no time of exposure, or one of no zone",
    ]


def test_tables_of_readings(tmp_path: Path) -> None:
    noaa = "Date Time, Water Level, Sigma, Quality\n" + "".join(
        f"2024-05-17 1{hour}:{minute:02d},{hour}.5,,v\n" for hour in range(2) for minute in range(0, 60, 10)
    )
    tide = read(tmp_path, noaa, zone="UTC")
    assert tide.time[0] == NOON - 7200.0 and tide.level.tolist() == [0.5] * 6 + [1.5] * 6
    assert tide.sigma.tolist() == [0.02] * 12
    parted = "level [m];sigma;date;time\n" + "".join(
        f"0,5;0,01;2024-05-17;14:{m:02d}:00\n" for m in (4, 3, 2, 1, 0)
    )
    tide = read(tmp_path, parted, zone="Europe/Berlin")
    assert (tide.time - NOON).tolist() == [0.0, 60.0, 120.0, 180.0, 240.0] and tide.sigma[0] == 0.01
    stated = "time,level\n" + "".join(f"2024-05-17T13:{m}0:00+01:00,1\n" for m in range(5))
    assert read(tmp_path, stated, zone="-05:00").time[0] == NOON


def test_what_is_wrong_with_readings_is_told_with_its_place(tmp_path: Path) -> None:
    rows = ["2024-05-17T10:00Z", "2024-05-17T10:10Z", "2024-05-17 10:20", "17.5.2024", "2024-05-17T11:10+01:00"]
    with pytest.raises(ModelError) as caught:
        read(tmp_path, "time,level\n" + "".join(f"{row},1\n" for row in rows))
    assert refusals(caught) == [
        ":4 cols 1-16 time: '2024-05-17 10:20' states no time zone; expected: Z or +hh:mm, or --zone, --tide-zone",
        ":5 cols 1-9 time: '17.5.2024' is no date and time YYYY-MM-DD hh:mm, nor seconds",
        ":6 cols 1-22 time: '2024-05-17T11:10+01:00' stands there twice",
    ]
    with pytest.raises(ModelError) as caught:
        read(tmp_path, "time,level\n2024-05-17T10:00Z,1\n2024-05-17T10:10Z,2\n", sigma=np.nan)
    assert refusals(caught) == [
        ":1: readings have no sigma; expected: a column sigma, or a sigma of all readings",
        ":1: 2 readings do not say how well they are interpolated; expected: 3 or more",
    ]
    for text, why in (
        ("time,level [ft]\n", ":1: column level is in ft: m is needed"),
        ("time,level\n2024-05-17T10:00Z,nan\n", ":2 cols 19-21 level: 'nan' is not a number"),
        ("time,level\n", ": there are no readings"),
    ):
        with pytest.raises(ModelError) as caught:
            read(tmp_path, text)
        assert refusals(caught) == [why]


def test_the_zero_of_a_tide_is_a_height_or_a_grid(tmp_path: Path) -> None:
    position = np.radians([[45.5, 10.5, 0.0], [45.25, 10.75, 0.0]])
    assert tides.datum_heights("-3.25", position).tolist() == [-3.25, -3.25]
    # GTX: corner, steps, rows and columns, then rows from the south on, all big-endian
    head = np.array([45.0, 10.0, 1.0, 1.0], dtype=">f8").tobytes() + np.array([2, 2], dtype=">i4").tobytes()
    (tmp_path / "zero.gtx").write_bytes(head + np.array([1.0, 2.0, 3.0, 4.0], dtype=">f4").tobytes())
    heights = tides.datum_heights(str(tmp_path / "zero.gtx"), position)
    np.testing.assert_allclose(heights, [2.5, 1.0 + 0.75 + 2.0 * 0.25], atol=1e-6)
    with pytest.raises(ModelError, match="the datum 'LAT' is neither a height in metres nor a grid"):
        tides.datum_heights("LAT", position)


@pytest.mark.parametrize("shift", [-2, 0, 1])
def test_a_clock_off_by_a_zone_is_named_by_the_levels_of_a_run(shift: int, tmp_path: Path) -> None:
    """Levels of three flights that images find, .04 m each; the tide pulls them, and keeps a fifth of its error."""
    rng = np.random.default_rng(5)
    time = NOON + 4000.0 + np.repeat([0.0, 4000.0, 9000.0], 10) + np.tile(np.arange(10.0), 3)
    levels = tides.tide_levels(gauge(600.0, hours=48.0, noise=0.01), ["a.jpg"] * 30, time, np.full(30, 5.0))
    write_files(files_of_tables({}, tmp_path / "a.job", levels.kept(time)))
    first, share = np.array([0, 10, 20]), np.full(3, 0.2)
    found = height(time[first] + 3600.0 * shift) + 5.0 + rng.normal(0.0, 0.04, 3)
    kind, sigma = np.full(3, ObservationKind.WATER_LEVEL), 0.04 * np.sqrt(share)
    residual = share * (found - levels.level[first])
    observed = SimpleNamespace(kind=kind, row=np.arange(3), residual=residual, sigma=sigma, redundancy=share)
    water = SimpleNamespace(correction_ids=np.array(["FLIGHT1", "FLIGHT2", "FLIGHT3"]))
    note = tides.clock_note(tmp_path / "a.job", SimpleNamespace(observed=observed, water=water))
    assert (f"that of the tide {shift:+d} hours off: is the zone of a clock wrong?" in note) == (shift != 0)
    assert bool(note) == (shift != 0)


def test_hours_that_fit_a_level() -> None:
    """One level of a tide that rises and falls fits twice in half a day; beyond the readings nothing does."""
    tide, time, sigma = gauge(600.0, hours=30.0, noise=0.01), np.array([NOON]), np.array([0.05])
    hours = tides.fitting_hours(tide, time, height(time + 2.0 * 3600.0), sigma)
    assert 2 in hours and 1 < len(hours) < 9 and hours == sorted(hours, key=abs)
    assert tides.fitting_hours(tide, time + 1e6, np.zeros(1), sigma) == []
    assert tides.fitting_hours(tide, time, height(time), sigma) == []
