"""Gross errors: their sizes, names on the wrong images, wrong flags, wrong control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.simulation.blunder_keys import ControlBlunders
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.terrain import Ground
from musatpy.simulation.true_images import Images
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


def mixed_names(spec: SimulationSpec, images: Images, sound: BoolArray, draws: Draws) -> Names:
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


def _swapped(number: int, images: Images, sound: BoolArray, free: BoolArray, draws: Draws) -> IntArray:
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
    number: int, images: Images, named: IntArray, sound: BoolArray, free: BoolArray, draws: Draws
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
    order: list[int] = np.argsort(draws.uniform(stream, number), kind="stable").tolist()
    return order


def _require(asked: int, had: int, field: str, what: str) -> None:
    if had < asked:
        message = f"{asked} {what} are asked for, {had} can be had"
        raise SpecError([Problem(field=f"blunders.{field}", message=message)])


def flags_on_cards(spec: SimulationSpec, ground: Ground, images: Images, draws: Draws) -> BoolArray:
    """Return which points (p,) the deck flags as submerged. Raises `SpecError` where too few can be wrong."""
    flags, measured = ground.bathymetric.copy(), np.unique(images.point)
    for field, wet in (("flagged_dry", True), ("flagged_submerged", False)):
        number = getattr(spec.blunders, field)
        if number:
            candidates = measured[ground.bathymetric[measured] == wet]
            _require(number, len(candidates), field, "points")
            flags[candidates[draws.pick(field, len(candidates), number)]] = not wet
    return flags


def gross_control(
    spec: SimulationSpec, names: list[str], known: BoolArray, given: BoolArray, draws: Draws
) -> FloatArray:
    """Return the gross errors (k, 3) m east, north, up of control points with these names.

    Random ones hit components that are `known` (k, 3), named ones those that the card has `given`. Raises
    `SpecError` where there are too few, or a card does not have what is to be wrong.
    """
    gross, free = np.zeros((len(names), 3)), np.ones(len(names), dtype=bool)
    for i, table in enumerate(spec.blunders.control, start=1):
        component = 2 if table.component == "vertical" else 0
        candidates = np.flatnonzero(free & known[:, component])
        _require(table.number, len(candidates), f"control[{i}]", f"{table.component} control points")
        hit = candidates[draws.pick("control blunders", len(candidates), table.number)]
        gross[hit] = _control_errors(table, draws)
        free[hit] = False
    for i, wrong in enumerate(spec.wrong_control, start=1):
        error = np.array([wrong.east, wrong.north, wrong.up])
        row = names.index(wrong.point) if wrong.point in names else -1
        if row < 0 or np.any((error != 0.0) & ~given[row]):
            what = "not control" if row < 0 else "its card does not give that component"
            raise SpecError([Problem(field=f"wrong_control[{i}]", message=f"point {wrong.point}: {what}")])
        gross[row] += error
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
