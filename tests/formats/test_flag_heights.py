"""Flags of submerged and of dry points: held against given heights and tides, printed, and never both."""

from pathlib import Path

import numpy as np
import pytest

from formats.bad_deck_cases import COMPUTE, IIIA
from formats.deck_edits import Edit, add, deck, drop, replace
from musatpy import BlockBuilder, adjust
from musatpy.errors import DeckError
from musatpy.formats import musat
from musatpy.reports.listing import listing
from musatpy.reports.record import record

LOW = replace(43, "   17.0386", "  -17.0386")  # a vertical control point on photos 841 and 842
NONE = replace(2, "WATPT   ", "NONE    ")


def told(*edits: Edit) -> list[str]:
    """Return the problems about flags of the good deck after edits."""
    _, problems = musat.check_deck(deck(*edits))
    return [f"{one.line} {one.severity} {one.message}" for one in problems if "submerged" in one.message]


def flagged(flag: str, point: str) -> Edit:
    """Return the edit that flags a point on all its cards."""

    def edit(lines: list[str]) -> list[str]:
        column = {"PLT": 61, "CTG": 14}
        return [
            f"{line[: column[line[:3]]]}{flag}{line[column[line[:3]] + 1 :]}"
            if line[:3] in column and point in line[3:22].split()
            else line
            for line in lines
        ]

    return edit


def without_flags() -> Edit:
    return lambda lines: [f"{line[:61]} {line[62:]}" if line[:3] == "PLT" else line for line in lines]


def test_a_low_point_without_flag_is_told() -> None:
    (text,) = told(LOW)
    assert text.startswith(
        "43 warning point 1103, -17.0386 m: 17.24 m (172.4 sigmas) below the water of all its photos"
    )


@pytest.mark.parametrize(
    "edits",
    [
        (),
        (LOW, flagged("B", "1103")),  # it is submerged
        (LOW, flagged("D", "1103")),  # or dry for certain
        (replace(43, "   17.0386", "   -0.1990"),),  # 3.99 sigmas
        (replace(43, "   17.0386", "    0.2200"),),  # below the water of photo 842, above that of 841
        (LOW, replace(43, "V ", "H ")),  # an approximate height
        (LOW, NONE, without_flags()),  # nothing is refracted
        (LOW, drop(12, 13, 14), without_flags()),  # no tide
        (LOW, replace(4, "WTR 1.340000                   ", "WTR 1.340000             10.000")),  # tilted water
        (LOW, IIIA, add("OP2                ONE")),  # levels that nothing is known of
    ],
)
def test_what_is_consistent_or_not_known_is_not_told(edits: tuple[Edit, ...]) -> None:
    assert told(*edits) == []


def test_a_high_point_with_flag_is_told() -> None:
    (text,) = told(flagged("B", "1105"))
    assert text.startswith(
        "44 warning point 1105, 14.0384 m: 13.74 m (137.4 sigmas) above the water of all its photos"
    )
    assert told(replace(44, "   14.0384", "    0.6990"), flagged("B", "1105")) == []
    assert len(told(replace(44, "   14.0384", "    0.7010"), flagged("B", "1105"))) == 1


def test_sigmas_of_tides_count() -> None:
    tides = [replace(n, f"0.{height}00        ", f"0.{height}00  5.0000") for n, height in ((12, 20), (13, 25))]
    assert told(LOW, *tides) == told(LOW, tides[0]) == []  # 3.4 sigmas


def test_tides_without_flags_are_told_unless_refraction_is_none() -> None:
    (text,) = told(without_flags())
    assert text.startswith("12 warning 3 TID cards, and no point is flagged as submerged: nothing is refracted")
    assert told(without_flags(), NONE) == []
    assert told(without_flags(), drop(12, 13, 14)) == []  # the water card of a template
    assert told(without_flags(), add(COMPUTE)) == told(without_flags())


def test_what_is_dry_for_certain_is_printed_and_recorded_and_changes_nothing() -> None:
    """Two points of St. Thomas on land, flagged D on all their plate cards."""
    path = Path("fixtures/st_thomas/st_thomas.crd")
    cards = path.read_text().splitlines()
    images = [line[:3] == "PLT" and line[13:21].strip() in ("204", "220") for line in cards]
    cards = [f"{line[:61]}D{line[62:]}" if image else line for line, image in zip(cards, images, strict=True)]
    solution = adjust(musat.read_deck("\n".join([*cards, ""]).encode()))
    points, lines = record(solution)["points"], listing(solution).splitlines()
    assert [name for name, dry in zip(points["point"], points["dry"], strict=True) if dry] == ["204", "220"]
    at = next(line.index("Dry") for line in lines if line.startswith("Point") and "Dry" in line)
    assert sum(line[:8].strip() in ("204", "220") and line[at : at + 1] == "D" for line in lines) == 2
    echo = [line for line in lines if line[10:18].strip() in ("204", "220") and line.split()[-1] == "D"]
    assert len(echo) == 2 * sum(images)  # as given, and as adjusted
    plain = adjust(musat.read_deck(path))
    np.testing.assert_array_equal(plain.points.position, solution.points.position)


def test_a_block_cannot_have_both_flags() -> None:
    builder = BlockBuilder()
    builder.add_images("1", ["A"], [[0.0, 0.0]], submerged=True)
    builder.add_images("2", ["A"], [[0.0, 0.0]], dry=True)
    messages = [problem.message for problem in builder.check()]
    assert messages.count("point A is flagged bathymetric and dry: one or the other") == 2
    with pytest.raises(DeckError):
        builder.build()
