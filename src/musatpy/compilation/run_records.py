"""The triangulation of the record of a run, and what says that a deck is none that a run has punched."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.triangulation import (
    UNCONVERGED,
    AdjustedRun,
    fault_of_run,
    freedom_of,
    of_block,
    waves_of_run,
)
from musatpy.compilation.true_points import Readings, true_points
from musatpy.errors import CompilationError, Problem
from musatpy.model import Grade
from musatpy.model.compilation import RECOVERABLE
from musatpy.records import run_tables
from musatpy.records.json_files import read_record
from musatpy.records.tables import Tables, flags, numbers
from musatpy.reduction.readings_job import reduce

_PAIRS = 10  # of photos that are looked at
_MISFIT = 6.0  # plate sigmas that half the y-parallaxes of adjusted photos are well below
_CONTROL = ("control", "equal_elevations", "distances", "height_differences")


def of_record(path: Path, anyway: bool = False) -> AdjustedRun:
    """Return the triangulation of the record of a run; `anyway` also of one that has not converged.

    Raises `RecordError` where it is none, `CompilationError` where it cannot be compiled from, and `OSError`.
    """
    tables = read_record(path, (*run_tables.BLOCK, *run_tables.COVARIANCES, "solution", "verdict", *_CONTROL))
    solution, stations, points = (tables[name] for name in ("solution", "stations", "points"))
    unconverged = "" if solution["converged"] else str(solution["reason"])
    if faults := fault_of_run("" if anyway else unconverged):
        raise CompilationError([Problem(file=str(path), message=fault) for fault in faults])
    if tables["adjusted_water"] is not None and (fault := run_tables.water_fault(tables)):
        raise CompilationError([Problem(file=str(path), message=fault)])
    block = run_tables.block_of(tables)
    try:
        sea = waves_of_run(replace(block, **run_tables.given_waves(tables)), run_tables.adjusted_waves(tables))
    except CompilationError as error:
        raise CompilationError([replace(problem, file=str(path)) for problem in error.problems]) from error
    caution, because = (UNCONVERGED, unconverged) if unconverged else _doubts(tables)
    return AdjustedRun(
        block=block,
        given=numbers(stations, "given_position", 3),
        covariance=numbers(stations, "covariance", 6, 6),
        pairs=run_tables.station_pairs(tables),
        levels=run_tables.level_pairs(tables),
        water=run_tables.water_precision(tables),
        position=numbers(points, "position", 3),
        point_covariance=numbers(points, "covariance", 3, 3),
        triangulated=flags(tables["plates"], "triangulated"),
        control=np.isin(points["point"], _known_of(tables)),
        unit_sigma=float(solution["unit_sigma"] or 1.0),
        freedom=freedom_of(solution["degrees_of_freedom"]),
        sea=sea,
        stated=run_tables.answer_spec(tables),
        caution=caution,
        because=because,
    )


def _doubts(tables: Tables) -> tuple[str, str]:
    """Return what the verdict on a run that has converged says against it, and why; nothing of one accepted."""
    verdict = tables["verdict"]
    if Grade(verdict["grade"]) is Grade.ACCEPTED:
        return "", ""
    return f"the run is {verdict['grade'].lower()}", "; ".join(reason["text"] for reason in verdict["reasons"])


def _known_of(tables: Tables) -> list[str]:
    """Return the ids of the points that something is known of."""
    control = tables["control"]
    held = [point for point, kind in zip(control["point"], control["kind"], strict=True) if kind != "check"]
    return held + list(chain.from_iterable(chain.from_iterable(tables[name]["points"] for name in _CONTROL[1:])))


def unadjusted(run: AdjustedRun) -> str:
    """Return what says that the stations of a deck are not those of its plates; empty where nothing does.

    A punched deck may have no plate measurements. Raises `DeckError` as `reduction.readings_job.reduce` where they
    are raw.
    """
    if run.block.raw:
        run = of_block(reduce(run.block)[0])
    last = len(run.block.photos.ids) - 2
    first = np.unique(np.linspace(0, max(last, 0), _PAIRS).astype(np.int64))[: max(last + 1, 0)]
    off = np.concatenate([np.zeros(0), *(np.abs(_y_parallaxes(run, left)) for left in first.tolist())])
    known = off[np.isfinite(off)]
    limit = max(RECOVERABLE, _MISFIT * run.block.options.plate_sigma)
    if not len(known) or np.median(known) <= limit:
        return ""
    half = f"half have y-parallaxes over {1e3 * np.median(known):.0f} um (expected: below {1e3 * limit:.0f} um)"
    return (
        f"its stations do not fit its plate measurements: of {len(known)} points that neighbouring photos share, "
        f"{half}. It is the deck of a run that is still to be adjusted: give the record of the run, NAME.json, or "
        "the deck that it punched, NAME.pun (--anyway compiles from it)"
    )


def _y_parallaxes(run: AdjustedRun, left: int) -> FloatArray:
    """Return the y-parallaxes (k,) mm of the points that a photo shares with the next one, NaN where unknown."""
    block, plates = run.block, run.block.plates
    one, other = (np.flatnonzero((plates.photo == photo) & plates.triangulated) for photo in (left, left + 1))
    common, here, there = np.intersect1d(plates.point[one], plates.point[other], return_indices=True)
    at = np.stack([one[here], other[there]], axis=1)
    readings = Readings(
        ids=block.points.ids[common],
        submerged=block.points.bathymetric[common] & np.isfinite(block.photos.tide[[left, left + 1]]).all(),
        xy=plates.xy[at],
        sigma=np.full((len(common), 2, 2), block.options.plate_sigma),
    )
    return true_points(run.without_errors, (left, left + 1), readings).y_parallax
