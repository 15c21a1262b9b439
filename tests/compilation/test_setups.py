"""Models set up: the points of the run in them, and the precision to expect."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from altered import altered
from cli.commands import musat
from compilation.scenes import MODEL, at_depth, deck_of_cards, flat_images, grid, pair, stage_card
from musatpy import model
from musatpy.arrays import FloatArray
from musatpy.compilation.against_run import ModelSetUp, model_set_up
from musatpy.compilation.compiled import compiled
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import AdjustedRun
from musatpy.reports.compilation import SET_UP
from record_rows import valid_rows

_H, _BASE, _F, _POINTING = 3000.0, 1810.0, 152.4, 0.005


def with_points(run: AdjustedRun, points: FloatArray) -> AdjustedRun:
    """Return a run with submerged points (r, 3)."""
    ids = np.array([f"P{row}" for row in range(len(points))])
    block = replace(run.block, points=model.Points(ids=ids, bathymetric=np.ones(len(points), dtype=bool)))
    none = np.full((len(points), 3, 3), np.nan)
    return replace(run, block=block, position=points, point_covariance=none, control=np.zeros(len(points), bool))


def set_up_of(run: AdjustedRun, *cards: str) -> ModelSetUp:
    deck = deck_of_cards(MODEL, *cards)
    result = compiled(run, deck)
    return model_set_up(result.models[0], deck.stages.kind)


def test_the_run_predicts_the_stages_and_the_parallax_of_straight_rays() -> None:
    points = at_depth(grid((200.0, 1600.0), 1700.0), 30.0)
    run = with_points(pair(_H, _BASE), points)
    xy = flat_images(run, points)
    again = set_up_of(run, *(stage_card(f"P{row}", "RB", xy[row]) for row in (0, 7))).again
    # "Noise-free readings: below .001 um"; the cards have six decimals, rounded to half of that.
    assert np.abs(again.predicted - xy).max() < 1e-6
    assert np.abs(again.read - again.predicted)[[0, 7]].max() < 1e-6
    assert np.isnan(again.read[1]).all()
    assert np.abs(again.parallax).max() < 1e-6
    # 30.1 um at the scale of the water (a test of model points has the height that straight rays meet at).
    assert np.abs(again.straight).max() == pytest.approx(0.0299, abs=1e-4)


def test_points_that_a_photo_does_not_show_are_not_in_the_model() -> None:
    run = pair(_H, _BASE)
    points = at_depth(np.array([[900.0, 0.0], [-1500.0, 0.0], [900.0, 2500.0]]), 5.0)
    run = with_points(altered(run, block={"cameras": {"format_size": np.full((1, 2), 228.6)}}), points)
    assert set_up_of(run).again.points.tolist() == [0]


def test_standard_errors_to_expect_are_those_of_the_normal_case() -> None:
    expected = set_up_of(pair(_H, _BASE)).expected
    middle = (expected.depth == 0.0) & (np.abs(expected.place[:, :2]) < 1.0).all(axis=1)
    (row,) = np.flatnonzero(middle)
    scale = _H / _F
    # Of two vertical photos without errors of their own: H/B sqrt 2 in height, 1/sqrt 2 across the base.
    assert expected.sigma[row, 2] == pytest.approx(np.sqrt(2.0) * _H / _BASE * scale * _POINTING, rel=1e-6)
    assert expected.sigma[row, 1] == pytest.approx(np.sqrt(0.5) * scale * _POINTING, rel=1e-6)
    np.testing.assert_array_equal(expected.pointing, expected.sigma[:, 2])  # the run has no errors
    assert not expected.of_run.any()
    deep = expected.depth == 30.0
    assert np.isfinite(expected.points.depth_sigma[deep]).all() and (expected.points.depth[deep] > 29.9).all()
    np.testing.assert_allclose(expected.points.depth[deep], 30.0, rtol=0, atol=1e-6)


def test_a_model_without_water_stands_on_the_mean_ground() -> None:
    """Points at 40 and 60 m: the model begins at 50 m, and that is where errors are expected."""
    wet = pair(_H, _BASE)
    dry = altered(wet, block={"water": None, "photos": {"tide": np.full(2, np.nan)}})
    points = np.array([[700.0, 100.0, 40.0], [1100.0, -200.0, 60.0], [np.nan] * 3])
    run = with_points(dry, points)
    expected = set_up_of(run).expected
    assert set_up(run, "1", "2").height == pytest.approx(_H - 50.0, abs=1e-9)
    middle = (np.abs(expected.place) < 1.0).all(axis=1)
    scale = (_H - 50.0) / _F
    assert middle.sum() == 1 and (expected.depth == 0.0).all()
    up = np.sqrt(2.0) * (_H - 50.0) / _BASE * scale * _POINTING
    assert expected.sigma[middle, 2] == pytest.approx(up, rel=1e-6)


@pytest.mark.slow
def test_the_command_lists_the_models_before_anything_is_read(run_record: Path, tmp_path: Path) -> None:
    record, deck = run_record, tmp_path / "models.crd"
    deck.write_text("MDL 2122     21       22                                   5.00\nEND\n")
    result = musat("as11", "setup", record, deck)
    assert result.exit_code == 0 and "1 model set up" in result.output
    listing = (tmp_path / "models.setup.lst").read_text()
    for title in ("Options", "Model Set-Up", "Scales, And", "Model Axes", "Points Of The Run", "Standard Errors"):
        assert f"\n{title}" in listing
    assert max(map(len, listing.splitlines())) <= 132
    values = valid_rows(tmp_path / "models.setup.json", SET_UP.schema())
    # 5 um at H/B of 1.68 and a scale of 1 to 15,740 make .187 m in height; stations add what the run says.
    middle = next(row for row in values["expected"] if row["depth"] == 0.0 and max(map(abs, row["place"])) < 1.0)
    ratio = values["models"][0]["height"] / values["models"][0]["base"]
    pointing = np.sqrt(2.0) * ratio * values["models"][0]["scale"] * 5e-6
    assert middle["pointing_sigma"] == pytest.approx(pointing, rel=0.03)  # tilts of some degrees
    assert np.hypot(middle["pointing_sigma"], middle["run_sigma"]) == pytest.approx(middle["sigma"][2], rel=1e-9)
    assert middle["run_sigma"] > 0.05
