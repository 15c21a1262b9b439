"""Gross errors: their sizes, names on the wrong images, wrong flags, wrong control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.simulation.simulation_spec import ControlBlunders, SimulationSpec
from musatpy.simulation.true_images import TrueImages
from musatpy.specs import Pair

_ERROR_DECIMALS = 6  # of control errors, m


@dataclass(frozen=True, kw_only=True)
class Names:
    """Which points the names on the plate cards mean."""

    point: IntArray  # (m,) row of the ground of the point that the card names
    swapped: IntArray  # (s, 2) rows of measurements of one photo that have each other's names
    misnamed: IntArray  # (w,) rows of measurements that have the name of a point which the photo lacks


def drawn_sizes(draws: Draws, stream: str, number: int, size: Pair, log: bool) -> FloatArray:
    """Return sizes (number,) from the least to the greatest, spread evenly, or evenly in their logarithm."""
    share = draws.uniform(stream, number)
    if log:
        return size[0] * (size[1] / size[0]) ** share
    return size[0] + (size[1] - size[0]) * share


def mixed_names(spec: SimulationSpec, images: TrueImages, sound: BoolArray, draws: Draws) -> Names:
    """Return the names of the measurements, some of them mixed up.

    Only measurements that are `sound` (m,) otherwise are hit, and no point has a part in two mistakes. Raises
    `SpecError` where there are not enough of them.
    """
    named = images.point.copy()
    free = np.ones(int(images.point.max(initial=-1)) + 1, dtype=bool)
    swapped = _swapped(spec.blunders.swapped, images, sound, free, draws)
    named[swapped] = images.point[swapped[:, ::-1]]
    misnamed = _misnamed(spec.blunders.misnamed, images, named, sound, free, draws)
    return Names(point=named, swapped=swapped, misnamed=misnamed)


def _swapped(number: int, images: TrueImages, sound: BoolArray, free: BoolArray, draws: Draws) -> IntArray:
    """Return pairs of measurements (number, 2) of one photo; their points are not `free` any more."""
    pairs: list[tuple[int, int]] = []
    for row in _any_order(draws, "swapped names", len(sound)) if number else ():
        if len(pairs) == number:
            break
        if sound[row] and free[images.point[row]]:
            candidates = sound & free[images.point] & (images.photo == images.photo[row])
            partners = np.setdiff1d(np.flatnonzero(candidates), row)
            if len(partners):
                partner = int(partners[int(draws.uniform("swap partners", 1)[0] * len(partners))])
                pairs.append((min(row, partner), max(row, partner)))
                free[images.point[[row, partner]]] = False
    _require(number, len(pairs), "swapped", "pairs of images")
    return np.array(sorted(pairs), dtype=int).reshape(-1, 2)


def _misnamed(
    number: int, images: TrueImages, named: IntArray, sound: BoolArray, free: BoolArray, draws: Draws
) -> IntArray:
    """Return measurements (number,) and put the names of points that their photos lack into `named` (m,)."""
    rows: list[int] = []
    for row in _any_order(draws, "misnamed", len(sound)) if number else ():
        if len(rows) == number:
            break
        if sound[row] and free[images.point[row]]:
            here = images.point[images.photo == images.photo[row]]
            elsewhere = np.unique(images.point[sound & free[images.point]])
            others = np.setdiff1d(elsewhere, here)
            if len(others):
                named[row] = others[int(draws.uniform("names taken", 1)[0] * len(others))]
                rows.append(row)
                free[[images.point[row], named[row]]] = False
    _require(number, len(rows), "misnamed", "images")
    return np.sort(np.array(rows, dtype=int))


def _any_order(draws: Draws, stream: str, number: int) -> list[int]:
    return [int(row) for row in np.argsort(draws.uniform(stream, number), kind="stable")]


def _require(asked: int, had: int, field: str, what: str) -> None:
    if had < asked:
        message = f"{asked} {what} are asked for, {had} can be had"
        raise SpecError([Problem(field=f"blunders.{field}", message=message)])


def gross_control(spec: SimulationSpec, known: BoolArray, draws: Draws) -> FloatArray:
    """Return the gross errors (k, 3) m east, north, up of control points, in components that are `known` (k, 3).

    Raises `SpecError` where there are too few.
    """
    gross, free = np.zeros(known.shape), np.ones(len(known), dtype=bool)
    for i, table in enumerate(spec.blunders.control, start=1):
        component = 2 if table.component == "vertical" else 0
        candidates = np.flatnonzero(free & known[:, component])
        _require(table.number, len(candidates), f"control[{i}]", f"{table.component} control points")
        hit = candidates[draws.pick("control blunders", len(candidates), table.number)]
        gross[hit] = _control_errors(table, draws)
        free[hit] = False
    return gross


def _control_errors(table: ControlBlunders, draws: Draws) -> FloatArray:
    size = drawn_sizes(draws, "control blunder sizes", table.number, table.size, table.log)
    turn = draws.uniform("control blunder directions", table.number)
    if table.component == "vertical":
        error = np.column_stack([0.0 * turn, 0.0 * turn, np.where(turn < 0.5, -size, size)])
    else:
        azimuth = 2.0 * np.pi * turn
        error = np.column_stack([size * np.sin(azimuth), size * np.cos(azimuth), 0.0 * turn])
    return np.round(error, _ERROR_DECIMALS)
