"""What may be wrong with the antenna positions of whole lines: a lever arm's sign, a clock, exchanged records.

`hypotheses` has what a file of such errors of a kind gives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds.gnss import AntennaTies, flight_lines, unknown_arms
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, CauseKind, ObservationKind

_FEWEST = 3  # positions of a line, for a speed
_NEARER = 0.3  # times as far as now must exchanged positions lie from where the images say
_IN_ORDER, _REVERSED = 0, 1  # how the positions of two lines are exchanged
KIND = ObservationKind.ANTENNA
SENSIBLE = {CauseKind.ANTENNA_TIMES: 3600.0}  # s


@dataclass(frozen=True, kw_only=True, eq=False)
class LineError:
    """An error that antenna positions have in common; one unit of it adds to what was observed."""

    kind: CauseKind
    member: int = 0  # of a lever arm eight times its row, and the components with the other sign as bits
    photo: tuple[int, ...] = ()
    name: str  # of the line; of the components
    positions: FloatArray  # (a, 3) m, working, added to the positions
    lever_arm: FloatArray  # (l, 3) m, added to the lever arms as given

    @property
    def whole(self) -> FloatArray | None:
        """(3,) m, its size, which it has or has not: of a sign. None: it may have any."""
        return self.lever_arm.sum(axis=0) if self.kind is CauseKind.LEVER_ARM_SIGN else None

    def of(self, kind: ObservationKind, block: Block, network: Network) -> FloatArray | None:
        """Return what one unit adds to the observations (r,) of a kind, None where nothing."""
        if kind is ObservationKind.LEVER_ARM:
            return self.lever_arm[unknown_arms(block)]
        ties = network.measured.get(kind)
        if not isinstance(ties, AntennaTies):
            return None
        return np.einsum("dij,dj->di", ties.to_components(network), self.positions[ties.row]).reshape(-1)


def common_errors(block: Block, network: Network, state: State) -> Iterator[LineError]:
    """Yield an error of a second of the time of each line, and signs of lever arms that are not zero."""
    table, arms = block.antenna_positions, block.lever_arms
    speed = _velocities(block, network.frame.working(table.position))
    for name in np.unique(table.line[np.isfinite(speed[:, 0])]).tolist():
        of_line = (table.line == name)[:, None]
        yield LineError(
            kind=CauseKind.ANTENNA_TIMES,
            photo=tuple(table.photo[of_line[:, 0]].tolist()),
            name=f"line {name}",
            positions=np.where(of_line, np.nan_to_num(speed), 0.0),
            lever_arm=np.zeros((arms.count, 3)),
        )
    for row in range(arms.count):
        taken = block.photos.camera[table.photo] == arms.camera[row]
        for bits in range(1, 8):
            reversed_ = (bits >> np.arange(3) & 1).astype(bool)
            if not (taken.any() and arms.offset[row, reversed_].all()):
                continue
            arm = np.zeros((arms.count, 3))
            arm[row, reversed_] = 2.0 * arms.offset[row, reversed_]
            held = np.where(unknown_arms(block)[row], 0.0, arm[row])
            components = ", ".join(np.array(["x", "y", "z"])[reversed_].tolist())
            yield LineError(
                kind=CauseKind.LEVER_ARM_SIGN,
                member=8 * row + bits,
                name=f"{components} of camera {block.cameras.ids[arms.camera[row]]}",
                positions=-np.einsum("aji,j->ai", state.M[table.photo], held) * taken[:, None],
                lever_arm=arm,
            )


def _velocities(block: Block, place: FloatArray) -> FloatArray:
    """Return what `place` (a, 3) changes in a second, by the neighbours in its line.

    NaN where a line has fewer than three positions with a time.
    """
    table, (_, t), out = block.antenna_positions, flight_lines(block), np.full(place.shape, np.nan)
    for name in np.unique(table.line[table.line != ""]).tolist():
        member = np.flatnonzero((table.line == name) & np.isfinite(t))
        member = member[np.argsort(t[member], kind="stable")]
        if len(member) >= _FEWEST and (np.diff(t[member]) > 0.0).all():
            out[member] = np.gradient(place[member], t[member], axis=0)
    return out


def exchanges(
    block: Block, network: Network, state: State
) -> Iterator[tuple[CauseKind, int, tuple[int, ...], str]]:
    """Yield how, and between which photos, the positions of two lines of as many were exchanged, or one reversed.

    Each then lies near where the images say.
    """
    table, arm = block.antenna_positions, np.zeros((block.cameras.count, 3))
    arm[block.lever_arms.camera] = block.lever_arms.offset
    arm = arm[block.photos.camera[table.photo]]
    seen = state.position[table.photo] + np.einsum("aji,aj->ai", state.M[table.photo], arm)
    observed = network.frame.working(table.position)
    lines = [np.flatnonzero(table.line == name) for name in np.unique(table.line[table.line != ""]).tolist()]
    for first, second in combinations_with_replacement(lines, 2):
        for how in (_IN_ORDER, _REVERSED) if first is not second else (_REVERSED,):
            if len(first) != len(second) or len(first) < 2:
                continue
            rows, source = _exchange(how, first, second)
            now, then = (np.linalg.norm(seen[rows] - observed[k], axis=1).mean() for k in (rows, source))
            if then < _NEARER * now:
                names = dict.fromkeys(table.line[rows[[0, -1]]].tolist())
                order = ", in reversed order" if how == _REVERSED else ""
                what = f"line{'s'[: len(names) - 1]} {' and '.join(names)}{order}"
                yield CauseKind.ANTENNA_LINES, how, tuple(table.photo[rows].tolist()), what


def _exchange(how: int, first: IntArray, second: IntArray) -> tuple[IntArray, IntArray]:
    """Return rows (k,) and those (k,) whose positions they get."""
    turn = -1 if how == _REVERSED else 1
    if np.array_equal(first, second):
        return first, first[::turn]
    return np.concatenate([first, second]), np.concatenate([second[::turn], first[::turn]])


def _with_other_times(block: Block, photo: IntArray, _: int, slip: float) -> Block:
    """Return the block with the positions of some photos as they were `slip` s before."""
    table, changed = block.antenna_positions, block.antenna_positions.position.copy()
    member = np.isin(table.photo, photo)
    changed[member] -= slip * np.nan_to_num(_velocities(block, table.position))[member]
    return replace(block, antenna_positions=replace(table, position=changed))


def _with_other_sign(block: Block, _: IntArray, member: int, __: float) -> Block:
    """Return the block with the other sign of components of a lever arm, by the `member` of its `LineError`."""
    row, bits = divmod(member, 8)
    offset = block.lever_arms.offset.copy()
    offset[row] *= 1 - 2 * (bits >> np.arange(3) & 1)
    return replace(block, lever_arms=replace(block.lever_arms, offset=offset))


def _with_exchanged_lines(block: Block, photo: IntArray, how: int, _: float) -> Block:
    """Return the block with the positions of the photos of two lines exchanged, or those of one reversed."""
    table, row = block.antenna_positions, np.zeros(block.photos.count, dtype=int)
    row[table.photo] = np.arange(table.count)
    rows = row[photo]
    first = rows[table.line[rows] == table.line[rows[0]]]
    second = rows[len(first) :] if len(first) < len(rows) else first
    rows, source = _exchange(how, first, second)
    position, sigma = table.position.copy(), table.sigma.copy()
    position[rows], sigma[rows] = table.position[source], table.sigma[source]
    return replace(block, antenna_positions=replace(table, position=position, sigma=sigma))


REVISIONS = {
    CauseKind.ANTENNA_TIMES: _with_other_times,
    CauseKind.LEVER_ARM_SIGN: _with_other_sign,
    CauseKind.ANTENNA_LINES: _with_exchanged_lines,
}
