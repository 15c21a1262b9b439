"""Gross errors: their sizes, names on the wrong images, wrong flags, wrong control."""

from __future__ import annotations

from collections.abc import Iterator, Sized
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import SpecError
from musatpy.simulation.simulation_spec import SimulationSpec
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
    named, taken = images.point.copy(), np.zeros(int(images.point.max(initial=-1)) + 1, dtype=bool)
    swapped: list[tuple[int, int]] = []
    misnamed: list[int] = []

    def rows(stream: str, number: int, hit: Sized) -> Iterator[int]:
        """Yield sound measurements in any order, of points without a part in a mistake, until so many are hit."""
        for row in np.argsort(draws.uniform(stream, len(sound)), kind="stable").tolist() if number else ():
            if len(hit) < number and sound[row] and not taken[images.point[row]]:
                yield row

    def drawn(stream: str, others: IntArray) -> int:
        return int(others[int(draws.uniform(stream, 1)[0] * len(others))])

    for row in rows("swapped names", spec.blunders.swapped, swapped):
        here = sound & ~taken[images.point] & (images.photo == images.photo[row])
        partners = np.setdiff1d(np.flatnonzero(here), row)
        if len(partners):
            pair = sorted((row, drawn("swap partners", partners)))
            swapped.append((pair[0], pair[1]))
            taken[images.point[pair]] = True
            named[pair] = images.point[pair[::-1]]
    for row in rows("misnamed", spec.blunders.misnamed, misnamed):
        here = images.point[images.photo == images.photo[row]]
        others = np.setdiff1d(np.unique(images.point[sound & ~taken[images.point]]), here)
        if len(others):
            named[row] = drawn("names taken", others)
            misnamed.append(row)
            taken[[images.point[row], named[row]]] = True
    _require(spec.blunders.swapped, len(swapped), "swapped", "pairs of images")
    _require(spec.blunders.misnamed, len(misnamed), "misnamed", "images")
    pairs = np.array(sorted(swapped), dtype=int).reshape(-1, 2)
    return Names(point=named, swapped=pairs, misnamed=np.sort(np.array(misnamed, dtype=int)))


def _require(asked: int, had: int, field: str, what: str) -> None:
    if had < asked:
        raise SpecError.of(f"{asked} {what} are asked for, {had} can be had", field=f"blunders.{field}")


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
        size = drawn_sizes(draws, "control blunder sizes", table.number, table.size, table.log)
        turn = 2.0 * np.pi * draws.uniform("control blunder directions", table.number)
        flat = [size * np.sin(turn), size * np.cos(turn), 0.0 * turn]
        upright = [0.0 * turn, 0.0 * turn, np.where(turn < np.pi, -size, size)]
        gross[hit] = np.round(np.column_stack(flat if component == 0 else upright), _ERROR_DECIMALS)
        free[hit] = False
    return gross
