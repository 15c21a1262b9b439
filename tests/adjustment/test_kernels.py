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

import musatpy
from altered import added, altered, put, with_options
from blocks import FIXTURES
from cli.commands import musat
from musatpy import read_deck
from musatpy.adjustment import adjust, ground, kernels
from musatpy.adjustment.collinear import Simultaneous
from musatpy.adjustment.iteration import State
from musatpy.adjustment.job import prepared
from musatpy.adjustment.musat2a import GeodeticRestraint
from musatpy.adjustment.network import Network, job_frame
from musatpy.cli import run
from musatpy.errors import AdjustmentError
from musatpy.model import Block, CoordinateSystem, Options, Program, Refraction, WaterLevel

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


def assert_like(a: np.ndarray, b: np.ndarray, share: float = 1e-12) -> None:
    """Elements differ by no more than a share of the largest: sums in another order."""
    limit = share * np.abs(b[np.isfinite(b)]).max(initial=0.0)
    np.testing.assert_allclose(a, b, rtol=0.0, atol=limit, equal_nan=True)


PROGRAMS = [
    (Program.IIIA, Refraction.RIGOROUS, WaterLevel.KNOWN, None),
    (Program.IIIA, Refraction.RIGOROUS, WaterLevel.PHOTO, None),
    (Program.IIIA, Refraction.RIGOROUS, WaterLevel.PHOTO, 2e-3),
    (Program.IIA, Refraction.RIGOROUS, WaterLevel.KNOWN, None),
    (Program.IIA, Refraction.WATPT, WaterLevel.KNOWN, None),
]


def spread(block: Block) -> Block:
    """The block with stations that start metres off, sigmas of images that differ, and every third control held."""
    draws = np.random.default_rng(3)
    off = 5.0 * draws.normal(size=block.photos.position.shape)
    off[:, :2] /= 1.0 if block.options.system is CoordinateSystem.LOCAL else 6.4e6
    sigma = block.plate_sigmas * draws.uniform(0.7, 1.5, block.plate_sigmas.shape)
    held = np.arange(len(block.control.point)) % 3 == 0
    return altered(
        block, photos={"position": added(..., off)}, plates={"sigma": sigma}, control={"fixed": put(held, True)}
    )


@pytest.mark.slow
@pytest.mark.parametrize("deck", DECKS)
@pytest.mark.parametrize(("program", "refraction", "level", "tilt"), PROGRAMS)
def test_both_have_the_same_steps_and_the_same_solution(
    monkeypatch: pytest.MonkeyPatch,
    deck: str,
    program: Program,
    refraction: Refraction,
    level: WaterLevel,
    tilt: float | None,
) -> None:
    """Positions to the rounding of geocentric coordinates, the rest to 1e-9 of the largest.

    Numpy has conditions of pass points in IIA, compiled loops eliminate these: an identity but for a ridge. There
    points are settled to 10 um before a step, of which numpy leaves less than compiled loops.
    """
    options = {"program": program, "refraction": refraction, "water_level": level}
    block = spread(with_options(read_deck(FIXTURES / deck), **options))
    tides = np.where(np.isnan(block.photos.tide), np.nan, 0.05)
    block = altered(block, photos={"tide_sigma": tides}, water={"tilt_east": tilt})
    solutions = []
    for kind in BOTH:
        monkeypatch.setenv(kernels.VARIABLE, kind)
        solutions.append(adjust(block))
    a, b = solutions
    assert len(a.iterations) == len(b.iterations) > 2
    squares = ([step.sum_of_squares for step in one.iterations] for one in solutions)
    np.testing.assert_allclose(*squares, rtol=1e-9 if program is Program.IIIA else 1e-6)
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
