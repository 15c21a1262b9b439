"""Profiles by the coordinates of their ends, scans of lines side by side, and how fast they were read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from compilation.scenes import MODEL, deck_of_cards, flat_images, pair, stage_card
from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.profiles import profiles_of, scans_of
from musatpy.formats.compilation_deck import compilation_bytes
from musatpy.reports.compilation import DOCUMENT
from record_rows import valid_rows
from stage_readings import compilation

_RATE = 2.0  # s between readings


def depth(xy: FloatArray) -> FloatArray:
    """Return the depths (k,) of a bottom that falls to the north, with waves along X."""
    return np.asarray(12.0 + 0.002 * xy[:, 1] + 2.0 * np.sin(xy[:, 0] / 100.0))


def deck_of(xy: FloatArray, *cards: str, times: bool = True) -> Compiled:
    """Return the compilation of a profile's readings."""
    run = pair(3000.0, 1810.0)
    images = flat_images(run, np.column_stack([xy, -depth(xy)]))
    lines = [MODEL, *cards, *(stage_card("A", "PB", stages) for stages in images)]
    if times:
        clock = _RATE * np.arange(len(xy))
        lines += [
            f"PTM 1        A       {first + 1:6d}" + "".join(f"{t:9.3f}" for t in clock[first : first + 5])
            for first in range(0, len(xy), 5)
        ]
    return compiled(run, deck_of_cards(*lines))


def card(ends: str, *, step: float = 20.0, scan: str = "", name: str = "A") -> tuple[str, ...]:
    """Return the cards of a profile between places."""
    return f"PRF {name:<8} 1                          {step:8.2f}{' ' * 16}{scan}", f"PRE {name:<8} 1        {ends}"


def ends(system: str, *corners: float) -> str:
    return system + "".join(f"{corner:12.4f}" for corner in corners)


def line(count: int = 41) -> FloatArray:
    """Return readings along Y = 50 m of the job, from X = 300 to 1500 m."""
    return np.column_stack([np.linspace(300.0, 1500.0, count), np.full(count, 50.0)])


@pytest.mark.parametrize(("system", "shift"), [("J", 0.0), ("M", -905.0)])
def test_ends_may_be_places_of_the_model_or_of_the_job(system: str, shift: float) -> None:
    """The origin of the model is the middle of the base, X = 905 m."""
    result = deck_of(line(), *card(ends(system, 200.0 + shift, 50.0, 1600.0 + shift, 50.0)))
    (part,) = profiles_of(result)
    assert part.profile is not None and part.line == 1
    # Compiled points have the rounding of six decimals of a stage: 0.5 nm at 1 to 20,000, over base and height.
    np.testing.assert_allclose(part.profile.station, np.linspace(100.0, 1300.0, 41), rtol=0, atol=1e-3)
    np.testing.assert_allclose(part.profile.offset, 0.0, rtol=0, atol=1e-3)
    stations, depths, sigma, place = part.posts(result.datum)
    np.testing.assert_allclose(place[:, 0], 200.0 + stations, rtol=0, atol=1e-3)
    np.testing.assert_allclose(place[:, 1], 50.0, rtol=0, atol=1e-3)
    np.testing.assert_allclose(place[:, 2], -depths, rtol=0, atol=1e-9)
    assert (sigma <= part.sigma.max() + 1e-12).all() and (sigma > 0.7 * part.sigma.min()).all()


def side_by_side() -> FloatArray:
    """Return readings along five lines 40 m apart, X 300 to 1500 m, every other one from its end."""
    rows = []
    for number in range(5):
        x = np.linspace(300.0, 1500.0, 61)
        rows.append(np.column_stack([x[::-1] if number % 2 else x, np.full(61, 100.0 - 40.0 * number)]))
    return np.concatenate(rows)


SCAN = card(ends("J", 280.0, 100.0, 1520.0, -60.0), scan="X   40.0")


def test_readings_of_a_scan_belong_to_the_nearest_line() -> None:
    xy = np.concatenate([side_by_side(), [[700.0, 130.0], [700.0, -90.0]]])
    xy[:, 1] += np.random.default_rng(4).uniform(-15.0, 15.0, len(xy)) * (np.arange(len(xy)) < 305)
    result = deck_of(xy, *SCAN)
    *lines, beside = profiles_of(result)
    assert [part.line for part in lines] == [1, 2, 3, 4, 5] and all(len(part.rows) == 61 for part in lines)
    for number, part in enumerate(lines):
        assert part.profile is not None
        # The ends of a line are those of the scan, the first of them at its start, lines in the order of their Y.
        np.testing.assert_allclose(
            part.ends, [[280.0, 100.0 - 40.0 * number], [1520.0, 100.0 - 40.0 * number]], atol=1e-6
        )
        assert np.abs(part.profile.offset).max() < 15.1
    assert beside.line == 0 and beside.reason == "2 readings beside the lines of the scan"
    (scan,) = scans_of(result, profiles_of(result))
    assert (scan.scan, scan.spacing, len(scan.lines)) == ("X", 40.0, 5)


@pytest.mark.parametrize(("end", "lines"), [(-60.0, 5), (-60.02, 5), (-59.98, 4), (-99.0, 5), (-100.0, 6)])
def test_a_scan_has_the_lines_that_its_diagonal_has_room_for(end: float, lines: int) -> None:
    """Every 40 m from Y = 100 m; a line at the very end of the diagonal is one."""
    result = deck_of(side_by_side(), *card(ends("J", 280.0, 100.0, 1520.0, end), scan="X   40.0"))
    assert max(part.line for part in profiles_of(result)) == lines


def test_a_scan_along_y_has_its_lines_across() -> None:
    xy = side_by_side()[:, ::-1] * [1.0, 0.5] + [800.0, -500.0]
    result = deck_of(xy, *card(ends("J", 900.0, -400.0, 740.0, 300.0), scan="Y   40.0"))
    lines = profiles_of(result)
    assert [len(part.rows) for part in lines] == [61] * 5
    np.testing.assert_allclose(lines[1].ends, [[860.0, -400.0], [860.0, 300.0]], atol=1e-6)
    assert [scan.scan for scan in scans_of(result, lines)] == ["Y"]


def test_lines_without_readings_and_scans_of_no_extent_are_told() -> None:
    xy = side_by_side()
    result = deck_of(xy[xy[:, 1] != 20.0], *SCAN)
    assert [part.reason for part in profiles_of(result)] == ["", "", "0 readings with a position", "", ""]
    (part,) = profiles_of(deck_of(line(), *card(ends("J", 300.0, 50.0, 300.0, 90.0), scan="X   40.0")))
    assert part.profile is None and part.reason.startswith("the scan has no extent")


def test_the_pace_of_a_profile_is_that_of_its_stages() -> None:
    """30 m in two seconds at 1 to 19,700: 0.76 mm/s; one step of 60 m is twice as fast. Back once, two turns."""
    xy = line()[[*range(20), *range(21, 30), 25, *range(31, 41)]]
    (part,) = profiles_of(deck_of(xy, *card(ends("J", 200.0, 50.0, 1600.0, 50.0))))
    time, mean, fastest = part.pace
    assert time == pytest.approx(2.0 * (len(xy) - 1)) and part.turns == 2
    scale = 152.4 / 3012.0
    assert fastest == pytest.approx(180.0 / 2.0 * scale, rel=0.02)  # from X = 1050 m to 1230 m
    ways = np.linalg.norm(np.diff(part.stages[np.argsort(part.time)], axis=0), axis=2)
    assert ways[:, 0].max() != ways[:, 1].max()  # the bottom rises under the mark, and one stage goes farther
    assert fastest == pytest.approx(ways.max() / 2.0, rel=1e-9)
    assert 15.0 * scale < mean < 30.0 * scale
    (part,) = profiles_of(deck_of(line(), *card(ends("J", 200.0, 50.0, 1600.0, 50.0)), times=False))
    assert np.isnan(part.pace).all() and part.turns == 0


def timed(deck_folder: Path) -> Path:
    """Return the deck of the fixture with times of its readings along NS, and a scan of its bottom."""
    deck = compilation()
    stages, specs = deck.stages, deck.profiles
    rows = np.flatnonzero(stages.ids == "NS")
    time = stages.time.copy()
    time[rows] = 100.0 + np.arange(len(rows))
    path = deck_folder / "timed.crd"
    path.write_bytes(compilation_bytes(replace(deck, stages=replace(stages, time=time), profiles=specs)))
    return path


@pytest.mark.slow
def test_the_listing_has_the_pace_and_the_file_the_posts(run_record: Path, tmp_path: Path) -> None:
    """Of a job on the ellipsoid: posts stand on the line between the ends, at the height of their depths."""
    result = musat("as11", "compile", run_record, timed(tmp_path))
    assert result.exit_code == 0, result.output
    listing = (tmp_path / "timed.lst").read_text()
    assert "Pace Of Profiles" in listing
    row = valid_rows(tmp_path / "timed.json", DOCUMENT.schema())["profiles"][0]
    assert (row["profile"], row["timed"], row["duration"]) == ("NS", 31, 30.0) and row["turns"] > 10
    rows = [line.split(",") for line in (tmp_path / "timed.profiles.csv").read_text().splitlines()]
    posts = [dict(zip(rows[0], cells, strict=True)) for cells in rows if cells[:3] == ["post", "2122", "NS"]]
    np.testing.assert_allclose([float(post["longitude"]) for post in posts], -64.9352, rtol=0, atol=2e-6)
    heights = [float(post["height"]) + float(post["depth"]) for post in posts]
    np.testing.assert_allclose(heights, -0.15, rtol=0, atol=1e-3)  # printed to a millimetre
    assert len(posts) == 16 and all(0.2 < float(post["sigma"]) < 0.6 for post in posts)
