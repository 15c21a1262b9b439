"""Compiled kernels beside their numpy twins: the same normal equations, the same steps, the same listings.

Slow, as they are compiled first: half a minute of CPU on a new machine. Loops are compiled anew when any source of
theirs is another one.
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import musatpy
from altered import added, altered, with_options
from blocks import FIXTURES
from cli.commands import musat
from musatpy import read_deck
from musatpy.adjustment import adjust, ground, kernels
from musatpy.adjustment.collinear import Simultaneous
from musatpy.adjustment.iteration import Linearisation, State
from musatpy.adjustment.job import prepared
from musatpy.adjustment.kernels import loops_of
from musatpy.adjustment.musat2a import GeodeticRestraint
from musatpy.adjustment.network import Network, job_frame
from musatpy.cli import run
from musatpy.errors import AdjustmentError
from musatpy.model import Options, Program, Refraction, WaterLevel

DECKS = ("st_thomas/st_thomas.crd", "cayman/cayman_modified.crd", "verdict/iia_same_deck.crd")
BOTH = (kernels.NUMPY, kernels.NUMBA)


@cache
def job(deck: str, tilt: float = 0.0, **options: object) -> tuple[Network, State, Options]:
    """Return the network of a deck with its submerged points wet, at first values."""
    block = with_options(read_deck(FIXTURES / deck), **options)
    block = altered(block, water={"tilt_east": tilt}) if tilt else block
    parts, state = prepared(block, None)
    wet = block.points.bathymetric[block.plates.point]
    return parts.network.with_plates(parts.network.xy, wet), state, block.options


def linearised(
    monkeypatch: pytest.MonkeyPatch, kind: str, network: Network, state: State, options: Options
) -> tuple[Linearisation, State]:
    """Return the linearisation of a state by kernels of a kind, and the state after its step."""
    monkeypatch.setenv(kernels.VARIABLE, kind)
    problem = Simultaneous(network=replace(network), options=options)  # which keeps what it has gathered
    line = problem.linearise(problem.with_squares(state))
    step = np.linspace(-1e-3, 1e-3, len(line.rhs)) * 1e-3
    return line, problem.apply(state, step, line.context)


def assert_like(a: np.ndarray, b: np.ndarray, share: float = 1e-12) -> None:
    """Elements differ by no more than a share of the largest: sums in another order."""
    limit = share * np.abs(b[np.isfinite(b)]).max(initial=0.0)
    np.testing.assert_allclose(a, b, rtol=0.0, atol=limit, equal_nan=True)


def assert_same_equations(a: Linearisation, b: Linearisation, after_a: State, after_b: State) -> None:
    """Normal equations, scaled alike, are the same, and so are points and squares of the states."""
    scale = 1.0 / np.sqrt(b.matrix.diagonal())
    assert_like(a.matrix.scaled(scale).blocks, b.matrix.scaled(scale).blocks, 1e-11)
    assert_like(a.rhs * scale, b.rhs * scale, 1e-11)
    assert a.objective == pytest.approx(b.objective, rel=1e-12)
    assert_like(after_a.ground, after_b.ground)
    assert_like(after_a.squares, after_b.squares, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("deck", DECKS)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), shift=st.floats(0.0, 30.0), spread=st.floats(1.0, 30.0))
def test_both_have_the_same_normal_equations(deck: str, seed: int, shift: float, spread: float) -> None:
    """Stations and points off by metres, weights apart by their squares, some known components held."""
    network, state, options = job(deck)
    draws = np.random.default_rng(seed)
    weight = network.weight * draws.uniform(1.0, spread, network.weight.shape)
    held = network.priors.held | (network.priors.known & (draws.uniform(size=network.priors.known.shape) < 0.3))
    network = replace(network, weight=weight, priors=replace(network.priors, held=held))
    sizes = {"position": shift, "attitude": 1e-3, "ground": 0.1 * shift}
    off = {name: size * draws.normal(size=getattr(state, name).shape) for name, size in sizes.items()}
    state = altered(state, **{name: added(..., error) for name, error in off.items()})
    with pytest.MonkeyPatch.context() as patch:
        (a, after_a), (b, after_b) = (linearised(patch, kind, network, state, options) for kind in BOTH)
    assert_same_equations(a, b, after_a, after_b)
    assert a.of_points == pytest.approx(b.of_points, rel=1e-9)  # a difference of nearly equal numbers at the best


@pytest.mark.slow
@pytest.mark.parametrize("deck", DECKS)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), shift=st.floats(0.0, 20.0), spread=st.floats(1.0, 30.0))
def test_both_have_the_same_conditions_and_points_at_rest(
    deck: str, seed: int, shift: float, spread: float
) -> None:
    """IIA: stations off by metres, weights apart by their squares, some rays wet.

    Of some control points the height alone is known, or all but it; what is known is held, or has a weight.
    """
    network, state, options = job(deck)
    draws = np.random.default_rng(seed)
    network = replace(network, weight=network.weight * draws.uniform(1.0, spread, network.weight.shape))
    kinds = np.array([[1, 1, 1], [0, 0, 1], [1, 1, 0]], dtype=bool)
    known = network.priors.known & kinds[draws.integers(0, 3, network.points)]
    held = known & (draws.uniform(size=(network.points, 1)) < 0.3)
    weight = np.where(known & ~held, draws.uniform(0.1, 100.0, known.shape), 0.0)
    network = replace(network, priors=replace(network.priors, known=known, held=held, weight=weight))
    state = replace(state, position=state.position + shift * draws.normal(size=state.position.shape))
    lines, settled = [], []
    for kind in BOTH:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(kernels.VARIABLE, kind)
            problem = GeodeticRestraint(network=replace(network), options=options)
            # the last step of a point is below 10 um, of which Gauss-Newton leaves up to a fifth where stations are
            # off by metres; numpy goes on with the points of a group until the last one is there
            settled.append(ground.settle(network, ground.settle(network, ground.settle(network, state))))
            lines.append(problem.linearise(settled[0]))
    a, b = settled
    np.testing.assert_allclose(a.ground, b.ground, rtol=0.0, atol=1e-7)
    assert_like(a.squares, b.squares, 1e-9)
    line_a, line_b = lines
    scale = 1.0 / np.sqrt(line_b.matrix.diagonal())
    # numpy has conditions of pass points, compiled loops eliminate these: an identity but for a ridge
    assert_like(line_a.matrix.scaled(scale).blocks, line_b.matrix.scaled(scale).blocks, 1e-9)
    assert_like(line_a.rhs * scale, line_b.rhs * scale, 1e-9)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), shift=st.floats(0.0, 10.0), tilt=st.sampled_from([0.0, 2e-3]))
def test_both_have_the_same_normal_equations_with_a_level_of_each_photo(
    seed: int, shift: float, tilt: float
) -> None:
    """Seven unknowns a photo, the water level or tilted; compiled kernels have all points that are on their own."""
    unknown = {"program": Program.IIIA, "refraction": Refraction.RIGOROUS, "water_level": WaterLevel.PHOTO}
    network, state, options = job(DECKS[0], tilt, **unknown)
    draws = np.random.default_rng(seed)
    off = {
        "position": shift * draws.normal(size=state.position.shape),
        "tide": 0.1 * draws.normal(size=network.photos),
    }
    state = altered(state, **{name: added(..., error) for name, error in off.items()})
    assert network.pattern.size == 7
    with pytest.MonkeyPatch.context() as patch:
        (a, after_a), (b, after_b) = (linearised(patch, kind, network, state, options) for kind in BOTH)
        patch.setenv(kernels.VARIABLE, kernels.NUMBA)
        left = loops_of(network, network.groups).set_squares(state, state.squares.copy())
    assert all(group.known for group in left)  # those of equal elevations
    levels = b.matrix.of_single_photos()[:, 6]
    assert (np.abs(levels[:, :6]).max(axis=1) > 0.0).any()
    assert_same_equations(a, b, after_a, after_b)


@pytest.mark.slow
def test_a_point_behind_a_camera_has_no_squares(monkeypatch: pytest.MonkeyPatch) -> None:
    network, state, options = job(DECKS[2])
    ground = state.ground.copy()
    ground[3] += 2.0 * (state.position[0] - ground[3])
    for kind in BOTH:
        monkeypatch.setenv(kernels.VARIABLE, kind)
        squares = (
            Simultaneous(network=replace(network), options=options)
            .with_squares(replace(state, ground=ground))
            .squares
        )
        assert np.flatnonzero(np.isinf(squares)).tolist() == [3]


PROGRAMS = [
    (Program.IIIA, Refraction.RIGOROUS, WaterLevel.KNOWN),
    (Program.IIIA, Refraction.RIGOROUS, WaterLevel.PHOTO),
    (Program.IIA, Refraction.RIGOROUS, WaterLevel.KNOWN),
    (Program.IIA, Refraction.WATPT, WaterLevel.KNOWN),
]


@pytest.mark.slow
@pytest.mark.parametrize("deck", DECKS)
@pytest.mark.parametrize(("program", "refraction", "level"), PROGRAMS)
def test_both_have_the_same_solution(
    monkeypatch: pytest.MonkeyPatch, deck: str, program: Program, refraction: Refraction, level: WaterLevel
) -> None:
    """Positions to the rounding of geocentric coordinates, the rest to 1e-9 of the largest."""
    options = {"program": program, "refraction": refraction, "water_level": level}
    block = with_options(read_deck(FIXTURES / deck), **options)
    block = altered(block, photos={"tide_sigma": np.where(np.isnan(block.photos.tide), np.nan, 0.05)})
    solutions = []
    for kind in BOTH:
        monkeypatch.setenv(kernels.VARIABLE, kind)
        solutions.append(adjust(block))
    a, b = solutions
    frame = job_frame(block)
    gap = frame.working(a.points.position) - frame.working(b.points.position)
    assert np.nanmax(np.abs(gap)) < 1e-8 and a.sigma0 == pytest.approx(b.sigma0, rel=1e-9)
    for of in ("points.covariance", "stations.covariance", "observed.redundancy"):
        assert_like(*map(attrgetter(of), solutions), 1e-9)
    for of in ("observed.influence", "dependence.station_inflation"):  # small differences of large products
        assert_like(*map(attrgetter(of), solutions), 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("deck", DECKS)
def test_listings_are_the_same_byte_by_byte(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, deck: str) -> None:
    text = (FIXTURES / deck).read_text()
    for old in ("IIA  GEOG WATPT   ", "IIA  LOCL WATPT   ", "IIA  GEOG RIGOROUS"):
        text = text.replace(f"OPT {old}", f"OPT IIIA{old[4:9]} RIGOROUS")
    source = tmp_path / "job.crd"
    source.write_text(text)
    for kind, words in zip(BOTH, (", listing", ", numba kernels, listing"), strict=True):
        monkeypatch.setenv(kernels.VARIABLE, kind)
        ran = musat("run", source, "-o", tmp_path / kind)
        assert ran.exit_code == 0 and words in ran.output
        assert ("numba" in ran.output) == (kind == kernels.NUMBA)  # the plain ones are not named
    a, b = ((tmp_path / kind / "job.lst").read_bytes() for kind in BOTH)
    assert a == b
    records = [tmp_path / kind / "job.json" for kind in BOTH]
    assert [json.loads(path.read_text())["program"]["kernels"] for path in records] == list(BOTH)
    same = musat("diff", *(str(path) for path in records)).output
    assert "kernels" not in same


def test_a_large_block_without_numba_says_what_it_would_gain(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(run, "_LARGE", 2)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    output = musat("run", FIXTURES / DECKS[0], "-o", tmp_path).output
    assert output.count("pip install 'musatpy[fast]'") == 1
    monkeypatch.undo()
    output = musat("run", FIXTURES / DECKS[0], "-o", tmp_path).output
    assert "musatpy[fast]" not in output


def test_large_blocks_take_numba_and_what_is_asked_for_and_not_there_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(kernels.VARIABLE, raising=False)
    assert [kernels.name_of(kernels.LARGE + more) for more in (0, 1)] == list(BOTH)
    monkeypatch.setenv(kernels.VARIABLE, "fortran")
    with pytest.raises(AdjustmentError, match="'fortran': it is numpy or numba"):
        kernels.name_of(1)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv(kernels.VARIABLE, kernels.NUMBA)
    with pytest.raises(AdjustmentError, match=r"pip install 'musatpy\[fast\]'"):
        kernels.name_of(1)
    monkeypatch.delenv(kernels.VARIABLE)
    assert kernels.name_of(10_000) == kernels.NUMPY


@pytest.mark.slow
@pytest.mark.parametrize("program", [Program.IIIA, Program.IIA])
def test_sums_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch, program: Program) -> None:
    """Bit by bit, points in four parts; IIA settles its points in the same parts."""
    pytest.importorskip("numba")
    from musatpy.adjustment.compiled import loops

    network, state, options = job(DECKS[2])
    monkeypatch.setattr(loops, "_PART", 10)
    monkeypatch.setattr(kernels, "_FEWEST", 0)
    monkeypatch.setenv(kernels.VARIABLE, kernels.NUMBA)
    lines = []
    for most in (1, 3):
        monkeypatch.setattr(kernels, "_MOST", most)
        monkeypatch.setattr(os, "cpu_count", lambda: 8)
        if program is Program.IIIA:
            problem = Simultaneous(network=replace(network, gathered={}), options=options)
            lines.append(problem.linearise(problem.with_squares(state)))
        else:
            pass_points = GeodeticRestraint(network=replace(network, gathered={}), options=options)
            lines.append(pass_points.linearise(ground.settle(pass_points.network, state)))
    a, b = lines
    np.testing.assert_array_equal(a.matrix.blocks, b.matrix.blocks)
    np.testing.assert_array_equal(a.rhs, b.rhs)
    assert a.objective == b.objective and a.of_points == b.of_points


PACKAGE = Path(musatpy.__file__).parent
ADDED = """
from musatpy.adjustment.compiled.points import LinearPoints, follow
import numpy as np
i, list_, table, stack = np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 3))
points = LinearPoints(stack, stack, table, stack, table, list_, list_)
follow(i, i, i, points, (0,), table, table)
print(sum(follow.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_a_source_that_is_another_one_is_seen_by_loops_of_other_files(tmp_path: Path) -> None:
    """Else a newer version would go on with the pieces of the old one, and say nothing."""
    copy = shutil.copytree(PACKAGE, tmp_path / "musatpy", ignore=shutil.ignore_patterns("__pycache__"))

    def run() -> str:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        environment.pop("NUMBA_CACHE_DIR", None)
        ran = subprocess.run(
            [sys.executable, "-c", ADDED], capture_output=True, text=True, env=environment, check=True
        )
        return ran.stdout.strip()

    assert run() == "0"
    assert run() == "1"
    piece = copy / "adjustment" / "compiled" / "loops.py"  # no part of these
    piece.write_text(piece.read_text() + "# another one\n")
    assert run() == "0"
    assert run() == "1"
