"""Stations of which single components are observed: they hold of the datum what they hold, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from altered import altered
from musatpy.adjustment import adjust
from musatpy.formats import musat
from musatpy.model import Block, ControlKind, CoordinateSystem, Program, Refraction
from musatpy.units import ARC_SECOND
from reference import compare, dense_bundle, networks
from reference.networks import Plan

E, N, U, X_TILT, Y_TILT, HEADING = range(6)
WHOLE = tuple((0, component) for component in range(6))
LOCAL, GEOGRAPHIC = CoordinateSystem.LOCAL, CoordinateSystem.GEOGRAPHIC
# The strip flies at a heading of 0.4 rad: a base is long to the east and to the north, and level.
FIXED = {
    "one station, and east of the next": (*WHOLE, (1, E)),
    "one station, and north of the last": (*WHOLE, (2, N)),
    "components of three stations": ((0, E), (0, N), (0, U), (1, U), (2, E), (2, N), (0, X_TILT), (1, Y_TILT)),
    "seven components": ((0, E), (1, N), (2, U), (1, X_TILT), (2, Y_TILT), (0, HEADING), (2, N)),
}
FREE = {
    "scale": (*WHOLE, (1, X_TILT), (1, Y_TILT), (2, HEADING)),
    "scale, for the base is level": (*WHOLE, (0, U)),
    "heading": ((0, E), (0, N), (0, U), (0, X_TILT), (0, Y_TILT), (1, U)),
    "shift north": ((0, E), (1, E), (2, E), (0, U), *((photo, angle) for photo in range(3) for angle in (3, 4, 5))),
    "shift up": ((0, E), (0, N), (1, E), (2, N), (0, X_TILT), (1, Y_TILT), (2, HEADING)),
}


@cache
def strip(system: CoordinateSystem, observed: tuple[tuple[int, int], ...], program: Program) -> Block:
    """Return a strip of three photos without control, of whose stations some components are observed."""
    refraction = Refraction.NONE if program is Program.IIA else Refraction.RIGOROUS
    plan = Plan(system=system, station_sigma=0.05, attitude_sigma=20 * ARC_SECOND, plate_sigma=0.004)
    block = networks.simulate(plan).block
    known = np.zeros((3, 6), dtype=bool)
    known[tuple(np.array(observed).T)] = True
    photos = block.photos
    return altered(
        block,
        options={"program": program, "refraction": refraction},
        photos=replace(
            photos,
            position_sigma=np.where(known[:, :3], photos.position_sigma, np.nan),
            attitude_sigma=np.where(known[:, 3:], photos.attitude_sigma, np.nan),
        ),
        control={
            "kind": np.full(len(block.control.point), ControlKind.CHECK),
            "fixed": np.zeros(len(block.control.point), dtype=bool),
            "sigma": np.full((len(block.control.point), 3), np.nan),
        },
    )


def errors(block: Block) -> list[str]:
    return [one.message for one in musat.check_deck(musat.deck_bytes(block))[1] if one.severity == "error"]


@pytest.mark.slow
@pytest.mark.parametrize("program", list(Program))
@pytest.mark.parametrize("system", [LOCAL, GEOGRAPHIC])
@pytest.mark.parametrize("name", list(FIXED))
def test_what_holds_all_seven_motions_is_a_datum(name: str, system: CoordinateSystem, program: Program) -> None:
    block = strip(system, FIXED[name], program)
    assert errors(block) == []
    solution = adjust(block)
    result = dense_bundle.solve(block, refraction=False)
    assert solution.converged
    assert solution.sigma0 == pytest.approx(result.sigma0, rel=1e-6)
    assert np.abs(compare.station_difference(solution, result)).max() < 1e-3
    assert np.nanmax(np.abs(compare.covariance_difference(solution.stations.covariance, result.covariance))) < 1e-4


@pytest.mark.parametrize("system", [LOCAL, GEOGRAPHIC])
@pytest.mark.parametrize("name", list(FREE))
def test_what_leaves_a_motion_free_is_none(name: str, system: CoordinateSystem) -> None:
    (message,) = errors(strip(system, FREE[name], Program.IIA))
    assert "its datum needs" in message
