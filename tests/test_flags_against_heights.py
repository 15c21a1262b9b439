"""Points whose heights contradict their flags, and datums of water and control: what the verdict says of them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from altered import added, altered, put, with_options
from blocks import FIXTURES
from musatpy import adjust, model, read_deck, verdict
from musatpy.reports.listing import listing
from musatpy.reports.record import record
from musatpy.statistics import Statistics
from musatpy.statistics.gates import LEAST_LIMIT

OF_FLAGS = (model.Concern.FLAGS, model.Concern.DATUM)
DOUBTFUL = model.Grade.DOUBTFUL
FORGOTTEN = ("203", "206", "212", "218", "210", "219")  # deep enough for their heights to tell


@cache
def st_thomas() -> model.Block:
    return read_deck(FIXTURES / "st_thomas/st_thomas.crd")


@cache
def case(name: str) -> model.Solution:
    return adjust(read_deck(FIXTURES / f"trust/{name}.crd"))


def with_flags(block: model.Block, wet: bool, *names: str) -> model.Block:
    at = np.isin(block.points.ids, names)
    return altered(block, points={"bathymetric": put(at, wet)})


def of_flags(solution: model.Solution) -> list[model.Reason]:
    return [reason for reason in verdict(solution).reasons if reason.concern in OF_FLAGS]


def height(solution: model.Solution, name: str) -> float:
    return float(solution.points.position[solution.block.points.ids == name][0, 2])


def table(solution: model.Solution) -> dict[str, tuple[float, float | None]]:
    """Return both heights of the points in doubt, as recorded."""
    rows = record(solution)["flags_against_heights"]
    return dict(zip(rows["point"], zip(rows["height"], rows["other_height"], strict=True), strict=True))


@cache
def without(name: str) -> model.Solution:
    return adjust(with_flags(st_thomas(), False, name))


def test_the_printed_strip_is_consistent_with_its_water() -> None:
    solution = adjust(st_thomas())
    assert verdict(solution).grade is model.Grade.ACCEPTED and solution.other_flags is None
    assert record(solution)["flags_against_heights"]["point"] == []
    assert "Flags Against Heights" not in listing(solution)
    assert not verdict(solution).notes  # on 202, 205, 208: they are on the shore line


@pytest.mark.parametrize("name", ["219", *(pytest.param(name, marks=pytest.mark.slow) for name in FORGOTTEN[:-1])])
def test_a_forgotten_flag_is_named_with_both_heights(name: str) -> None:
    solution, right = without(name), height(adjust(st_thomas()), name)
    (reason,) = of_flags(solution)[:1]
    assert reason == verdict(solution).reasons[0]
    assert (reason.grade, reason.concern) == (DOUBTFUL, model.Concern.FLAGS)
    assert reason.text.startswith(f"point {name} is not flagged as submerged (B), but up to ")
    assert table(solution) == {name: pytest.approx((height(solution, name), right), abs=1e-3)}
    assert f"at {height(solution, name):.3f} m, with the flag at {table(solution)[name][1]:.3f} m" in reason.text
    assert "v'Pv" not in reason.text  # which cannot choose the flag here
    assert solution.causes[0].kind is model.CauseKind.FLAG and solution.causes[0].points == (name,)


def test_a_shallow_point_moves_little_without_its_flag_and_is_noted() -> None:
    for name in ("ROCK", "209"):
        solution = without(name)
        moved = abs(height(solution, name) - height(adjust(st_thomas()), name))
        at = solution.block.points.ids == name
        assert moved < 4.0 * float(Statistics(solution).point_sigmas[at][0, 2])
        assert not of_flags(solution)
    (note,) = verdict(without("209")).notes
    assert note.startswith(
        "point 209 is not flagged as submerged, but below the water of some photos, or of all by less"
    )


def test_the_limit_is_that_of_the_points_tested_and_four_at_least() -> None:
    solution = without("219")
    tests = Statistics(solution).flags
    row = int(tests.doubted[0])
    assert tests.limit == LEAST_LIMIT and len(tests.point) == 22
    assert tests.sigmas[row] == pytest.approx((tests.water[row] - tests.height[row]) / tests.sigma[row])

    def doubted(raised: float) -> bool:
        return bool(of_flags(altered(solution, points={"position": added((tests.point[row], 2), raised)})))

    assert doubted((tests.sigmas[row] - 4.01) * tests.sigma[row])
    assert not doubted((tests.sigmas[row] - 3.99) * tests.sigma[row])
    many = replace(tests, limit=6.0)
    assert len(many.doubted) == int((tests.sigmas > 6.0).sum())


def test_all_forgotten_flags_are_tried_together() -> None:
    solution = case("forgot_all_B")
    (reason,) = of_flags(solution)
    assert (reason.grade, reason.concern) == (DOUBTFUL, model.Concern.FLAGS)
    assert set(table(solution)) == set(FORGOTTEN)
    assert solution.other_flags is not None and solution.other_flags.consistent
    # with their flags they lie where they do in the strip with all flags: 209 and ROCK lack theirs, and are shallow
    for name, (_, other) in table(solution).items():
        assert other == pytest.approx(height(adjust(st_thomas()), name), abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 1])
def test_half_of_the_flags_forgotten_is_no_matter_of_datums(first: int) -> None:
    names = st_thomas().points.ids[st_thomas().points.bathymetric][first::2].tolist()
    reasons = of_flags(adjust(with_flags(st_thomas(), False, *names)))
    assert reasons[0].concern is model.Concern.FLAGS
    assert all(reason.grade is DOUBTFUL for reason in reasons)


def test_a_flagged_point_above_the_water_is_doubted() -> None:
    solution = adjust(with_flags(st_thomas(), True, "204"))
    (reason,) = of_flags(solution)
    assert (reason.grade, reason.concern) == (DOUBTFUL, model.Concern.FLAGS)
    assert reason.text.startswith("point 204 is flagged as submerged (B), but up to ")
    assert "above the water of all their photos" in reason.text and "without the flag" in reason.text
    assert table(solution)["204"][1] == pytest.approx(height(adjust(st_thomas()), "204"), abs=1e-6)


def test_points_that_are_dry_for_certain_are_not_doubted() -> None:
    forgotten = with_flags(st_thomas(), False, "212")
    dry = altered(forgotten, points={"dry": put(st_thomas().points.ids == "212", True)})
    solution = adjust(dry)
    assert not of_flags(solution)
    assert "Points flagged D, dry for certain ................ 1" in listing(solution)


def test_without_a_tide_there_is_no_test() -> None:
    block = with_flags(st_thomas(), False, *st_thomas().points.ids)
    assert of_flags(adjust(block))
    assert not of_flags(adjust(altered(block, photos={"tide": np.full(3, np.nan)})))
    # of two photos with the point, one without a tide: it can be doubted, and not be flagged
    solution = adjust(altered(block, photos={"tide": put(0, np.nan)}))
    assert table(solution)["218"][1] is None and table(solution)["206"][1] is None
    assert table(solution)["210"][1] is not None


def test_all_its_photos_must_stand_under_water() -> None:
    # 212 is on photos 21 and 22
    block = altered(with_flags(st_thomas(), False, "212"), photos={"tide": put(0, -8.0)})
    solution = adjust(block)
    assert "212" not in table(solution)
    assert any("212" in note for note in verdict(solution).notes)


def test_a_sigma_of_the_tide_counts() -> None:
    block = with_flags(st_thomas(), False, "219")
    assert of_flags(adjust(block))
    assert not of_flags(adjust(altered(block, photos={"tide_sigma": np.full(3, 1.0)})))


@pytest.mark.slow
def test_check_points_and_points_kept_out_count() -> None:
    block, point = with_flags(st_thomas(), False, "212"), st_thomas().points.ids.tolist().index("212")
    kept_out = altered(block, plates={"triangulated": put(block.plates.point == point, False)})
    assert of_flags(adjust(kept_out))[0].text.startswith("point 212")
    control = altered(block, control={"point": put(block.control.kind == model.ControlKind.CHECK, point)})
    assert "point 212" in of_flags(adjust(control))[0].text


def test_adjusted_water_is_the_one_that_counts() -> None:
    options = {"program": model.Program.IIIA, "refraction": model.Refraction.RIGOROUS}
    block = with_options(st_thomas(), water_level=model.WaterLevel.ONE, **options)
    solution = adjust(altered(block, photos={"tide_sigma": np.full(3, 0.3)}))
    points = solution.points
    assert solution.water is not None
    np.testing.assert_allclose(np.nanmax(points.water[:, 1]), solution.water.tide.max())
    np.testing.assert_allclose(np.nanmax(points.water_sigma), solution.water.correction_sigma[0])


def test_flagged_points_without_refraction_are_doubtful() -> None:
    solution = adjust(with_options(st_thomas(), refraction=model.Refraction.NONE))
    (reason,) = verdict(solution).reasons
    assert reason.grade is DOUBTFUL and reason.concern is model.Concern.REFRACTION
    assert reason.text.startswith(
        "refraction NONE: 8 points flagged as submerged are adjusted as if there were no water"
    )
    dry = with_options(with_flags(st_thomas(), False, *st_thomas().points.ids), refraction=model.Refraction.NONE)
    assert verdict(adjust(dry)).grade is model.Grade.ACCEPTED


def test_water_and_control_of_two_datums_are_rejected_with_the_offset() -> None:
    solution = case("tides_msl_control_ellipsoidal")
    reasons = of_flags(solution)
    assert reasons[0].grade is model.Grade.REJECTED and reasons[0].concern is model.Concern.DATUM
    assert reasons[0].text == (
        "8 of 8 points flagged as submerged are above the water: tides and control may be 40.9 to 42.7 m apart in "
        "height, the tides too low: read the datum of both again"
    )
    assert [cause.kind for cause in solution.causes] == [model.CauseKind.TIDES]  # flags are contradicted by it
    assert solution.causes[0].size[0] == pytest.approx(-42.0, abs=1.0)  # given minus true


@pytest.mark.parametrize(
    "moved", [*(pytest.param(moved, marks=pytest.mark.slow) for moved in (-42.0, -5.0, 2.0, 42.0)), -2.0, 5.0]
)
def test_land_and_control_moved_against_the_tides(moved: float) -> None:
    moved_tides = altered(st_thomas(), photos={"tide": added(..., -moved)})
    reference, solution = adjust(st_thomas()), adjust(moved_tides, causes=model.CauseSearch.NONE)
    assert verdict(solution).grade is not model.Grade.ACCEPTED
    assert verdict(solution).reasons[0].concern in OF_FLAGS
    least, most = Statistics(solution).flags.offset
    assert least <= moved <= most and np.sign(least) == np.sign(most) == np.sign(moved)
    said = " ".join(reason.text for reason in of_flags(solution))
    assert f"the tides too {'low' if moved > 0.0 else 'high'}" in said
    assert reference.converged


@pytest.mark.slow
def test_the_offset_is_that_by_which_no_flag_is_contradicted() -> None:
    block = altered(st_thomas(), photos={"tide": added(..., -5.0)})
    least, most = Statistics(adjust(block)).flags.offset
    for offset, doubts in ((least + 0.05, 0), (most - 0.05, 0), (least - 0.3, 1), (most + 0.3, 1)):
        found = len(Statistics(adjust(altered(block, photos={"tide": added(..., offset)}))).flags.doubted)
        assert bool(found) == bool(doubts), (offset, least, most, found)


def test_listing_and_record_have_each_point_in_doubt() -> None:
    text = listing(case("forgot_all_B"))
    start = text.index("\nFlags Against Heights\n", text.index("Points In") if "Points In" in text else 0)
    part = text[start : start + 2000]
    rows = [(line[0], line[1], line[-1]) for line in map(str.split, part.splitlines()) if len(line) > 1]
    for name, (given, other) in table(case("forgot_all_B")).items():
        assert (name, f"{given:.3f}", f"{other:.3f}") in rows
    assert "has the flag D" in part


@pytest.mark.slow
@pytest.mark.parametrize("editing", [model.Editing.LIST, model.Editing.EDIT])
def test_a_search_that_names_the_flag_is_not_contradicted(editing: model.Editing) -> None:
    solution = adjust(with_options(with_flags(st_thomas(), False, "212"), editing=editing))
    reasons = verdict(solution).reasons
    set_anew = any(finding.action is model.Action.FLAGGED for finding in solution.findings)
    if set_anew and editing is model.Editing.EDIT:
        assert not reasons
    else:
        assert reasons[0].concern is model.Concern.FLAGS
        flags = [cause for cause in solution.causes if cause.kind is model.CauseKind.FLAG]
        assert [cause.points for cause in flags] == [("212",)] and solution.causes[0] is flags[0]


@pytest.mark.slow
def test_control_held_below_the_water_is_doubted_without_its_flag() -> None:
    block = st_thomas()
    row = int(np.flatnonzero(block.control.kind == model.ControlKind.VERTICAL)[0])
    drowned = altered(
        block,
        control={"position": put((row, 2), -3.0), "fixed": put(row, True)},
        photos={"tide": np.full(3, -2.5)},
    )
    reasons = of_flags(adjust(drowned))
    assert reasons and "point 105 is not flagged as submerged (B), but up to 0.50 m" in reasons[0].text
