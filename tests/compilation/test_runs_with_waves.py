"""Runs whose water has waves, known or found: points, stages and old compilations go through them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from compilation.scenes import at_depth, grid, pair, readings_at
from musatpy import model, read_deck
from musatpy.adjustment.job import adjust
from musatpy.adjustment.wavy_water import CREST, Sea, sea_of
from musatpy.arrays import FloatArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.compiled import compiled
from musatpy.compilation.loop import stages
from musatpy.compilation.stereomodels import Stereomodel, set_up
from musatpy.compilation.triangulation import AdjustedRun
from musatpy.compilation.true_points import NOT_FOLLOWED, ThroughWaves, true_points
from musatpy.errors import CompilationError
from musatpy.formats.compilation_deck import compilation_bytes
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model.compilation import Compilation
from musatpy.model.tables import empty
from musatpy.refraction.apparent import Fault, Stations, TruePoints
from musatpy.refraction.apparent import true_points as true_points_of_apparent
from musatpy.refraction.surface import Gridded
from musatpy.refraction.waves import sinusoidal
from musatpy.simulation import simulate
from musatpy.simulation.simulation_spec import spec_from_table
from stage_readings import FIXTURES, models, pointed, read_again

_CREST = np.array([[np.nan, np.nan, np.nan, 3.0]])


def swell(times: tuple[float, float] = (0.0, 9.0), sigma: FloatArray | None = None) -> Sea:
    """Return a wave over the pair of `scenes`, which runs 80 m from one exposure to the other."""
    surface = sinusoidal(amplitude=0.6, length=90.0, azimuth=0.7, speed=9.0, crest=8.0)
    return Sea(surface=surface, time=np.array(times), origin=np.zeros(3), sigma=sigma)


def wavy(sea: Sea) -> AdjustedRun:
    return replace(pair(1500.0, 900.0, (0.4, -0.3)), sea=sea)


def in_model(stereo: Stereomodel, ground: FloatArray) -> FloatArray:
    return stereo.model(stereo.run.frame.working(ground))


PLACES = grid((100.0, 800.0), 700.0, 6)


def test_errors_of_a_wave_are_in_the_sigmas() -> None:
    """That of a crest by what compiled points move by when it is moved by a centimetre."""
    run, step = wavy(swell(sigma=_CREST)), 0.01
    precision = model.WaterPrecision(
        names=("wave 1 crest",), covariance=np.array([[400.0]]), stations=np.zeros((2, 6, 1)),
        levels=np.empty((0, 1)),
    )  # fmt: skip
    stereo = set_up(run, "1", "2")
    xy = stages(stereo, in_model(stereo, at_depth(PLACES, 9.0)))
    readings = readings_at(xy)
    assert run.sea is not None
    values = run.sea.trains.values
    values = np.stack([values, values])
    values[:, 0, CREST] += [step, -step]
    moved = [replace(run, sea=replace(run.sea, surface=run.sea.trains.with_values(v).surface)) for v in values]
    plus, minus = (true_points(other, (0, 1), readings).position for other in moved)
    by_crest = (plus - minus) / (2.0 * step)
    exact, found = (true_points(other, (0, 1), readings) for other in (run, replace(run, water=precision)))
    added = 400.0 * by_crest[:, :, None] * by_crest[:, None, :]
    np.testing.assert_allclose(found.covariance, exact.covariance + added, rtol=1e-5, atol=1e-9)
    assert np.sqrt(added[:, 2, 2]).max() > 0.1
    np.testing.assert_allclose(found.depth_sigma, np.sqrt(found.covariance[:, 2, 2]), rtol=1e-9)
    assert (found.y_parallax_sigma > exact.y_parallax_sigma).all()


@pytest.mark.slow
def test_images_traced_through_waves_come_back_as_the_truth() -> None:
    """A strip of four exposures, 9 s apart; plates to .001 um, points to .1 mm on the cards."""
    waves = [
        {"id": "SW", "length": 90.0, "depth": 20.0, "height": 1.2, "azimuth": 52.0, "crest": 8.0},
        {"id": "CH", "length": 40.0, "height": 0.3, "azimuth": 115.0, "crest": -4.0},
    ]
    spec = spec_from_table(
        {
            "seed": 5,
            "job": {"system": "LOCL"},
            "flight": {"photos": 4, "height": 3000.0, "interval": 9.0, "attitude_scatter": 1.0},
            "water": {"level": 0.2, "tides": [0.4, -0.3, 0.1, 0.1]},
            "terrain": {"level": 30.0},
            "points": {"per_site": 3},
            "shoal": [{"share": 0.5, "depth": [2.0, 20.0]}],
            "control": [{"kind": "full", "number": 8, "sigma": 0.05}],
            "measurement": {"noise": 0.0},
            "compilation": {"pointing": 0.0, "depth": [2.0, 20.0], "points": 40, "profiles": 0},
            "options": {"program": "IIIA"},
            "wave": waves,
        }
    )
    simulation = simulate(spec)
    assert simulation.compiled is not None
    run, deck = of_solution(adjust(simulation.block)), simulation.compiled.deck
    result = compiled(run, deck)
    true = simulation.compiled.position[result.rows]
    assert not any(result.reasons) and np.abs(result.points.position - true).max() < 1e-4
    level = compiled(replace(run, sea=None), deck).points.position - true
    assert np.abs(level[:, 2]).max() > 0.5


@pytest.fixture(scope="module")
def sea() -> Stereomodel:
    return set_up(wavy(swell()), "1", "2")


def corrected(run: AdjustedRun, apparent: FloatArray) -> TruePoints:
    """Return the true points of apparent ones (k, 3) of both photos."""
    photos = run.block.photos
    stations = Stations(position=photos.position, level=photos.tide, axis=-attitude_matrix(photos.attitude)[:, 2])
    through = ThroughWaves(run=run, photos=np.arange(2))
    assert run.block.water is not None
    return true_points_of_apparent(apparent, stations, run.block.water.index, through=through)


def test_apparent_points_become_the_true_ones_through_waves(sea: Stereomodel) -> None:
    true = at_depth(PLACES, 8.0)
    apparent = true_points(sea.run, (0, 1), readings_at(stages(sea, in_model(sea, true)))).apparent
    done = corrected(sea.run, apparent)
    np.testing.assert_allclose(done.position, true, rtol=0.0, atol=1e-6)


def test_under_waves_short_beside_the_depth_points_are_lost_with_a_reason(sea: Stereomodel) -> None:
    """An apparent place that no point is seen at, and one 20 m down between thousands of waves."""
    ripples = sinusoidal(amplitude=0.12, length=2.0, azimuth=0.3)
    stereo = set_up(wavy(replace(swell(), surface=ripples)), "1", "2")
    done = corrected(stereo.run, np.array([[300.0, 200.0, -15.0], [300.0, 200.0, 4.0]]))
    assert done.fault.tolist() == [Fault.NO_CONVERGENCE, Fault.ABOVE_WATER]


@pytest.mark.slow
def test_readings_off_the_known_water_are_the_only_ones_lost() -> None:
    """A surface measured on a grid that ends in the middle of the model."""
    x, y = np.arange(-200.0, 405.0, 5.0), np.arange(-900.0, 905.0, 5.0)
    z = 0.4 * np.cos(2.0 * np.pi * x / 90.0)[:, None] * np.ones(len(y))
    measured = Gridded(x=x, y=y, height=z)
    run = wavy(replace(swell(), surface=measured))
    whole, places = set_up(wavy(swell()), "1", "2"), PLACES[::4]
    xy = stages(whole, in_model(whole, at_depth(places, 5.0)))
    points = true_points(run, (0, 1), readings_at(xy))
    lost = places[:, 0] > 405.0
    assert points.reasons == dict.fromkeys(np.flatnonzero(lost).tolist(), NOT_FOLLOWED)
    assert np.isfinite(points.position[~lost]).all() and np.isnan(points.position[lost]).all()
    assert points.wet.dtype == bool and points.wet[~lost].all() and not points.wet[lost].any()


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the record, the punched results and a compilation deck of the strip through waves."""
    folder = tmp_path_factory.mktemp("runs")
    deck = FIXTURES / "waves" / "strip.crd"
    assert musat("run", "-q", deck, "-o", folder, "--punch", "result").exit_code == 0
    block = read_deck(deck)
    readings = pointed(read_again(block, 0, "837", "838"), 3, 0.0)
    for name, mode in (("image", "IMAGE"), ("printed", "PRINTED")):
        of_models = replace(models(("A", "837", "838")), mode=np.array([mode]))
        contents = Compilation(titles=("WAVES",), models=of_models, stages=readings)
        (folder / f"{name}.crd").write_bytes(compilation_bytes(contents))
    return folder


@pytest.mark.slow
def test_the_commands_go_through_the_waves_of_the_run(runs: Path, tmp_path: Path) -> None:
    for command in ("compile", "setup", "compare-points"):
        result = musat("as11", command, runs / "strip.json", runs / "image.crd", "-o", tmp_path)
        assert result.exit_code == 0, result.output
    for listing in ("image.lst", "image.setup.lst"):
        text = (tmp_path / listing).read_text()
        assert "Through the waves of the run (SW, CHOP), as they stood at each exposure." in text


def test_the_formulas_of_1983_are_of_still_water(runs: Path) -> None:
    result = musat("as11", "compile", runs / "strip.json", runs / "printed.crd", "-o", runs)
    assert result.exit_code == 1 and "model A: the run has waves, and PRINTED is of still water" in result.output


@pytest.mark.slow
def test_waves_beside_a_deck_are_given_again() -> None:
    """To a compilation from the solution; its record does not know where their crests count from."""
    block = read_deck(FIXTURES / "waves" / "unknown.crd")
    given = sea_of(block, None)
    solution = adjust(replace(block, waves=empty(model.Waves), wave_origin=None), sea=given)
    with pytest.raises(CompilationError, match="given beside its deck"):
        of_solution(solution)
    sea = of_solution(solution, given).sea
    assert sea is not None and solution.water is not None and solution.water.waves is not None
    np.testing.assert_allclose(sea.trains.values, solution.water.waves.value, rtol=1e-11)  # digits of a record


def test_waves_without_the_time_of_an_exposure_are_refused(runs: Path, tmp_path: Path) -> None:
    (punched,) = runs.glob("*.pun")
    lines = [
        line[:51] + " " * 21 if line.startswith("TID 838") else line for line in punched.read_text().split("\n")
    ]
    deck = tmp_path / "timeless.pun"
    deck.write_text("\n".join(lines))
    result = musat("as11", "compile", deck, runs / "image.crd", "-o", tmp_path)
    assert result.exit_code == 1 and "time" in result.output and "838" in result.output
