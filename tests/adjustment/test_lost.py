"""Data so wrong that nothing fits: the run ends as not converged, never in an exception, and names the culprit."""

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from altered import added, altered, with_options
from musatpy import adjust, listing, read_deck
from musatpy.adjustment.iteration import Linearisation, iterate
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Distances, Program, Refraction
from musatpy.simulation import simulate, spec_from_table
from musatpy.statistics import metric_differences

DECK = Path(__file__).resolve().parents[2] / "fixtures" / "st_thomas" / "st_thomas.crd"


@pytest.fixture(scope="module")
def block():
    return read_deck(DECK)


def moved_control(block, row, degrees):
    return altered(block, control={"position": added(row, [*np.radians(degrees), 0.0])})


def moved_station(block, row, degrees):
    return altered(block, photos={"position": added(row, [*np.radians(degrees), 0.0])})


def observed_station(block, row, degrees):
    """A station far off that the deck calls known to a metre."""
    moved = moved_station(block, row, degrees)
    sigma = np.full_like(block.photos.position_sigma, 1.0)
    return altered(moved, photos={"position_sigma": sigma})


def measured_distance(block, factor):
    """A distance between the points 204 and 219, so many times too long."""
    ends = np.flatnonzero(np.isin(block.points.ids, ["204", "219"]))
    places = Ellipsoid(block.ellipsoid.name).geocentric(adjust(block).points.position[ends])
    length = factor * float(np.linalg.norm(places[1] - places[0]))
    return dataclasses.replace(block, distances=Distances(point=[ends], length=[length], sigma=[0.05]))


RIGOROUS = {"refraction": Refraction.RIGOROUS}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "changes", "named"),
    [
        pytest.param(
            lambda block: moved_control(block, 3, (1.0, 0.0)), {}, "point 104 on photo", id="control-latitude"
        ),
        pytest.param(
            lambda block: moved_control(block, 0, (0.0, -1.0)),
            {**RIGOROUS, "max_iterations": 10},
            "point 101 on photo",
            id="control-longitude",
        ),
        pytest.param(
            lambda block: moved_control(block, 3, (1.0, 0.0)),
            {"program": Program.IIIA, "max_iterations": 10},
            "point 104 on photo",
            id="control-latitude-IIIA",
        ),
        pytest.param(
            lambda block: measured_distance(block, 10.0),
            {"program": Program.IIIA, "max_iterations": 5},
            "the distance of points 204 and 219 is off by",
            id="distance-IIIA",
        ),
        pytest.param(
            lambda block: observed_station(block, 2, (1.0, 0.0)),
            {"program": Program.IIIA, "max_iterations": 6},
            "on photo 23 is",
            id="station-IIIA",
        ),
    ],
)
def test_a_hopeless_job_ends_as_not_converged_and_names_the_culprit(block, spoil, changes, named):
    solution = adjust(with_options(spoil(block), **changes))
    assert not solution.converged
    # whichever is above its limit; a step that is damped heavily can be below both
    assert re.search("still (moves|turns)|no step lowers the sum of squares", solution.reason)
    assert "; most at odds: " in solution.reason
    assert "NOT CONVERGED" in listing(solution)
    at_start = [text for text in solution.warnings if text.startswith("at the start of the run most at odds: ")]
    assert named in at_start[0].split(", ")[0]  # the worst comes first


@pytest.mark.slow
def test_points_behind_cameras_end_the_run(block):
    solution = adjust(observed_station(block, 2, (1.0, 0.0)))
    assert solution.reason.startswith("points stay behind their cameras")
    assert solution.passes == ()  # nothing is built on a lost triangulation


@pytest.mark.slow
@pytest.mark.parametrize("program", list(Program))
def test_a_start_a_degree_off_is_found_back(block, program):
    """A given station without sigma is a start only: the images and the control know better."""
    rigorous = with_options(block, program=program, refraction=Refraction.RIGOROUS)
    found, usual = adjust(moved_station(rigorous, 2, (1.0, 0.0))), adjust(rigorous)
    assert found.converged
    off = metric_differences(block, found.points.position, usual.points.position)
    assert np.nanmax(np.abs(off)) < 0.02  # m: the limits of the steps leave millimetres


def test_normal_equations_without_sense_end_the_run():
    """Where linearising gives what is no number, the run ends like any other that has lost its points."""

    class Senseless:
        def linearise(self, state):
            matrix = SimpleNamespace(sensible=lambda: False)
            return Linearisation(matrix=matrix, rhs=np.zeros(1), objective=1.0, context=None, redundancy=1)

    outcome = iterate(Senseless(), "first", 5, lambda step: None)
    assert outcome.lost
    assert outcome.state == "first"


@pytest.mark.slow
def test_a_run_that_falls_short_does_not_follow_the_water_line_for_long():
    """One iteration is not enough for any triangulation, and points change their sides of the water after each."""
    spec = spec_from_table(
        {
            "job": {"centre": [18.0, -65.0]},
            "flight": {"photos": 6, "height": 1500.0},
            "water": {"tide_scatter": 0.3},
            "shoal": [{"share": 0.6, "depth": [0.1, 1.0]}],
            "points": {"extra": [{"number": 40}]},
            "control": [{"kind": "full", "number": 6, "sigma": 0.1}],
            "stations": {"position_error": 300.0, "attitude_error": 3.0},
            "options": {"program": "IIIA", "max_iterations": 1},
        }
    )
    solution = adjust(simulate(spec).block)
    assert not solution.converged
    assert solution.reason.startswith("limits not reached in 1 iteration")
    assert [one.outer_pass for one in solution.iterations] == [1, 2]
