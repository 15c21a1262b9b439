"""Deck -> Block -> deck: byte-identical for canonical decks, and the block is what was written."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np
import pytest

from altered import altered, put
from formats.deck_edits import FOLDER, GOOD, add, deck, drop, in_system
from jobs.decks import rich
from musatpy import model
from musatpy.errors import DeckError
from musatpy.formats import assembly, musat
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.draft import draft_of
from musatpy.formats.job_tables import card_family
from musatpy.formats.mapping import Slot, factor, slots
from musatpy.formats.refractive_index import index_of
from musatpy.model import CoordinateSystem
from musatpy.model.block import in_order, parts_of_block
from musatpy.model.tables import Table, columns
from musatpy.units import ARC_SECOND, DEGREE
from raw_plates import crosses, distances, raw_block, reseau


def unchecked(data: bytes) -> model.Block:
    """Return the block of a deck that no cross check has seen: blocks with a value of every kind make no sense."""
    family = card_family()
    read = read_cards(data, family)
    assert read.problems == ()
    return assembly.block_of(draft_of(read, family))


def otherwise(part: Any, **given: Any) -> Any:
    """Return what one card says with other values than the defaults, but for what is given."""

    def other(default: Any) -> Any:
        if isinstance(default, StrEnum):
            kinds = list(type(default))
            return kinds[kinds.index(default) - 1]
        return default or "841" if isinstance(default, str) else type(default)(1.25 * default)

    return replace(part, **{one.name: other(one.default) for one in fields(part) if one.name not in given} | given)


def full(system: CoordinateSystem) -> model.Block:
    """The good deck with what no deck of the fixtures says."""
    block = in_system(system)
    n, points = len(block.photos.ids), block.points
    conditions = model.WaterConditions(temperature=12.5, wavelength=550.0, salinity=35.0)
    axes = model.EllipsoidSpec(semi_major_axis=6378206.4, inverse_flattening=294.9786982138982)
    marks = model.FiducialMeasurements(photo=[0], ids=["1"], xy=[[106.0, -105.9]], sigma=[[0.002, np.nan]])
    return altered(
        block,
        options=otherwise(block.options, system=system),
        ellipsoid=None if system is CoordinateSystem.LOCAL else axes,
        water=model.Water(index=index_of(conditions), conditions=conditions, tilt_east=1e-5, tilt_north=-2e-5,
                          tilt_sigma=3e-6, sigma=0.002),
        photos={"attitude_sigma": np.full((n, 3), 20 * ARC_SECOND)},
        control={"correlation": np.where(block.control.kind[:, None] == 0, [0.5, -0.25, 0.6], np.nan)},
        points={"dry": ~points.bathymetric & np.isin(np.arange(len(points.ids)), block.control.point)},
        fiducial_measurements=marks,
        orientation=otherwise(model.OrientationSpec()),
        reduction=otherwise(model.ReductionOptions()),
        ports=model.Ports(
            camera=[0], distance=[35.0], thickness=[10.0], glass_index=[1.5], water_index=[1.335],
            tilt=[[0.1, -0.2]],
        ),
        lens_unknowns=model.LensUnknowns(
            camera=[0, 0], parameter=["F", "K1"], value=[152.1, np.nan], sigma=[np.nan, 1e-9]
        ),
        lever_arms=model.LeverArms(
            camera=[0], offset=[[0.25, -0.5, 1.5]], sigma=[[0.01, np.nan, 0.02]], free=[True]
        ),
        antenna_lines=model.AntennaLines(
            line=["L1"], shift_sigma=[[0.5, np.nan, 0.25]], shift_free=[True],
            drift_sigma=[[np.nan, 0.001, 0.002]], drift_free=[True],
        ),
        antenna_positions=model.AntennaPositions(
            photo=[0, 1], line=["L1", ""], position=block.photos.position[:2],
            sigma=[[0.05, 0.06, 0.07]] * 2, correlation=[[0.25, -0.125, 0.5], [np.nan] * 3],
        ),
        exposure_times=model.ExposureTimes(photo=[0, 1], time=[1.5, 2.25]),
        inertial_convention=model.InertialConvention(angles="OPK"),
        inertial_attitudes=model.InertialAttitudes(
            photo=[0, 1], angles=[[0.01, -0.02, 3.0], [0.5, 0.25, -1.0]], sigma=np.full((2, 3), 10 * ARC_SECOND)
        ),
        misalignments=model.Misalignments(
            camera=[0], angles=[[0.002, -0.003, 1.5]], sigma=[[20 * ARC_SECOND, np.nan, np.nan]], free=[True]
        ),
    )  # fmt: skip


def of_fixture(name: str) -> model.Block:
    return unchecked((FOLDER.parent / f"{name}.crd").read_bytes())


def uneven(block: model.Block) -> model.Block:
    """The block with numbers of its tables that have more digits than cards."""
    rng, tables = np.random.default_rng(7), {}
    for name, table in block.tables().items():
        values = {column: getattr(table, column) for column in columns(type(table)) if name != "reseau"}
        tables[name] = {
            column: value * (1.0 + rng.uniform(-1e-3, 1e-3, value.shape)) if value.dtype.kind == "f" else value
            for column, value in values.items()
        }
    return altered(block, **tables)


BLOCKS: dict[str, Callable[[], model.Block]] = {
    **{f"full, {system}": partial(full, system) for system in CoordinateSystem},
    **{name: partial(of_fixture, name) for name in ("orientation/tank", "waves/unknown", "waves/strip")},
    "rich": lambda: altered(rich(), water={"liquid": "LAB OIL"}),
    "raw plates": lambda: altered(
        raw_block(reseau=reseau(), cross_measurements=crosses(["21", "22", "23"]), mark_distances=distances()),
        lenses={"zero_radius": np.array([60.0])},
    ),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_written_deck_is_written_again_to_the_byte(name: str) -> None:
    data = musat.deck_bytes(uneven(BLOCKS[name]()))
    assert musat.deck_bytes(unchecked(data)) == data
    assert all(len(line) == 80 for line in data.decode("ascii").splitlines())


def test_every_attribute_is_said_in_one_of_the_blocks() -> None:
    said = set()
    for block in (make() for make in BLOCKS.values()):
        for name, kind in parts_of_block().items():
            part = getattr(block, name)
            for one in fields(kind) if part is not None else ():
                value = np.asarray(getattr(part, one.name))
                blank = value == one.default if not issubclass(kind, Table) else (value == "") | (value != value)
                said |= {f"{name}.{one.name}"} if not np.all(blank) else set()
    every = {f"{name}.{one.name}" for name, kind in parts_of_block().items() for one in fields(kind)}
    assert every - said == set()


def slots_of(block: model.Block) -> dict[str, list[Slot]]:
    """Return the slots of each attribute on the cards of a block, in the order of its components."""
    found: dict[str, list[Slot]] = {}
    for spec, _ in assembly.cards_of(block, card_family()):
        named = sorted(slots(spec), key=lambda slot: slot.component or 0)
        of_card = {path: [slot for slot in named if slot.path == path] for path in {slot.path for slot in named}}
        found = of_card | found  # of sigmas that CTC has with more decimals those of the card of control
    return found


def half_a_decimal(slot: Slot, value: float) -> float:
    """Return half of the last decimal that a field has room for, or of nine digits of E16.9, in inside units."""
    edit = slot.fields[-1].edit
    if slot.is_sexagesimal:
        return 0.5 * 10.0**-edit.decimals * ARC_SECOND
    unit = factor(slot, DEGREE)
    if edit.letter == "E":
        return 5e-9 * abs(value)  # the first of them may be 1
    before = str(int(abs(value / unit))).lstrip("0")
    return 0.5 * 10.0 ** -min(edit.decimals, edit.width - 1 - len(before) - (value < 0.0)) * unit


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_comes_back_as_it_was_written(name: str) -> None:
    block = uneven(BLOCKS[name]())
    assert_same(in_order(block), unchecked(musat.deck_bytes(block)), slots_of(block))


def assert_same(one: object, other: object, written: dict[str, list[Slot]], name: str = "") -> None:
    """Assert that two blocks, or parts of them, are the same up to the decimals of the slots of a deck."""
    assert type(one) is type(other), name
    if is_dataclass(one):
        for field in fields(one):
            part = f"{name}.{field.name}".lstrip(".")
            assert_same(getattr(one, field.name), getattr(other, field.name), written, part)
    elif np.asarray(one).dtype.kind == "f":
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other), err_msg=name)
        parts = written.get(name, [None])
        ours, theirs = (np.nan_to_num(values).reshape(-1, len(parts)).T for values in (one, other))
        for slot, values, back in zip(parts, ours, theirs, strict=True):
            rounding = np.array([half_a_decimal(slot, value) for value in values.tolist()]) if slot else 0.0
            # One part in 10**14 for the arithmetic of the units.
            assert np.all(np.abs(back - values) <= rounding * (1 + 1e-6) + 1e-14 * np.abs(values)), name
    else:
        np.testing.assert_array_equal(one, other, err_msg=name)


def test_a_deck_needs_no_stations_where_they_are_computed() -> None:
    block, problems = musat.check_deck(deck(drop(*range(6, 12)), add("OP2 COMPUTE")))
    assert problems == ()
    assert block.options.initial is model.Initial.COMPUTE
    assert np.isnan([block.photos.position, block.photos.attitude]).all()
    assert block.photos.camera.tolist() == [0, 0, 0]
    written = musat.deck_bytes(block)
    assert not {line[:3] for line in written.splitlines()} & {b"STA", b"ATT"}
    assert musat.deck_bytes(musat.read_deck(written)) == written


@pytest.mark.parametrize("initial", [model.Initial.GIVEN, model.Initial.CHECK])
def test_given_stations_are_asked_for_where_they_are_used(initial: model.Initial) -> None:
    problems = musat.check_deck(deck(drop(*range(6, 12)), add(f"OP2 {initial}")))[1]
    assert [problem.message.partition(" (")[0] for problem in problems] == [
        "the deck has no exposure stations",
        "the deck has no attitudes",
    ]


def test_the_order_of_the_cards_does_not_matter() -> None:
    """But that of the block's own tables; points come in the order in which plates name them."""
    shuffled = [GOOD[row] for row in np.random.default_rng(1).permutation(len(GOOD) - 1)]
    restored = sorted(shuffled, key=lambda card: GOOD.index(card) if card[:3] in ("PLT", "STA", "CTG") else 0)
    block, problems = musat.check_deck(deck(lines=[*restored, GOOD[-1]]))
    assert problems == ()
    assert musat.deck_bytes(block) == deck()
    assert block.points.ids.tolist() == list(
        dict.fromkeys(line[13:21].strip() for line in GOOD if line[:3] == "PLT")
    )


def test_options_stand_only_where_they_say_something() -> None:
    for plain in (
        deck(lambda lines: [*lines[:1], "OPT", *lines[2:]]),
        deck(drop(2)),
        deck(drop(2), add("OP2 GIVEN")),
    ):
        block = musat.read_deck(plain)
        assert block.options == model.Options() and b"OP2" not in musat.deck_bytes(block)
    data = musat.deck_bytes(musat.read_deck(deck(add("OP2 CHECK"))))
    assert data.splitlines()[2].startswith(b"OP2 CHECK ")


@pytest.mark.parametrize(
    ("angle", "text"),
    [
        (0.0, "   0  0  0.0000"),
        (-0.0, "  -0  0  0.0000"),
        (-0.5 * ARC_SECOND, "  -0  0  0.5000"),
        (-3599.99996 * ARC_SECOND, "  -1  0  0.0000"),
        (3599.99994 * ARC_SECOND, "   0 59 59.9999"),
        (59.99996 * ARC_SECOND, "   0  1  0.0000"),
    ],
)
def test_sexagesimal_angles_carry_and_keep_their_sign(angle: float, text: str) -> None:
    block = in_system(CoordinateSystem.GEOGRAPHIC)
    data = musat.deck_bytes(altered(block, photos={"attitude": put((0, 2), angle)}))
    card = next(line for line in data.decode().splitlines() if line.startswith("ATT"))
    assert card[42:57] == text
    back = musat.read_deck(data).photos.attitude[0, 2]
    assert back == pytest.approx(angle, abs=0.5e-4 * ARC_SECOND)  # half of the last decimal
    assert np.signbit(back) == np.signbit(angle)


def test_a_group_goes_on_over_several_cards() -> None:
    cards = ("EQL LAKE      0.0500 1101     1103     1104     1105     1106", "EQL LAKE             1107     1109")
    block = musat.read_deck(deck(add(*cards)))
    groups = block.equal_elevations
    assert (groups.ids.tolist(), groups.sigma.tolist()) == (["SHORE", "LAKE"], [0.05, 0.05])
    members = block.points.ids[groups.point[groups.group == 1]].tolist()
    assert members == ["1101", "1103", "1104", "1105", "1106", "1107", "1109"]
    lines = musat.deck_bytes(block).decode().splitlines()
    written = [line[:72].rstrip() for line in lines if line.startswith("EQL L")]
    assert written == [cards[0], "EQL LAKE      0.0500 1107     1109"]


def test_a_deck_is_replaced_whole_or_not_at_all(tmp_path) -> None:
    path = tmp_path / "strip.crd"
    block = musat.read_deck(deck())
    musat.write_deck(block, path)
    ids = np.array(["THIS IS NO PHOTO ID", *block.photos.ids[1:]])
    with pytest.raises(DeckError, match="THIS IS NO PHOTO ID"):
        musat.write_deck(replace(block, photos=replace(block.photos, ids=ids)), path)
    assert path.read_bytes() == deck()
    assert list(tmp_path.iterdir()) == [path]
    problems = musat.check_deck(tmp_path / "none.crd")[1]
    assert "No such file" in problems[0].headline()


def test_a_value_finer_than_its_field_is_not_lost_silently() -> None:
    block = in_system(CoordinateSystem.GEOGRAPHIC)
    fine = replace(block, options=replace(block.options, water_limit=1e-7))  # F7.5 has no digit for it
    assert musat.read_deck(musat.deck_bytes(fine)).options.water_limit == 1e-7
    sigma = block.control.sigma.copy()
    sigma[0] = 1e-8  # and F5.3 no room for an exponent either
    with pytest.raises(DeckError, match=r"'1e-08' is not a number that fits F5\.3"):
        musat.deck_bytes(replace(block, control=replace(block.control, sigma=sigma)))
