"""The causes that the search names, with what it edits and what it leaves; the study has more of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from altered import added, altered
from blocks import FIXTURES
from drivers import causes_study as study
from drivers.causes_study import edited, fault, strip
from drivers.common_mistakes import simulated
from musatpy import adjust, read_deck
from musatpy.blunders.causes import first_look
from musatpy.formats.musat import check_deck
from musatpy.model import Cause, CauseKind, CauseSearch, Initial, PointStatus
from musatpy.pipeline import causes_of, doubtful
from musatpy.statistics import Statistics

FINDS = FIXTURES / "verdict"
_K = CauseKind


@pytest.mark.slow
@pytest.mark.parametrize("photos", study.STRIPS)
def test_wrong_control_is_named_whatever_its_size_and_its_rays(photos: int) -> None:
    for trial in study.control((photos,), (1.0, 100.0)):
        assert fault(trial) == "", trial.name


@pytest.mark.slow
@pytest.mark.parametrize("trials", [study.exchanged, study.focal_length, study.tides, study.clean])
def test_what_is_wrong_is_named_and_nothing_innocent_goes_out(trials) -> None:
    """Exchanged photos, a focal length with its size, tides; in clean strips nothing."""
    for trial in trials(1):
        assert fault(trial) == "", trial.name


@pytest.mark.slow
def test_equal_explanations_are_named_the_cheaper_one_first() -> None:
    """Of a point on two photos with known height, an error of x is that of either image, or of the control."""
    block = strip(6)
    rays = np.bincount(block.plates.point, minlength=len(block.points.ids))
    row = int(np.flatnonzero(rays[block.control.point] == 2)[0])
    causes = edited(altered(block, control={"position": added((row, 0), 20.0)})).causes
    assert causes[0].kind is _K.HORIZONTAL
    assert causes[0].rank == 1
    assert [one.rank for one in causes if one.group == 1] == sorted(one.rank for one in causes if one.group == 1)
    assert causes[0].cards == ("CTX",)
    assert causes[0].size[0] == pytest.approx(20.0, abs=4.0 * causes[0].sigma[0])


@pytest.mark.slow
def test_a_doubtful_run_names_the_cause_and_changes_nothing() -> None:
    block = strip(6)
    wrong = altered(block, control={"position": added(0, [0.0, 0.0, 10.0])})
    solution = adjust(wrong)
    assert doubtful(Statistics(solution))
    found = causes_of(wrong)
    assert found
    assert solution.causes[: len(found)] == found  # before flags: heights bend under the error, and contradict them
    assert {cause.kind for cause in solution.causes[len(found) :]} <= {_K.FLAG, _K.TIDES}
    assert solution.causes[0].points == (str(block.points.ids[block.control.point[0]]),)
    assert solution.findings == ()
    assert solution.edited is None
    assert solution.block.control.known.all()
    assert not adjust(block).causes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("deck", "expected"),
    [
        ("cameras_underground", {"kind": _K.AXES, "photos": ()}),
        ("control_in_feet", {"kind": _K.UNIT, "photos": ()}),
        ("point_at_4e15_converged", {"kind": _K.EXCHANGED_IMAGES, "photos": ("1", "2")}),
        ("linalg_svd_resection", {"kind": _K.START, "photos": ("1",)}),
        ("linalg_one_digit_control_edit", {"points": ("103",), "cards": ("CTG",)}),  # a tenth of a degree off
    ],
)
def test_decks_that_showed_a_defect_have_their_cause_named(deck: str, expected: dict[str, object]) -> None:
    first = causes_of(read_deck(FINDS / f"{deck}.crd"))[0]
    assert {name: getattr(first, name) for name in expected} == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    ("deck", "first"),
    [
        ("images_y_down", ["axes (y of the plates)"]),
        ("control_x_y_exchanged", ["axes (plan of the control)"]),
        ("control_in_km", ["unit of length: control in kilometres, stations and tides in metres"]),
    ],
)
def test_what_is_wrong_with_the_whole_block_is_named_alone(deck: str, first: list[str]) -> None:
    """The station cards tell them from the others of their class; flags contradicted by it are no cause."""
    causes = adjust(read_deck(FINDS / f"{deck}.crd")).causes
    assert [str(cause) for cause in causes if cause.kind in (CauseKind.AXES, CauseKind.UNIT)] == [
        cause for cause in map(str, causes) if cause.startswith(first[0])
    ]
    assert str(causes[0]).startswith(first[0])
    assert not any(cause.kind is CauseKind.FLAG for cause in causes)
    told = "the station cards agree with this one" in causes[0].advice
    assert told == (causes[0].kind is CauseKind.AXES)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_the_size_of_a_focal_length_is_that_at_rest(factor: float) -> None:
    """The linear model of a block whose focal length is 5 % wrong is off by 12 sigmas of the size."""
    block = simulated("iiia", 1).block
    right = float(block.cameras.focal_length[0])
    causes = adjust(altered(block, cameras={"focal_length": lambda f: f * factor})).causes
    assert causes[0].kind is CauseKind.FOCAL_LENGTH
    assert causes[0].size[0] == pytest.approx((factor - 1.0) * right, abs=4.0 * causes[0].sigma[0])
    assert causes[0].sigma[0] < 0.01


@pytest.mark.slow
def test_one_wrong_image_is_not_told_as_a_unit_of_length() -> None:
    """Photo 21 sees little control: heights times 1.0936 bend the block to it, and leave control 103 wrong."""
    deck = FIXTURES / "st_thomas/st_thomas.crd"
    card = b"PLT 21       103       55.0170000"
    text = deck.read_bytes()
    assert card in text
    block, _ = check_deck(text.replace(card, card.replace(b"55.", b"54.")))
    causes = adjust(block).causes
    assert not any(cause.kind is CauseKind.UNIT for cause in causes)
    assert {cause.points for cause in causes if cause.group == 1} == {("103",)}
    image = next(cause for cause in causes if cause.kind is CauseKind.IMAGE)
    assert image.size[0] == pytest.approx(-1000.0, abs=4.0 * image.sigma[0])


def test_a_cause_of_many_points_names_five() -> None:
    points = tuple(str(number) for number in range(1, 32))
    flags = Cause(kind=CauseKind.FLAG, cards=("PLT",), points=points, size=(2.0,), unit="m", advice="look")
    assert str(flags) == "flags of points 1, 2, 3, 4, 5 and 26 more, off by 2.000 m: look"
    assert str(replace(flags, points=("7",))) == "flag of point 7, off by 2.000 m: look"
    focal = replace(flags, kind=CauseKind.FOCAL_LENGTH, points=(), component="focal length", unit="mm")
    assert str(focal) == "focal length, off by 2.000 mm: look"


@pytest.mark.slow
def test_of_mirrored_plates_all_causes_are_named_that_nothing_tells_apart() -> None:
    block = read_deck(FINDS / "images_y_down.crd")
    nothing = np.full(block.photos.position.shape, np.nan)
    alone = altered(block, photos={"position": nothing, "attitude": nothing}, options={"initial": Initial.COMPUTE})
    causes = causes_of(alone)
    assert [cause.component for cause in causes if cause.group == 1] == [
        "y of the plates", "x of the plates", "x and y of the plates", "plan of the control",
    ]  # fmt: skip
    assert {cause.rank for cause in causes if cause.group == 1} == {1}


@pytest.mark.slow
def test_plates_turned_by_a_right_angle_are_no_cause() -> None:
    """Under COMPUTE they change the heading alone."""
    turned = altered(
        strip(6), plates={"xy": lambda xy: xy[:, ::-1] * [-1.0, 1.0]}, options={"initial": Initial.COMPUTE}
    )
    assert not doubtful(Statistics(adjust(turned)))
    assert not causes_of(turned)


@pytest.mark.slow
def test_the_wrong_one_of_three_images_is_told_by_its_y() -> None:
    """It was the point that lost all three of them, and was intersected 419 m off from what was out."""
    solution = adjust(read_deck(FINDS / "edit_point_206_420m.crd"))
    assert [(one.photo, one.point) for one in solution.findings] == [("22", "206")]
    assert solution.findings[0].size[0] == pytest.approx(-80000.0, abs=40.0)
    point = int(np.flatnonzero(solution.block.points.ids == "206")[0])
    assert solution.points.status[point] == PointStatus.TRIANGULATED


def test_a_point_whose_kept_out_rays_do_not_meet_has_no_position() -> None:
    block = strip(6)
    rays = np.bincount(block.plates.point, minlength=len(block.points.ids))
    rays[block.control.point] = 0
    point = int(np.flatnonzero(rays == 3)[0])
    out = block.plates.point == point
    plates = replace(block.plates, triangulated=block.plates.triangulated & ~out)
    fits = adjust(replace(block, plates=plates))
    assert fits.points.status[point] == PointStatus.INTERSECTED
    xy = plates.xy.copy()
    xy[np.flatnonzero(out)[0], 1] += 5.0
    solution = adjust(replace(block, plates=replace(plates, xy=xy)))
    assert solution.points.status[point] == PointStatus.NOT_DETERMINED
    assert np.isnan(solution.points.position[point]).all()
    assert np.isnan(solution.points.covariance[point]).all()
    assert "do not meet" in solution.points.reasons[point]


@pytest.mark.slow
def test_more_than_a_fifth_of_a_kind_is_not_edited() -> None:
    """Station heights that a geoid puts off by metres are no twenty blunders; without a common cause, none goes."""
    block = strip(10, observed=True)
    off = [[8.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, -7.0, 5.0], [-6.0, 0.0, 7.0]]
    answer = edited(altered(block, photos={"position": added(np.s_[:4], off)}))
    assert "4 of 10 would go of one kind, station positions" in answer.unedited
    assert answer.edited.control.known.all()
    np.testing.assert_array_equal(answer.edited.photos.position_sigma, block.photos.position_sigma)


def test_unknown_waves_are_not_searched() -> None:
    """The search does not exist for them; a run that fails says so by itself."""
    path = next((FIXTURES / "waves").glob("unknown*.crd"))
    assert causes_of(read_deck(path)) == ()


def test_a_wrong_check_point_has_its_card_and_its_images_named() -> None:
    """It takes no part: the search finds nothing, and card and images explain it alike."""
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    row = int(np.flatnonzero(block.points.ids[block.control.point] == "106")[0])
    solution = adjust(altered(block, control={"position": added((row, 2), 30.0)}))
    card, images = solution.causes
    assert (card.kind, card.points, card.cards, card.group, card.rank) == (_K.CONTROL, ("106",), ("CTG",), 1, 1)
    assert card.size[2] == pytest.approx(30.0, abs=1.0)  # the check point was 0.34 m off before
    assert (images.kind, images.points, images.cards, images.rank) == (_K.IMAGES, ("106",), ("PLT",), 1)


@pytest.mark.slow
def test_a_search_without_effort_names_what_the_linear_model_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """And how far the focal length is off, to 1 %: the observed stations hold it."""
    monkeypatch.setattr("musatpy.blunders.search.LEAST", 0.0)
    monkeypatch.setattr("musatpy.blunders.search._AROUND", -1000)
    block = strip(10, observed=True)
    solution = adjust(altered(block, cameras={"focal_length": lambda f: 1.02 * f}))
    assert any(text.startswith("search stopped") for text in solution.warnings)
    cause = solution.causes[0]
    assert cause.kind is CauseKind.FOCAL_LENGTH
    assert cause.size[0] == pytest.approx(0.02 * block.cameras.focal_length[0], rel=0.02)
    assert first_look(solution, None) == solution.causes


@pytest.mark.slow
def test_all_looks_farther_and_says_nothing_of_it_where_the_end_is_reached() -> None:
    block = strip(6)
    wrong = altered(block, control={"position": added(0, [0.0, 0.0, 10.0])})
    usual, every = (adjust(wrong, causes=causes) for causes in (CauseSearch.USUAL, CauseSearch.ALL))
    assert usual.causes == every.causes
    assert not any(text.startswith("search stopped") for text in (*usual.warnings, *every.warnings))
