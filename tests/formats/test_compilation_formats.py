"""The card formats of compilation decks: their targets and units are those of a compilation."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from musatpy.errors import CardFormatError
from musatpy.formats.cards import card_formats_folder
from musatpy.formats.compilation_cards import compilation_family


@pytest.mark.parametrize(
    ("card", "old", "new", "message"),
    [
        ("stg", '"stages.xy[0]"', '"nonsense.nowhere"',
         "STG.x_left: target: 'nonsense.nowhere' is not in a compilation; expected one of models, stages"),
        ("stg", '"stages.xy[0]"', '"stages.yx[0]"',
         "'stages.yx[0]' is not in a compilation; expected one of stages.model, stages.ids"),
        ("stg", 'unit = "mm"\ntarget = "stages.xy[1]"', 'unit = "um"\ntarget = "stages.xy[1]"',
         "STG.y_left: unit: 'um', expected 'mm'"),
        ("mdl", 'unit = "um"\ntarget = "models.limit"', 'unit = "mm"\ntarget = "models.limit"',
         "MDL.limit: unit: 'mm', expected 'um'"),
        ("mpt", 'unit = "m"\ntarget = "stages.place[2]"', 'target = "stages.place[2]"',
         "MPT.z: unit: '', expected 'm'"),
    ],
)  # fmt: skip
def test_a_target_or_unit_that_is_not_of_a_compilation_is_refused(
    tmp_path: Path, card: str, old: str, new: str, message: str
) -> None:
    folder = tmp_path / "as11"
    shutil.copytree(card_formats_folder() / "as11", folder)
    file = folder / f"{card}.toml"
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CardFormatError) as caught:
        compilation_family(folder)
    assert str(caught.value).startswith(str(file)) and message in str(caught.value)
