"""`musat tide`: heights of the water by hand, sigmas that errors keep, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from musatpy.pointfiles.gauges import Tide

SERIES = """time,height
1976-04-12T11:00:00Z,0.10
1976-04-12T11:10:00Z,0.16
1976-04-12T11:20:00Z,0.20
1976-04-12T11:30:00Z,0.22
1976-04-12T12:30:00Z,0.10
"""
DECK = Path(__file__).parents[2] / "fixtures" / "bad_decks" / "good.crd"
# Slopes at 11:00 and 11:10 by hand (m in 10 minutes): of three points (3 .06 - .04) / 2 = .07, and the harmonic
# mean of .06 and .04, .048. In the middle the cubic of Hermite is (.10 + .16) / 2 + (.07 - .048) / 8.
BY_HAND = 0.13275


def tides(folder: Path, times: str, *options: str, series: str = SERIES):
    (folder / "series.csv").write_text(series)
    (folder / "times.csv").write_text(times)
    return musat(
        "tide", DECK, "--series", folder / "series.csv", "--times", folder / "times.csv", "-o", folder / "new.crd",
        *options,
    )  # fmt: skip


def test_heights_by_hand_stand_on_the_cards_and_all_else_stays(tmp_path: Path) -> None:
    times = "photo,time\n841,1976-04-12T11:05:00Z\n842,1976-04-12T11:10:00Z\n843,1976-04-12T13:05:00+02:00\n"
    result = tides(tmp_path, times, "--datum", "1.0", "--sigma", "0.01")
    assert result.exit_code == 0, result.output
    new, old = (tmp_path / "new.crd").read_text().splitlines(), DECK.read_text().splitlines()
    assert [a for a, b in zip(new, old, strict=True) if a != b] == [line for line in new if line[:3] == "TID"]
    heights = [float(line[13:23]) for line in new if line.startswith("TID")]
    # the card has four decimals
    np.testing.assert_allclose(heights, [1.0 + BY_HAND, 1.16, 1.0 + BY_HAND], atol=5.1e-5)
    assert float(new[12][24:32]) == 0.01  # at a reading there is no gap
    assert 0.01 <= float(new[11][24:32]) < 0.02


def test_a_photo_without_a_card_gets_one_and_times_of_cards_count_from_the_clock(tmp_path: Path) -> None:
    cards = [line for line in DECK.read_text().splitlines() if not line.startswith("TID 843")]
    row = next(row for row, line in enumerate(cards) if line.startswith("TID 841"))
    cards[row] = "TID 841          9.0000                               300.000"
    (tmp_path / "deck.crd").write_text("\n".join(cards) + "\n")
    (tmp_path / "series.csv").write_text(SERIES)
    (tmp_path / "times.csv").write_text("photo;time\n" + "".join(f"84{n};1976-04-12T11:05Z\n" for n in (1, 2, 3)))
    by_times = ("--times", tmp_path / "times.csv")
    for options in (by_times, ("--clock", "1976-04-12T11:00:00Z")):
        result = musat(
            "tide", tmp_path / "deck.crd", "--series", tmp_path / "series.csv", "--datum", "0", "-o", "-", *options
        )
        if options == by_times:
            made = result.stdout.splitlines()
            assert made[-2].startswith("TID 843") and made[-1].startswith("END")
            heights = [float(line[13:23]) for line in made if line.startswith("TID")]
            np.testing.assert_allclose(heights, [BY_HAND] * 3, atol=5.1e-5)
        else:  # 841 has a time on its card, the others have none
            assert result.exit_code == 1
            assert "photo 841" not in result.stderr and "photo 842, it has no time of exposure" in result.stderr


@pytest.mark.parametrize(
    ("times", "options", "message"),
    [
        ("841,1976-04-12T11:05:00Z\n", ("--datum", "0"), "photo 842, it has no time of exposure"),
        (
            "841,1976-04-12T10:59:00Z\n",
            ("--datum", "0"),
            "photo 841, 1976-04-12 10:59:00 UTC: readings are from 1976-04-12 11:00:00 UTC to",
        ),
        ("841,1976-04-12T12:31:00Z\n", ("--datum", "0"), "photo 841, 1976-04-12 12:31:00 UTC: readings are from"),
        (
            "841,1976-04-12T11:45:00Z\n",
            ("--datum", "0"),
            "photo 841, 1976-04-12 11:45:00 UTC: no reading for more than 30 minutes",
        ),
        (
            "841,1976-04-12T11:05:00\n",
            ("--datum", "0"),
            "cols 5-23 time: '1976-04-12T11:05:00' states no time zone",
        ),
        (
            "841,noon\n",
            ("--datum", "0"),
            "times.csv:2 cols 5-8 time: 'noon' is no date and time YYYY-MM-DD hh:mm, nor seconds",
        ),
        ("841,1976-04-12T11:05:00Z\n", (), "Missing option '--datum'"),
    ],
)
def test_what_has_no_tide_is_refused(tmp_path: Path, times: str, options: tuple[str, ...], message: str) -> None:
    result = tides(tmp_path, f"photo,time\n{times}", *options)
    assert result.exit_code == (1 if options else 2)
    assert message in result.stderr and not (tmp_path / "new.crd").exists()


def test_readings_of_one_time_are_refused(tmp_path: Path) -> None:
    lines = SERIES.splitlines()
    result = tides(tmp_path, "photo,time\n841,0\n", "--datum", "0", series="\n".join([*lines, lines[2]]))
    assert "series.csv:7 cols 1-20 time: '1976-04-12T11:10:00Z' stands there twice" in result.stderr


def test_seconds_of_no_date_are_times_too(tmp_path: Path) -> None:
    series = "date,height\n" + "".join(f"{600 * n},{n / 100}\n" for n in range(4))
    times = "photo,time\n841,600\n842,1200\n843,2000\n"
    result = tides(tmp_path, times, "--datum", "0", series=series)
    assert "photo 843, 2000 s: readings are from 0 s to 1800 s, and go no further" in result.stderr
    assert "841" not in result.stderr


@pytest.mark.parametrize("gap", [600.0, 1200.0, 1800.0])
def test_errors_are_no_larger_than_their_sigmas(gap: float) -> None:
    """Of a tide of 12.4 hours and 2 m, read without an error and with one of 20 mm."""
    draws = np.random.default_rng(3)
    at = np.arange(0.0, 86400.0 + gap, gap)

    def tide(time):
        return np.sin(2.0 * np.pi * time / 44700.0)

    time = draws.uniform(0.0, at[-1], 2000)
    height, sigma = Tide(file="", time=at, level=tide(at), sigma=np.zeros(len(at))).at(time)
    rms = np.sqrt(np.mean(np.square((height - tide(time)) / sigma)))
    assert 0.1 < rms < 1.0, rms  # a bound, not far from what errors are
    level = tide(at) + 0.02 * draws.normal(size=len(at))
    height, sigma = Tide(file="", time=at, level=level, sigma=np.full(len(at), 0.02)).at(time)
    rms = np.sqrt(np.mean(np.square((height - tide(time)) / sigma)))
    assert 0.4 < rms < 1.0, rms
