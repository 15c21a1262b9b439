"""Pictures: of what they are asked for, always the same, and those of the pages stand in docs."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import sea_fixtures
from drivers import collocation_tables, okamoto_tables, sea_tables, unknown_waves_study

pytest.importorskip("matplotlib")

from matplotlib import image

from musatpy.sea.experiment import histogram
from musatpy.sea.experiment_spec import WaveSpec
from musatpy.sea.interpolation.correlation import Family
from musatpy.sea.interpolation.interpolate import Options, interpolate
from musatpy.sea.interpolation.prediction import Observed
from musatpy.sea.pictures.error_maps import error_maps
from musatpy.sea.pictures.interpolation import interpolation_picture
from musatpy.sea.pictures.stereo import surface_picture
from musatpy.sea.stereo.estimate import fit_fourier, fit_grid
from musatpy.sea.study import study
from musatpy.specs import spec_of
from studies import collocation, pictures, stereo


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(image.imread(io.BytesIO(png), format="png"))[..., :3]


def like(drawn: np.ndarray, colour: int, off: float) -> int:
    """Return how many pixels have a colour, 0xRRGGBB."""
    wanted = np.array([colour >> 16, colour >> 8 & 0xFF, colour & 0xFF]) / 255
    return int((np.abs(drawn - wanted) < off).all(axis=-1).sum())


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


@pytest.mark.slow
def test_a_histogram_has_as_much_ink_as_points() -> None:
    """Bars fill the part of the plot that the counts give: full for a flat histogram."""
    flat = np.repeat(np.linspace(-1.0, 1.0, 2001)[:, None], 3, axis=1)
    blue, peaked = (
        like(pixels(pictures.height_histogram(histogram(error), "T")), 0x1F5A8C, 0.01) for error in (flat, flat**9)
    )
    assert blue > 3 * peaked > 0


@pytest.mark.slow
def test_maps_show_both_signs_and_the_same_every_time() -> None:
    spec = spec_of(
        WaveSpec,
        {
            "stereo": {"cameras": [[0.0, 0.0, 490.0], [264.0, 0.0, 490.0]]},
            "water": {"depth": 10.0},
            "wave": [{"period": 10.0, "deep_height": 1.0}],
            "area": {"first": [0.0, -300.0], "spacing": [30.0, 60.0], "numbers": [9, 11]},
        },
    )
    result = study(spec)
    assert error_maps(result) == error_maps(result)
    drawn = pixels(error_maps(result))
    red, blue = drawn[..., 0] - drawn[..., 2] > 0.3, drawn[..., 2] - drawn[..., 0] > 0.3
    assert red.mean() > 0.01 and blue.mean() > 0.01


@pytest.mark.slow
def test_the_surface_is_drawn_with_what_is_rejected() -> None:
    points = sea_fixtures.simulation().surface_points
    points.position[17, 2] += 1.2
    for fit in (fit_fourier(points), fit_grid(points, curvature=0.003)):
        assert not fit.kept[17]
        first = surface_picture(fit, "SEA")
        assert first == surface_picture(fit, "SEA")
        assert like(pixels(first), 0xB5402A, 0.02) > 5  # the cross of the point
        assert len(np.unique(pixels(first).sum(axis=2))) > 100  # maps, not an empty sheet


@pytest.mark.slow
def test_a_map_shows_both_signs_and_leaves_out_what_is_out_of_reach() -> None:
    place = np.random.default_rng(1).uniform(0.0, 300.0, (40, 2))
    data = Observed(place=place, value=0.3 * np.sin(place[:, 0] / 50.0), sigma=np.zeros(40))

    def coloured(reach: float) -> tuple[float, float]:
        options = Options(families=(Family.GAUSSIAN,), reach=reach)
        drawn = pixels(interpolation_picture(interpolate(data, options)))
        third = drawn[:, : drawn.shape[1] // 3]
        difference = third[..., 0] - third[..., 2]
        return float((difference > 0.3).mean()), float((difference < -0.3).mean())

    whole = coloured(300.0)
    assert min(whole) > 0.02 and sum(coloured(20.0)) < 0.8 * sum(whole)
