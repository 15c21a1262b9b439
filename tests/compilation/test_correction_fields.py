"""Polynomials that stand for a correction: the same points, and nothing where they would not be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from compilation.scenes import pair
from musatpy.cli.main import main as musat
from musatpy.compilation.correcting import Correction
from musatpy.compilation.correction_fields import smooth
from musatpy.compilation.run_records import of_record
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import Triangulation
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.systems import Geocentric, LocalRectangular, System
from stage_readings import FIXTURES


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Triangulation:
    """Return the run of St. Thomas."""
    folder = tmp_path_factory.mktemp("run")
    deck = str(FIXTURES / "st_thomas/st_thomas.crd")
    assert CliRunner().invoke(musat, ["run", deck, "-q", "-o", str(folder)]).exit_code == 0
    return of_record(Path(folder / "st_thomas.json"))


def correction(run: Triangulation, system: str) -> Correction:
    assert run.map_system is not None and run.map_system.ellipsoid is not None
    ellipsoid = run.map_system.ellipsoid
    of: System = LongitudeLatitude(ellipsoid) if system == "degrees" else system_of(system, ellipsoid)
    return Correction(stereo=set_up(run, "21", "22"), system=of, pointing=0.005)


@pytest.mark.parametrize(("system", "unit"), [("degrees", 110_000.0), ("EPSG:26720", 1.0)])
def test_polynomials_do_what_the_correction_does(run: Triangulation, system: str, unit: float) -> None:
    """Over the ground of both plates and beside it, in water, on land and between the tides (.12 and .31 m)."""
    direct = correction(run, system)
    field = smooth(direct, (-30.0, 20.0))
    assert field is not None and field.wet is not None and field.dry is not None
    draws = np.random.default_rng(4)
    beside = 0.1 * (field.high - field.low)
    xy = draws.uniform(field.low - beside, field.high + beside, (3000, 2))
    height = np.concatenate([draws.uniform(-29.0, 19.0, 2900), draws.uniform(0.0, 0.4, 100)])
    points = np.column_stack([xy, height])
    expected, done = direct(points), field(points)
    np.testing.assert_array_equal(done.reason, expected.reason)
    assert 500 < np.count_nonzero(expected.reason) < 2500
    # Tenths of a millimetre, a thousandth of sigmas: what a field is held to where it is made.
    assert np.nanmax(np.abs(done.xyz - expected.xyz) * [unit, unit, 1.0]) < 2e-4
    for name, limit in (("depth", 2e-4), ("moved", 2e-4)):
        assert np.nanmax(np.abs(getattr(done, name) - getattr(expected, name))) < limit
    for name in ("sigma", "depth_sigma"):
        assert np.nanmax(np.abs(getattr(done, name) / getattr(expected, name) - 1.0)) < 2e-3
    np.testing.assert_array_equal(np.isnan(done.depth), np.isnan(expected.depth))


def test_points_outside_the_heights_of_a_field_are_corrected_themselves(run: Triangulation) -> None:
    direct = correction(run, "degrees")
    field = smooth(direct, (-10.0, -5.0))
    assert field is not None and field.dry is None
    points = np.array([[-64.936, 18.33, -12.0], [-64.936, 18.33, 3.0], [-64.936, 18.33, -7.0]])
    np.testing.assert_allclose(field(points).xyz, direct(points).xyz, rtol=0, atol=1e-4)


def test_there_is_no_field_where_heights_do_not_say_what_is_wet(run: Triangulation) -> None:
    direct = correction(run, "degrees")
    water = run.block.water
    assert water is not None and run.map_system is not None and run.map_system.ellipsoid is not None
    tilted = replace(run, block=replace(run.block, water=replace(water, tilt_east=1e-5)))
    assert smooth(replace(direct, stereo=set_up(tilted, "21", "22")), (-30.0, 20.0)) is None
    assert smooth(replace(direct, system=Geocentric(run.map_system.ellipsoid)), (-30.0, 20.0)) is None


def test_a_local_job_has_a_field() -> None:
    local = pair(3000.0, 1810.0)
    cameras = replace(local.block.cameras, format_size=np.full((1, 2), 228.6))
    local = replace(local, block=replace(local.block, cameras=cameras))
    direct = Correction(stereo=set_up(local, "1", "2"), system=LocalRectangular(), pointing=0.005)
    field = smooth(direct, (-30.0, -1.0))
    assert field is not None
    points = np.random.default_rng(1).uniform([0.0, -2000.0, -30.0], [1800.0, 2000.0, -1.0], (500, 3))
    np.testing.assert_allclose(field(points).xyz, direct(points).xyz, rtol=0, atol=2e-4)
