"""The kinds of observations and of global unknowns, a few to a file; whoever deals with all loops over these.

Every file of this folder with `KINDS` counts, in the order of `model.ObservationKind`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np

from musatpy.adjustment.kinds.kind import Kind, OfWater, Prior, Rows, Unknown
from musatpy.adjustment.kinds.measured import MeasuredKind
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray


def _all() -> list[Kind]:
    """Return the kinds of all files of the folder."""
    names = [path.stem for path in Path(__file__).parent.glob("*.py") if path.stem != "__init__"]
    kinds = (kind for name in names for kind in getattr(import_module(f"{__name__}.{name}"), "KINDS", ()))
    return sorted(kinds, key=lambda kind: kind.observed)


KINDS = tuple(_all())
DIRECT = tuple(kind for kind in KINDS if kind.direct)
MEASURED = tuple(kind for kind in KINDS if isinstance(kind, MeasuredKind))
PRIORS = tuple(kind for kind in KINDS if isinstance(kind, Prior))
UNKNOWNS = tuple(kind for kind in KINDS if isinstance(kind, Unknown))
WATER = tuple(kind for kind in KINDS if isinstance(kind, OfWater))
SEARCHED = tuple(kind for kind in KINDS if kind.searched)


def state_after(network: Network, state: State, step: FloatArray) -> State:
    """Return the state after a step of stations and global unknowns; ground points stay where they are."""
    n, q = network.photos, network.pattern.size
    stations = step[: q * n].reshape(n, q)
    state = replace(
        state,
        position=state.position + np.einsum("nji,nj->ni", network.axes, stations[:, :3]),
        attitude=state.attitude + stations[:, 3:6],
    )
    for kind in UNKNOWNS:
        state = kind.state_after(network, step, state)
    return state


def largest_movements(step: FloatArray, network: Network) -> tuple[int, float, int, float]:
    """Return (photo, rad) of the largest differential rotation and (photo, m) of the largest translation."""
    n, q = network.photos, network.pattern.size
    stations = step[: q * n].reshape(n, q)
    rotation = np.abs(stations[:, 3:6]).max(axis=1)
    translation = np.linalg.norm(stations[:, :3], axis=1)
    turned, shifted = int(rotation.argmax()), int(translation.argmax())
    return turned, float(rotation[turned]), shifted, float(translation[shifted])


def kept_movement(step: FloatArray, network: Network) -> float:
    """Return the largest change of the coordinates of kept points, in m."""
    first = network.pattern.order + network.border.first_kept
    return float(np.abs(step[first:]).max(initial=0.0))


def direct_rows(network: Network, state: State) -> Iterator[tuple[Kind, Rows]]:
    """Yield the observations of every kind that has any."""
    for kind in DIRECT:
        if kind.takes_part(network) and len((rows := kind.rows(network, state)).row):
            yield kind, rows


def station_rows(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return weights and residuals (n, q) of the unknowns of photos as observed, the water at each included."""
    weight, residual = np.zeros((2, network.pattern.order))
    for _, rows in direct_rows(network, state):
        if rows.index.shape[1] == 1 and rows.index[0, 0] < len(weight):
            weight[rows.index[:, 0]], residual[rows.index[:, 0]] = rows.weight, rows.residual
    return weight.reshape(network.photos, -1), residual.reshape(network.photos, -1)


def direct_squares(network: Network, state: State) -> float:
    """Return the weighted sum of squares of all observations that concern no image."""
    split = network.pattern.order
    of_unknowns, others = np.zeros(split + network.border.size), 0.0
    for _, rows in direct_rows(network, state):
        squares = rows.weight * np.square(rows.residual)
        if rows.index.shape[1] == 1:  # added up in the order of the unknowns, whatever their kinds
            of_unknowns[rows.index[:, 0]] += squares
        else:
            others += float(np.sum(squares))
    return float(np.sum(of_unknowns[:split])) + others + float(np.sum(of_unknowns[split:]))


def add_direct(network: Network, state: State, normals: NormalEquations) -> None:
    """Add all observations that concern no image."""
    for _, rows in direct_rows(network, state):
        normals.add_rows(rows.index, rows.partials, rows.weight, rows.residual)
