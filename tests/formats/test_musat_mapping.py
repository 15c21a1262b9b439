"""Targets and units of the card formats: every sample card in inside units, and families that fill no block."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from formats.deck_edits import deck
from musatpy.errors import CardFormatError
from musatpy.formats import mapping, musat
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.spec import card_formats_folder
from musatpy.model import ControlKind, Options
from musatpy.units import ARC_SECOND, DEGREE

FAMILY = musat.card_family()


def sample(mnemonic: str) -> dict[str, np.ndarray]:
    """Return what the sample card of a format says."""
    spec = FAMILY.cards[mnemonic]
    table = read_cards(f"{spec.sample}\n".encode(), FAMILY).tables[mnemonic]
    return mapping.gather(spec, table.columns)


def test_a_geographic_station_is_in_radians_and_metres() -> None:
    values = sample("STA")
    assert values["photos.ids"].tolist() == ["841"]
    assert values["photos.camera"].tolist() == ["RC8"]
    latitude = (19 + 21 / 60 + 36.41532 / 3600) * DEGREE
    longitude = -(81 + 19 / 60 + 14.08177 / 3600) * DEGREE
    # Exact but for the rounding of sums in binary.
    np.testing.assert_allclose(values["photos.position"], [[latitude, longitude, 3052.6184]], rtol=1e-15)
    assert values["photos.position_sigma"].tolist() == [[5.0, 5.0, 8.0]]


def test_tilts_have_the_sign_of_their_degrees_and_sigmas_in_seconds() -> None:
    values = sample("ATT")
    angles = np.array([-(3 * 60 + 42.153), 23 * 60 + 50.092, 152 * 3600 + 14 * 60 + 7.25]) * ARC_SECOND
    np.testing.assert_allclose(values["photos.attitude"], [angles], rtol=1e-15)  # rounding of sums in binary
    np.testing.assert_allclose(
        values["photos.attitude_sigma"], [np.array([60, 60, 120.5]) * ARC_SECOND], rtol=1e-15
    )


def test_options_have_inside_units() -> None:
    values = sample("OPT")
    assert values["options.rotation_limit"] == pytest.approx(0.1 * ARC_SECOND, rel=1e-15)
    assert values["options.plate_sigma"] == pytest.approx(0.010, rel=1e-15)  # 10 micrometres in millimetres
    assert {f"options.{name}" for name in vars(Options())} == set(values) | set(sample("OP2"))


def test_letters_become_their_values() -> None:
    values = sample("CTX")
    assert values["control.kind"].tolist() == [ControlKind.VERTICAL]
    assert values["control.fixed"].tolist() == [False]
    assert values["points.bathymetric"].tolist() == [True]
    assert np.isnan(values["control.sigma"]).tolist() == [[True, True, False]]
    assert sample("PLT")["plates.triangulated"].tolist() == [True]


@pytest.mark.parametrize("mnemonic", [spec.mnemonic for spec in FAMILY.cards.values() if spec.fields])
def test_scatter_undoes_gather(mnemonic: str) -> None:
    spec = FAMILY.cards[mnemonic]
    columns = read_cards(f"{spec.sample}\n".encode(), FAMILY).tables[mnemonic].columns
    again = mapping.scatter(spec, mapping.gather(spec, columns))
    assert set(again) == set(columns)
    for name, column in columns.items():
        if column.dtype.kind == "U":
            assert again[name].tolist() == column.tolist()
        else:
            np.testing.assert_allclose(again[name], column, rtol=1e-15)  # of multiplying and dividing by a unit


def test_the_texts_of_the_cards_are_those_of_the_model() -> None:
    options = {name: type(value) for name, value in vars(Options()).items() if isinstance(value, str)}
    for name, enumeration in options.items():
        (field,) = (field for card in ("OPT", "OP2") for field in FAMILY.cards[card].fields if field.name == name)
        assert set(field.allowed) == {member.value for member in enumeration}
    for path in mapping.CODES:
        for spec in FAMILY.cards.values():
            for slot in mapping.slots(spec):
                if slot.path == path:
                    letters = {letter for one in slot.fields[0].target.split() for letter in mapping.CODES[one]}
                    assert set(slot.fields[0].allowed) == letters - {""}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("card", "old", "new", "message"),
    [
        ("plt", '"plates.xy[0]"', '"plates.uv[0]"', "PLT.x: target: 'plates.uv[0]' is not in the model"),
        ("plt", '"plates.xy[0]"', '"plates.xy[1]"', "PLT.y: target: 'plates.xy[1]' is another field's"),
        ("plt", '"plates.xy[0]"', '"plates.xy[2]"', "components [2, 1] do not count from 0"),
        ("att", '"photos.attitude[2]:min"', '"photos.attitude[2]"', "degrees, minutes and seconds go together"),
        ("tid", '"photos.tide_sigma"', '"photos.tide"', "TID.sigma: target: 'photos.tide' is another field's"),
        ("stx", '"photos.camera"', '"photos.tide"', "STX has no target photos.camera"),
        ("plt", '"plates.xy[0]"', '"plates.uv[0]"', "expected one of plates.photo, plates.point, plates.xy"),
        ("wtr", '"water.sigma"', '"water.conditions"', "'water.conditions' is not in the model"),
        ("red", '"reduction.side"', '"reduction.side"\nunit = "um"', "RED.side: unit: 'um', of a field of letters"),
        ("tid", '"photos.time"', '"photos.position"', "target photos.position: 1 components, expected 3"),
        (
            "tid",
            '"photos.tide_day"',
            '"photos.tide_day[0]"',
            "target photos.tide_day: components [0], expected none",
        ),
    ],
)
def test_formats_that_fill_no_block_are_refused(
    tmp_path: Path, card: str, old: str, new: str, message: str
) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(card_formats_folder() / "musat", folder)
    file = folder / f"{card}.toml"
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CardFormatError) as caught:
        musat.card_family(folder)
    assert message in str(caught.value)


def test_what_the_model_does_not_take_from_a_card_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(card_formats_folder() / "musat", folder)
    file = folder / "tid.toml"
    kind = '[[field]]\nname = "camera"\ncolumns = [63, 70]\nedit = "A8"\ntarget = "photos.camera"\n'
    file.write_text(f"{file.read_text(encoding='utf-8')}\n{kind}blank = 'missing'\ndoc = ''\n", encoding="utf-8")
    expected = r"tid\.toml: field camera: target: 'photos\.camera' is nowhere .* one of photos\.ids, photos\.tide,"
    with pytest.raises(CardFormatError, match=expected):
        musat.card_family(folder)


def test_a_card_by_which_nothing_is_known_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(card_formats_folder() / "musat", folder)
    text = (folder / "tid.toml").read_text(encoding="utf-8").replace("TID", "TIM")
    head, photo, *_, time = text.split("[[field]]")
    head = head.replace(text.split('sample = "')[1][16:50], " " * 34)
    (folder / "tim.toml").write_text(f"{head}[[field]]{photo}[[field]]{time}", encoding="utf-8")
    with pytest.raises(CardFormatError, match=r"tim\.toml: field photo: target: 'photos\.ids' is nowhere"):
        musat.card_family(folder)


def test_a_family_without_tides_fills_no_block(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(card_formats_folder() / "musat", folder)
    (folder / "tid.toml").unlink()
    with pytest.raises(CardFormatError, match=r"no card has the target photos\.tide"):
        musat.card_family(folder)


def test_another_layout_of_the_same_cards_reads_and_writes_decks(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(card_formats_folder() / "musat", folder)
    file = folder / "tid.toml"
    moved = file.read_text(encoding="utf-8")
    for columns, others in (
        ("[52, 61]", "[61, 70]"),
        ("[25, 32]", "[34, 41]"),  # the sigma nine columns on, the others out of its way
        ('[34, 41]\nedit = "A8"', '[52, 59]\nedit = "A8"'),
    ):
        moved = moved.replace(columns, others)
    tide = FAMILY.cards["TID"].sample
    sample = f"{tide[:24]}{'':9}{tide[24:32]} {tide[42:50]} {tide[33:41]} {tide[51:61]}".ljust(72) + tide[72:]
    file.write_text(moved.replace(tide, sample), encoding="utf-8")
    family = musat.card_family(folder)
    old = b"TID 841          0.2000   0.0500".ljust(80)
    new = b"TID 841          0.2000            0.0500".ljust(80)
    block = musat.read_deck(deck(lambda lines: [line if line[:7] != "TID 841" else old.decode() for line in lines]))
    data = musat.deck_bytes(block, family)
    assert new[:72] in data
    assert musat.deck_bytes(musat.read_deck(data, family)) == musat.deck_bytes(block)
