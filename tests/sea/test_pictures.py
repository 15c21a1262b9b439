"""Pictures: of what they are asked for, always the same, and those of the pages stand in docs."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from drivers import collocation_tables, okamoto_tables, sea_tables, unknown_waves_study
from musatpy.sea.interpolation.correlation import Family
from studies import collocation, pictures, stereo


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(image.imread(io.BytesIO(png), format="png"))[..., :3]


def of_stereo() -> bytes:
    setups = [stereo.Setup(surface_points=count, bottom_points=20) for count in (60, 120)]
    return pictures.stereo_picture([("one", [stereo.run(setup, (1,)) for setup in setups])] * len(sea_tables.SEAS))


def of_collocation() -> bytes:
    families = (Family.NONE, Family.SWELL)
    outcomes = [collocation.outcome(collocation.Case(number=number), families) for number in (12, 25)]
    return pictures.collocation_picture([(str(state), *[outcomes] * 3) for state in collocation.SeaState])


PICTURES: list[tuple[Path, Callable[[], bytes]]] = [
    *(
        (okamoto_tables.PICTURES / f"okamoto_figure{number}.png", lambda number=number: figure(number))
        for number in (7, 8, 9)
    ),
    (sea_tables.PICTURE, of_stereo),
    (collocation_tables.PICTURE, of_collocation),
    (unknown_waves_study.PICTURE, lambda: pictures.unknown_waves(unknown_waves_study.made_up())),
]


def figure(number: int) -> bytes:
    return okamoto_tables.pictures()[f"okamoto_figure{number}"]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "draw"), PICTURES, ids=[path.stem for path, _ in PICTURES])
def test_the_pictures_of_docs_are_drawn_and_stand_there(path: Path, draw: Callable[[], bytes]) -> None:
    drawn = pixels(draw())
    assert np.array_equal(drawn, pixels(draw()))
    assert min(drawn.shape[:2]) > 300 and len(np.unique(drawn.sum(axis=2))) > 20  # not an empty sheet
    # another version of matplotlib sets letters elsewhere, but the sheet has its size
    assert pixels(path.read_bytes()).shape == drawn.shape
