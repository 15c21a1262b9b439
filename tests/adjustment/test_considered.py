"""Water that has a sigma and is not adjusted: its errors in all sigmas, in those of depths, and in the tests."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from adjustment.test_equivalence import simulated
from adjustment.test_free_network import free_block
from adjustment.test_musat3a import FIXTURES, TIGHT, WATER, sea_block
from altered import altered, with_options
from blocks import converged
from musatpy.adjustment import adjust
from musatpy.formats.musat import read_deck
from musatpy.model import Block, CoordinateSystem, Datum, Program, Refraction, Solution, Treatment, WaterLevel
from musatpy.model.block import Distances, HeightDifferences
from musatpy.model.tables import empty
from musatpy.model.water import known_waves
from musatpy.reports.record import record_of
from musatpy.statistics import Statistics
from reference import compare, considered
from reference.networks import Plan

UNKNOWN = {"water_level": WaterLevel.DAY, "water_tilt": Treatment.ADJUST, "water_index": Treatment.ADJUST}
_PROGRAMS: dict[str, dict[str, Any]] = {
    "IIA": {"program": Program.IIA, "refraction": Refraction.RIGOROUS},
    "WATPT": {"program": Program.IIA, "refraction": Refraction.WATPT, "water_limit": 1e-6, "max_passes": 40},
}


def without_ties(block: Block) -> Block:
    """The block without what IIA cannot use."""
    return replace(block, distances=empty(Distances), height_differences=empty(HeightDifferences))


def labels(block: Block) -> np.ndarray:
    """Return which common error (n,) the tides have: of the group, else the day, else the photo."""
    photos = block.photos
    words = [
        f"g{group}" if group else f"d{day}" if day else f"p{name}"
        for group, day, name in zip(photos.tide_group, photos.tide_day, photos.ids, strict=True)
    ]
    return np.array(words)


def dense(solution: Solution) -> considered.Joint:
    """Return the joint covariance of a solution and what was considered, of the reference."""
    block, options = solution.block, solution.block.options
    water = block.water
    wide, sigma, level = block, {}, options.water_level
    if level is WaterLevel.KNOWN:
        level = WaterLevel.GROUP
        names = labels(block)
        wide = replace(wide, photos=replace(block.photos, tide_group=names))
        of = [np.sqrt(np.mean(np.square(block.photos.tide_sigma[names == one]))) for one in np.unique(names)]
        sigma["tides"] = np.array(of)
    if options.water_tilt is not Treatment.ADJUST:
        sigma["tilt"] = np.full(2, water.tilt_sigma)
    if options.water_index is not Treatment.ADJUST:
        sigma["index"] = np.array([water.sigma])
    wide = with_options(wide, **(UNKNOWN | {"water_level": level}))
    return considered.considered(wide, solution, sigma, solution.sum_of_squares, solution.degrees_of_freedom)


def assert_sigmas(solution: Solution, joint: considered.Joint) -> None:
    """Sigmas of everything within 1e-4: WATPT stands a little off."""
    n, p = len(solution.block.photos.ids), len(solution.block.points.ids)
    assert solution.unit_sigma == pytest.approx(joint.unit_sigma, rel=1e-4)
    stations, points = solution.stations.covariance, solution.points.covariance
    np.testing.assert_allclose(compare.sigmas(stations), joint.sigma("stations", n, 6), rtol=1e-4)
    np.testing.assert_allclose(compare.sigmas(points), joint.sigma("points", p, 3), rtol=1e-4)
    np.testing.assert_allclose(solution.level_sigmas, joint.sigma("levels", -1), rtol=1e-4)
    depths = solution.bathymetric
    np.testing.assert_allclose(depths.depth_sigma, joint.depth_sigmas()[depths.point], rtol=1e-4)
    for sigma, kind in ((solution.water.correction_sigma, "tides"), (solution.water.tilt_sigma, "tilt")):
        if np.isfinite(sigma).any():
            np.testing.assert_allclose(sigma, joint.sigma(kind, -1), rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["known", "levels of groups", "tilt", "index", "all by days", *_PROGRAMS])
def test_sigmas_are_those_of_the_dense_bundle(name: str) -> None:
    """Of IIIA with what is known of the water, and of both ways of IIA."""
    iia = name in _PROGRAMS
    block = with_options(without_ties(sea_block()), **_PROGRAMS[name]) if iia else sea_block(**WATER[name])
    solution = converged(block)
    assert_sigmas(solution, dense(solution))


def considering(block: Block, parameter: str, sigma: float) -> Block:
    """The block with a sigma of one parameter: all tides together, the tilt east, the index, or a wave height."""
    n = len(block.photos.ids)
    photos = replace(
        block.photos, tide_sigma=np.full(n, np.nan), tide_group=np.full(n, ""), tide_day=np.full(n, "")
    )
    block = altered(block, photos=photos, water={"sigma": None, "tilt_sigma": None})
    if parameter == "tide":
        return replace(block, photos=replace(photos, tide_sigma=np.full(n, sigma), tide_group=np.full(n, "A")))
    if parameter == "index":
        return altered(block, water={"sigma": sigma if sigma > 0.0 else None})
    return replace(
        block, waves=replace(known_waves(block.waves), height_sigma=[sigma, *[np.nan] * (len(block.waves.ids) - 1)])
    )


def moved(block: Block, parameter: str, change: float) -> Block:
    """The block with that parameter changed."""
    if parameter == "tide":
        return altered(block, photos={"tide": block.photos.tide + change})
    if parameter == "index":
        return altered(block, water={"index": block.water.index + change})
    height = block.waves.height + change * (np.arange(len(block.waves.ids)) == 0)
    return altered(block, waves={"height": height})


def geographic(**options: Any) -> Block:
    plan = Plan(
        system=CoordinateSystem.GEOGRAPHIC,
        submerged=True,
        sea_control=True,
        keep_out=4,
        noise=0.0,
        control_errors=False,
        seed=3,
    )
    return with_options(simulated(plan).block, **TIGHT, **options)


def free(**options: Any) -> Block:
    """A block whose place, heading and size nothing holds: the tides hold its height and its tilts."""
    plan = Plan(photos_per_strip=4, submerged=True, noise=0.0, start_error=(5.0, 1e-3))
    return with_options(free_block(plan), **options)


def wavy(**options: Any) -> Block:
    return with_options(read_deck(FIXTURES / "waves" / "strip.crd"), **TIGHT, **options)


JOBS: dict[str, tuple[Block, str]] = {
    "IIA tide": (geographic(refraction=Refraction.RIGOROUS), "tide"),
    "IIA index": (geographic(refraction=Refraction.RIGOROUS), "index"),
    "IIIA tide": (geographic(program=Program.IIIA), "tide"),
    "free network, tide": (free(), "tide"),
    "free network, index": (free(), "index"),
    "IIA wave": (wavy(program=Program.IIA, refraction=Refraction.RIGOROUS), "wave"),
}
_SIZES = {"tide": 0.3, "index": 0.01, "wave": 0.2}
_TOLD = ("quantity", "unit", "sigma")
_STEP = 0.02  # of these sizes, to either side: third derivatives do not notice


@pytest.mark.slow
@pytest.mark.parametrize("name", list(JOBS))
def test_errors_do_what_a_change_of_the_card_does(name: str) -> None:
    """Every sigma, residual and sum of squares against the job run with the parameter a little off to either side.

    Without other errors second derivatives have nothing to act on; the waves' strip has them, and 2 % to spare, as
    have the points that a free network stays about: their first intersection depends on the water as well.
    """
    block, parameter = JOBS[name]
    is_free = block.options.datum is Datum.FREE
    size, close = _SIZES[parameter], 2e-2 if parameter == "wave" or is_free else 1e-3
    solution, without = (adjust(considering(block, parameter, sigma)) for sigma in (size, np.nan))
    plus, minus = (
        adjust(considering(moved(block, parameter, change), parameter, np.nan))
        for change in (_STEP * size, -_STEP * size)
    )
    scale = (solution.unit_sigma / without.unit_sigma) ** 2
    known = np.isfinite(without.points.position).all(axis=1)
    wet = np.isfinite(without.bathymetric.depth)
    for covariance, change in (
        (lambda one: one.points.covariance[known], lambda one: one.points.position[known]),
        (lambda one: one.stations.covariance[:, :3, :3], lambda one: one.stations.position),
        (
            lambda one: np.square(one.bathymetric.depth_sigma)[wet, None, None],
            lambda one: one.bathymetric.depth[wet],
        ),
    ):
        values = [change(one) for one in (plus, minus)]
        rate = compare.enu_difference(block, *values) if values[0].ndim == 2 else (values[0] - values[1])[:, None]
        expected = rate[:, :, None] * rate[:, None, :] / (2.0 * _STEP) ** 2
        found = covariance(solution) - scale * covariance(without)
        np.testing.assert_allclose(found, expected, rtol=close, atol=close * np.abs(expected).max() + 1e-6)
    np.testing.assert_array_equal(solution.points.position, without.points.position)
    if not is_free:  # there, none of it shows in a residual
        assert_residuals(solution, plus, minus, close)


def assert_residuals(solution: Solution, plus: Solution, minus: Solution, close: float) -> None:
    assert solution.considered is not None
    change = np.square((plus.observed.residual - minus.observed.residual) / (2.0 * _STEP))
    weight = 1.0 / np.square(solution.observed.sigma)
    found = weight * solution.observed.considered
    np.testing.assert_allclose(found, weight * change, rtol=close, atol=close * (weight * change).max())


@pytest.mark.slow
def test_every_considered_parameter_is_told_in_its_unit() -> None:
    """Sigmas of the cards in the units that stand beside them: degrees and seconds of arc, metres, none."""
    block = altered(
        wavy(program=Program.IIA, refraction=Refraction.RIGOROUS), water={"sigma": 2e-3, "tilt_sigma": 1e-4}
    )
    sigmas = {"height": 0.1, "length": 1.0, "azimuth": 0.05, "crest": 2.0}
    others = [np.nan] * (len(block.waves.ids) - 1)
    given = {f"{name}_sigma": [sigma, *others] for name, sigma in sigmas.items()}
    solution = adjust(replace(block, waves=replace(known_waves(block.waves), **given)))
    table = record_of(Statistics(solution), {"adjusted_water"})["adjusted_water"]["considered"]
    rows = {name.split()[-1]: (unit, sigma) for name, unit, sigma in zip(*(table[k] for k in _TOLD), strict=True)}
    expected = {
        "east": ("arc sec", np.degrees(1e-4) * 3600.0),
        "north": ("arc sec", np.degrees(1e-4) * 3600.0),
        "index": ("", 2e-3),
        "height": ("m", 0.1),
        "length": ("m", 1.0),
        "azimuth": ("deg", np.degrees(0.05)),
        "crest": ("m", 2.0),
    }
    assert {name: unit for name, (unit, _) in rows.items()} == {name: unit for name, (unit, _) in expected.items()}
    for name, (_, sigma) in expected.items():
        assert rows[name][1] == pytest.approx(sigma, rel=1e-9)
