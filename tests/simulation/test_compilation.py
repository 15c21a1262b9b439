"""Simulated readings in models: the truth comes back through run and compilation; soundings tell of refraction."""

import csv
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from musatpy import adjust
from musatpy.arrays import FloatArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.errors import SpecError
from musatpy.formats.compilation_deck import read_compilation
from musatpy.model.compilation import StageReadings
from musatpy.simulation import Simulation, simulate
from musatpy.simulation.simulation_spec import spec_from_table

# St. Thomas: a strip of four photos at three tides, depths to 30 m, nothing with errors.
SPEC = {
    "seed": 5,
    "job": {"centre": [18.3, -64.9]},
    "flight": {"photos": 4, "height": 3000.0, "attitude_scatter": 1.0, "station_scatter": 20.0},
    "water": {"level": 0.2, "tides": [0.4, -0.3, 0.1, 0.1]},
    "terrain": {"level": 30.0},
    "points": {"per_site": 3},
    "shoal": [{"share": 0.5, "depth": [1.0, 30.0]}],
    "control": [{"kind": "full", "number": 8, "sigma": 0.05}],
    "measurement": {"noise": 0.0},
    "compilation": {"pointing": 0.0, "depth": [1.0, 30.0]},
}


def simulated(**compilation: object) -> Simulation:
    """Return the strip with other keys of the compilation."""
    given = {**SPEC["compilation"], **compilation}  # type: ignore[dict-item]
    return simulate(spec_from_table(SPEC | {"compilation": given}))


def compiled_of(simulation: Simulation) -> Compiled:
    assert simulation.compiled is not None
    return compiled(of_solution(adjust(simulation.block)), simulation.compiled.deck)


def errors(result: Compiled, simulation: Simulation) -> FloatArray:
    """Return the errors (k, 3) m of compiled points, east, north, up."""
    assert simulation.compiled is not None
    frame = result.run.frame
    true = frame.working(simulation.compiled.position[result.rows])
    gap = frame.working(result.points.position) - true
    return np.einsum("kij,kj->ki", frame.axes(true), gap)


def test_the_truth_comes_back_without_errors() -> None:
    simulation = simulated()
    result = compiled_of(simulation)
    assert simulation.compiled is not None and len(result.models) == 3 and not any(result.reasons)
    # Plates to .001 um, points to .1 mm on the cards; WATPT, rays of a plane across the vertical of a point.
    assert np.abs(errors(result, simulation)).max() < 2e-4
    np.testing.assert_allclose(result.points.depth, simulation.compiled.depth[result.rows], rtol=0, atol=2e-4)
    wet = result.submerged
    assert wet.sum() == 3 * 133 and (~wet).sum() == 30
    assert np.nanmin(result.points.depth) < 3.0 and np.nanmax(result.points.depth) > 28.0
    soundings = simulated(sounding_error=0.0, soundings=7).compiled.soundings
    rows = list(csv.DictReader(StringIO(soundings)))
    assert len(rows) == 7 and set(rows[0]) == {"name", "lat", "lon", "depth", "sigma"}
    assert all(1.0 - 1e-3 < float(row["depth"]) < 30.0 + 1e-3 for row in rows)


@pytest.mark.slow
def test_errors_of_two_thousand_points_are_those_of_their_sigmas() -> None:
    """Of pointing alone: the run has no errors, and its sigmas none of its own."""
    simulation = simulated(pointing=5.0, points=670, dry=0, profiles=0)
    assert simulation.compiled is not None
    run = of_solution(adjust(simulation.block))
    pairs = replace(run.pairs, covariance=np.zeros_like(run.pairs.covariance))
    run = replace(run, covariance=np.zeros_like(run.covariance), pairs=pairs, water=None)
    result = compiled(run, simulation.compiled.deck)
    scaled = errors(result, simulation) / result.sigma
    assert len(scaled) == 2010
    # A root mean square of 2,010 is good to 1.6 %.
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(scaled), axis=0)), 1.0, atol=0.05)


def test_the_command_writes_decks_that_read_back(tmp_path: Path) -> None:
    spec = tmp_path / "strip.toml"
    spec.write_text(
        "[job]\nsystem = 'LOCL'\n[water]\nlevel = 0.5\n[terrain]\nlevel = 20.0\n"
        "[compilation]\npoints = 5\ndry = 2\nprofiles = 2\nreadings = 4\nsoundings = 3\n"
    )
    result = musat("simulate", spec, "-o", tmp_path)
    assert result.exit_code == 0 and "readings" in result.output
    deck, warnings = read_compilation(tmp_path / "strip.compilation.crd")
    assert not warnings and len(deck.stages.ids) == 2 * (5 + 2 + 2 * 6) and len(deck.profiles.ids) == 4
    assert isinstance(deck.stages, StageReadings) and (np.abs(deck.stages.xy) < 110.0).all()
    truth = list(csv.DictReader((tmp_path / "strip.compilation.truth.csv").open()))
    assert [row["point"] for row in truth] == deck.stages.ids.tolist()
    assert all((row["depth"] == "") == (not wet) for row, wet in zip(truth, deck.stages.submerged, strict=True))
    assert (tmp_path / "strip.soundings.csv").read_text().startswith("name,x,y,depth,sigma\nS0001,")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"water": None, "shoal": []}, "the block has no water"),
        ({"flight": {"photos": 1}}, "no strip has two photos"),
        ({"compilation": {"depth": [5.0, 2.0]}}, "depth is the least, then the greatest"),
        ({"flight": {"photos": 2, "forward_overlap": 0.06}, "water": {"level": 0.0}}, "points are wanted"),
    ],
)
def test_what_cannot_be_compiled_is_refused(change: dict[str, object], said: str) -> None:
    table = {key: value for key, value in (SPEC | change).items() if value is not None}
    if "flight" in change:
        table |= {"control": [], "shoal": [], "water": {"level": 0.2}}
    with pytest.raises(SpecError, match=said):
        simulate(spec_from_table(table))
