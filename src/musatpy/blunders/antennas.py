"""What may be wrong with the antenna positions of whole lines: a lever arm's sign, a clock, exchanged records."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds.gnss import AntennaTies
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, CauseKind, ObservationKind

_FEWEST = 3  # positions of a line, for a speed
_NEARER = 0.3  # times as far as now must exchanged positions lie from where the images say
IN_ORDER, REVERSED = 0, 1  # how the positions of two lines are exchanged


class LineError(NamedTuple):
    """An error that antenna positions have in common."""

    kind: CauseKind
    member: int  # of a lever arm eight times the camera, and the components with the other sign as bits
    photo: tuple[int, ...]
    name: str  # of the line
    column: FloatArray  # (a, 3) working: what one unit adds to the positions
    lever_arm: FloatArray  # (3,) m, that one unit adds to what is given of the lever arm


def line_errors(block: Block, network: Network, state: State) -> Iterator[LineError]:
    """Yield an error of a second of the time of each line, and signs of lever arms."""
    table, arms = block.antenna_positions, block.lever_arms
    velocity = velocities(block, network.frame.working(table.position))
    for name in np.unique(table.line[np.isfinite(velocity[:, 0])]).tolist():
        member = table.line == name
        column = np.where(member[:, None], np.nan_to_num(velocity), 0.0)
        photos = tuple(table.photo[member].tolist())
        yield LineError(CauseKind.ANTENNA_TIMES, 0, photos, name, column, np.zeros(3))
    camera = block.photos.camera[table.photo]
    for row, number in enumerate(arms.camera.tolist()):
        of_camera = camera == number
        for bits in range(1, 8):
            other = 2.0 * arms.offset[row] * (bits >> np.arange(3) & 1)
            if np.count_nonzero(other) == bits.bit_count() and of_camera.any():
                held = np.where(arms.unknown[row], 0.0, other)
                column = -np.einsum("aji,j->ai", state.M[table.photo], held) * of_camera[:, None]
                member = 8 * number + bits
                yield LineError(CauseKind.LEVER_ARM_SIGN, member, (), "", column, other)


def velocities(block: Block, place: FloatArray) -> FloatArray:
    """Return the velocities (a, 3) in m/s, or the unit of `place` (a, 3) for a second, by neighbours of a line.

    NaN where a line has fewer than three positions with a time.
    """
    table, time = block.antenna_positions, np.full(block.photos.count, np.nan)
    time[block.exposure_times.photo] = block.exposure_times.time
    t, out = time[table.photo], np.full(place.shape, np.nan)
    for name in np.unique(table.line[table.line != ""]).tolist():
        member = np.flatnonzero((table.line == name) & np.isfinite(t))
        member = member[np.argsort(t[member], kind="stable")]
        if len(member) >= _FEWEST and (np.diff(t[member]) > 0.0).all():
            out[member] = np.gradient(place[member], t[member], axis=0)
    return out


def exchanged_lines(block: Block, network: Network, state: State) -> Iterator[tuple[int, tuple[int, ...], str]]:
    """Yield how (IN_ORDER, REVERSED) and between which rows of two lines, or of one, positions were exchanged.

    Each then lies where the images say: those of two lines of as many photos, one after the other.
    """
    of, table = network.measured[ObservationKind.ANTENNA], block.antenna_positions
    if not isinstance(of, AntennaTies):
        return
    observed = network.frame.working(of.value)
    seen = state.position[of.photo[:, 0]] + np.einsum("dji,dj->di", state.M[of.photo[:, 0]], of.arm)
    lines = [np.flatnonzero(table.line == name) for name in np.unique(table.line[table.line != ""]).tolist()]
    for first, second in combinations_with_replacement(lines, 2):
        for how in (IN_ORDER, REVERSED) if first is not second else (REVERSED,):
            if len(first) != len(second) or len(first) < 2:
                continue
            rows, source = exchange(how, first, second)
            now, then = (np.linalg.norm(seen[rows] - observed[k], axis=1).mean() for k in (rows, source))
            if then < _NEARER * now:
                names = dict.fromkeys(table.line[np.concatenate([first[:1], second[:1]])].tolist())
                yield how, tuple(rows.tolist()), " and ".join(names)


def exchange(how: int, first: IntArray, second: IntArray) -> tuple[IntArray, IntArray]:
    """Return rows (k,) and those (k,) whose positions they get."""
    turn = -1 if how == REVERSED else 1
    if first is second:
        return first, first[::turn]
    return np.concatenate([first, second]), np.concatenate([second[::turn], first[::turn]])
